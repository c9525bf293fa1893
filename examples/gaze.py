"""A camera that chooses where to look: the decision after each frame turns the camera."""

from collections import Counter

from saccade import visual
from saccade.frames import Gaze
from saccade.simulation import DriveConfig, PanCamera, simulate_drive
from saccade.viewing import map_figure, save_figure
from saccade.visual.gaze_control import GazeControl

config = DriveConfig(world="rooms", frames=60, frames_per_lap=200, image_size=(160, 120))
motor = PanCamera()  # on a robot: the driver of its pan-tilt unit
drive = simulate_drive(config, seed=1, pan=motor)


def turn(time: float, gaze: Gaze) -> None:
    """On a robot: send gaze.pan and gaze.tilt, in radians, to the motors."""
    motor.turn_to(time, gaze)


control = GazeControl("active", drive.camera, motor.limits, turn)
run = visual.run(drive, visual.VisualConfig(egomotion="wheels"), gaze=control)
print(run)

for reason, count in Counter(each.reason for each in control.decisions).most_common():
    print(f"{reason}: {count} decisions")
error = run.trajectory.pose[-1, :2] - drive.truth.pose[-1, :2]
print(f"{(error @ error) ** 0.5:.3f} m off at the end")

save_figure(map_figure(run.trajectory, run.map, run.odometry, drive.truth), "gaze.png")
