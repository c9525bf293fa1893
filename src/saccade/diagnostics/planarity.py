"""Planarity: whether the robot stays on the plane that the map assumes."""

from collections.abc import Iterator

import numpy as np

from saccade.diagnostics.findings import Finding
from saccade.diagnostics.survey import Survey
from saccade.frames import Drive
from saccade.types import FloatArray

MAX_TILT = np.deg2rad(5.0)
"""Radians of pitch or roll from which distances on the plane are off by half a per cent."""
MAX_HEIGHT = 0.5
"""Metres by which the height may change."""
MAX_GRADIENT = 0.1
"""Change of height over the length of the path, from which distances on the plane are too short."""
INTEGRATION_TIME = 2.0
"""Seconds over which rotations by the images are integrated."""


def check_planarity(drive: Drive, survey: Survey) -> Iterator[Finding]:
    """Pitch, roll and height: by the ground truth if there is one, else by the images."""
    if drive.truth_off_plane is not None and drive.truth is not None:
        time = drive.truth.time
        known = (time >= drive.time[0]) & (time <= drive.time[-1])
        return _by_truth(drive.truth_off_plane[known], drive.truth.pose[known])
    return _by_images(drive, survey)


def _by_truth(off_plane: FloatArray, pose: FloatArray) -> Iterator[Finding]:
    if len(off_plane) == 0:
        return
    tilt = np.abs(off_plane[:, 1:] - np.median(off_plane[:, 1:], 0)).max(1)
    yield from _tilt_finding(float(np.quantile(tilt, 0.95)), "by the ground truth")
    rise = float(np.ptp(off_plane[:, 0]))
    length = float(np.hypot(*np.diff(pose[:, :2], axis=0).T).sum())
    if rise > MAX_HEIGHT:
        yield Finding(
            "warning" if rise > MAX_GRADIENT * length else "note",
            "height",
            f"the height changes by {rise:.1f} m over {length:.0f} m, by the ground truth",
            "The map is flat: compare it with the projection of the ground truth",
            rise,
            "m",
        )


def _by_images(drive: Drive, survey: Survey) -> Iterator[Finding]:
    """From roll and pitch integrated over short stretches, before their drift dominates."""
    period = float(np.median(np.diff(drive.time))) if len(drive) > 1 else 0.0
    if period <= 0:
        return
    size = max(round(INTEGRATION_TIME / period), 2)
    tilts = [
        np.abs(np.cumsum(survey.rotation[k : k + size, :2], 0)).max()
        for k in range(1, len(survey) - size + 1, size)
        if survey.frame[k + size - 1] - survey.frame[k - 1] == size
        and np.isfinite(survey.rotation[k : k + size]).all()
    ]
    if len(tilts) >= 3:
        source = f"by the images within {INTEGRATION_TIME:g} s"
        yield from _tilt_finding(float(np.quantile(tilts, 0.75)), source)


def _tilt_finding(tilt: float, source: str) -> Iterator[Finding]:
    if tilt > MAX_TILT:
        yield Finding(
            "warning",
            "tilt",
            f"the robot is tilted by {np.rad2deg(tilt):.1f} deg, {source}, but its map is flat",
            "Ranges and bearings are off by it: make the noise of observations larger, or level "
            "the camera",
            float(np.rad2deg(tilt)),
            "deg",
        )
