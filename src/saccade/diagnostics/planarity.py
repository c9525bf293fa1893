"""Whether the robot stays on a plane, as the map takes for granted."""

import numpy as np

from saccade.diagnostics.findings import Finding
from saccade.diagnostics.survey import Survey
from saccade.frames import Drive
from saccade.types import FloatArray

TILT = np.deg2rad(5.0)
"""Radians of pitch or roll from which distances on the plane are off by half a per cent and
points come to lie elsewhere."""
HEIGHT = 0.5
"""Metres of height that are worth a word."""
STEEP = 0.1
"""Height as a share of the way, above which the way on the plane is too short."""
SHORT = 2.0
"""Seconds over which turns by the images may be added up."""


def check_ground(drive: Drive, survey: Survey) -> list[Finding]:
    """Pitch, roll and height, by the truth if it is known, and else by the images."""
    if drive.truth_off_plane is not None and drive.truth is not None:
        known = drive.truth.time
        there = (known >= drive.time[0]) & (known <= drive.time[-1])
        return _by_truth(drive.truth_off_plane[there], drive.truth.pose[there])
    return _by_images(drive, survey)


def _by_truth(lift: FloatArray, pose: FloatArray) -> list[Finding]:
    if len(lift) == 0:
        return []
    tilt = np.abs(lift[:, 1:] - np.median(lift[:, 1:], 0)).max(1)
    findings = _tilted(float(np.quantile(tilt, 0.95)), "by the truth")
    rise = float(np.ptp(lift[:, 0]))
    way = float(np.hypot(*np.diff(pose[:, :2], axis=0).T).sum())
    if rise > HEIGHT:
        steep = rise > STEEP * way
        findings.append(
            Finding(
                "warning" if steep else "note",
                "height",
                f"the height changes by {rise:.1f} m over a way of {way:.0f} m, by the truth",
                "The map is flat: compare it with the truth seen from above",
                rise,
                "m",
            )
        )
    return findings


def _by_images(drive: Drive, survey: Survey) -> list[Finding]:
    """From roll and pitch added up over short stretches, where images do not drift yet."""
    period = float(np.median(np.diff(drive.time))) if len(drive) > 1 else 0.0
    if period <= 0:
        return []
    size = max(round(SHORT / period), 2)
    swings = [
        np.abs(np.cumsum(stretch[:, :2], 0)).max()
        for stretch in _stretches(survey, size)
        if np.isfinite(stretch).all()
    ]
    if len(swings) < 3:
        return []
    return _tilted(float(np.quantile(swings, 0.75)), f"by the images within {SHORT:g} s")


def _stretches(survey: Survey, size: int) -> list[FloatArray]:
    """Turns (size, 3) of frames that follow each other."""
    return [
        survey.rotation[k : k + size]
        for k in range(1, len(survey) - size + 1, size)
        if survey.frame[k + size - 1] - survey.frame[k - 1] == size
    ]


def _tilted(tilt: float, how: str) -> list[Finding]:
    if tilt <= TILT:
        return []
    return [
        Finding(
            "warning",
            "tilt",
            f"the robot is tilted by {np.rad2deg(tilt):.1f} deg, {how}, but its map is flat",
            "Ranges and bearings are off by it: make the noise of observations larger, or level "
            "the camera",
            float(np.rad2deg(tilt)),
            "deg",
        )
    ]
