"""False kidnapping alarms on recorded logs: `uv run python benchmarks/recorded_logs.py data/logs`.

Filters Victoria Park, cityTrees10000, DLR and all robots of MRCLAM 6 and 9, with the labels of
their landmarks, and prints the number of poses at which the robot found itself kidnapped.
"""

from pathlib import Path

import numpy as np

from measuring import arguments
from saccade import datasets, slam
from saccade.datasets.tables import from_upper_triangle
from saccade.plane import to_range_bearing
from saccade.types import LandmarkLog


def read_dlr(path: Path) -> LandmarkLog:
    """Reads the DLR log from an .npz.

    `odometry` (t, 3) holds relative poses, `odometry_cov_upper` (t, 6) the upper triangles of their
    covariances, and `observations` (k, 7) the step, the label, x, y and the upper triangle of their
    covariance, observed from the pose at the start of the step.
    """
    with np.load(path) as arrays:
        odometry, upper = arrays["odometry"], arrays["odometry_cov_upper"]
        observations = arrays["observations"]
    observations = observations[np.argsort(observations[:, 0], kind="stable")]
    z, R = to_range_bearing(
        observations[:, 2:4],
        from_upper_triangle(observations[:, 4:]),
        lambda k: f"{path}, observation {k}",
    )
    return LandmarkLog(
        name=path.stem,
        start=np.zeros(3),
        time=np.arange(len(odometry) + 1.0),
        motion="compose",
        control=odometry,
        control_covariance=from_upper_triangle(upper),
        observation_pose=observations[:, 0].astype(np.int64),
        observation=z,
        observation_covariance=R,
        landmark=observations[:, 1].astype(np.int64),
    )


def main() -> None:
    folder = arguments(__doc__, logs={"flags": "logs", "type": Path}).logs
    texts = ("victoria_park/victoria_park_gtsam.txt", "citytrees/cityTrees10000.txt")
    logs = [datasets.load("auto", folder / text) for text in texts]
    logs.append(read_dlr(folder / "dlr" / "dlr_3298.npz"))
    logs += [
        datasets.load("mrclam", folder / "mrclam" / f"mrclam{number}.npz", robot=robot)
        for number in (6, 9)
        for robot in range(1, 6)
    ]
    print("log                        poses  landmarks  alarms")
    for log in logs:
        result = slam.run(log)
        lost = np.zeros(1, bool) if result.lost is None else result.lost
        alarms = int((np.diff(lost.astype(int), prepend=0) > 0).sum())
        print(f"{log.name:24s} {len(log.time):7d} {len(result.map):10d} {alarms:7d}", flush=True)


if __name__ == "__main__":
    main()
