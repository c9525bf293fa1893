"""The DLR building log of Kurlbaum & Frese: odometry and known landmarks in one .npz."""

from pathlib import Path

import numpy as np

from saccade.datasets.logs.conversions import to_range_bearing
from saccade.datasets.tables import Archive, from_upper_triangle
from saccade.errors import LogError
from saccade.types import LandmarkLog


def read_dlr(path: str | Path) -> LandmarkLog:
    """Read the DLR log.

    Args:
        path: an .npz with `odometry` (t, 3) relative poses, `odometry_cov_upper`
            (t, 6) the upper triangles of their covariances, row by row, and `observations`
            (k, 7): step, identity, x, y, cxx, cxy, cyy, observed from the start pose of the step.

    Returns:
        The log; its times are the numbers of the poses.

    Raises:
        LogError: no such file, or not these tables.
    """
    path = Path(path)
    archive = Archive(path)
    odometry = archive.table("odometry", ("forward", "left", "turn"))
    upper = archive.table("odometry_cov_upper", ("xx", "xy", "xt", "yy", "yt", "tt"))
    columns = ("step", "landmark", "x", "y", "xx", "xy", "yy")
    observations = archive.table("observations", columns)
    steps = len(odometry)
    if len(upper) != steps:
        raise LogError(f"{path}: expected {steps} covariances of odometry, found {len(upper)}")
    step = observations[:, 0]
    if len(step) and not 0 <= step.min() <= step.max() <= steps:
        raise LogError(
            f"{path}: expected steps from 0 to {steps}, found {step.min():g}-{step.max():g}"
        )
    observations = observations[np.argsort(step, kind="stable")]
    observation, observation_covariance = to_range_bearing(
        observations[:, 2:4],
        from_upper_triangle(observations[:, 4:]),
        lambda k: f"{path}, observation {k}",
    )
    return LandmarkLog(
        name=path.stem,
        start=np.zeros(3),
        time=np.arange(steps + 1, dtype=np.float64),
        motion="compose",
        control=odometry,
        control_covariance=from_upper_triangle(upper),
        observation_pose=observations[:, 0].astype(np.int64),
        observation=observation,
        observation_covariance=observation_covariance,
        landmark=observations[:, 1].astype(np.int64),
    )
