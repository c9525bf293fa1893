"""EKF-SLAM on a simulated log: accuracy and consistency of two filters."""

import numpy as np

from saccade import slam
from saccade.evaluation.trajectory import position_rmse
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam.consistency import pose_nees
from saccade.viewing import map_figure, save_figure

log = simulate_world(WorldConfig(steps=600), seed=3)  # 2.4 laps of a circle of 63 m
print(log)

for errors in ("standard", "invariant"):
    config = slam.EkfConfig(
        errors=errors, association="known", estimate_systematic_errors=False, smooth=False
    )
    run = slam.run(log, config)
    nees = pose_nees(run.trajectory, log.truth, errors)
    print(
        f"{errors:9}  position RMSE {position_rmse(run.trajectory, log.truth):.2f} m, "
        f"mean NEES {np.nanmean(nees):5.2f} (3 if consistent), mean NIS {run.consistency.mean:.2f}"
    )
print(f"odometry   position RMSE {position_rmse(run.dead_reckoning, log.truth):.2f} m")

figure = map_figure(
    run.trajectory, run.map, run.dead_reckoning, log.truth, landmark_truth=log.landmark_truth
)
save_figure(figure, "landmark_slam.png")
