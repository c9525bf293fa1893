"""Visual SLAM on a simulated drive: stereo frames and odometry to trajectory and map."""

from saccade import visual
from saccade.evaluation.trajectory import score_drive
from saccade.simulation import DriveConfig, simulate_drive
from saccade.viewing import map_figure, save_figure

drive = simulate_drive(DriveConfig(frames=120, frames_per_lap=60), seed=1)
run = visual.run(drive)
print(run)

for name, trajectory in {"visual SLAM": run.trajectory, "odometry alone": run.odometry}.items():
    score = score_drive(trajectory, drive.truth)
    print(f"{name:15} ATE {score.ate_m:.2f} m")
reidentified = run.observations.kind == visual.ObservationKind.REIDENTIFIED
print(f"{reidentified.sum()} re-identifications of lost landmarks")

save_figure(map_figure(run.trajectory, run.map, run.odometry, drive.truth), "drive.png")
