"""A robot finds its way by its camera: frames and odometry in, a map out, in a made-up place."""

from saccade import visual
from saccade.evaluation.drives import score_drive
from saccade.simulation import DriveConfig, simulate_drive
from saccade.viewing import map_figure, save_figure

drive = simulate_drive(DriveConfig(frames=120, frames_per_lap=60), seed=1)
run = visual.run(drive)
print(run)

for name, way in {"by camera": run.trajectory, "odometry alone": run.odometry}.items():
    score = score_drive(way, drive.truth)
    print(f"{name:15} {score.ate_m:.2f} m from the truth (ATE)")
again = (run.observations.kind == 2).sum()
print(f"{again} times a landmark that had been out of sight was known again")

save_figure(map_figure(run.trajectory, run.map, run.odometry, drive.truth), "drive.png")
