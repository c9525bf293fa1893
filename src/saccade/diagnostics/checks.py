"""All checks of a drive, one after the other."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from saccade.diagnostics.extrinsics import check_lateral_extrinsics, check_rotation
from saccade.diagnostics.findings import CheckReport, Finding
from saccade.diagnostics.images import check_camera, check_images, check_motion
from saccade.diagnostics.motion_series import Lag, Series, has_odometry, lag_of, series_of
from saccade.diagnostics.odometry import check_jumps, check_translations, check_turns
from saccade.diagnostics.planarity import check_ground
from saccade.diagnostics.robust_line import fit
from saccade.diagnostics.stereo import check_stereo
from saccade.diagnostics.survey import Survey, survey_drive
from saccade.diagnostics.timestamps import check_clock
from saccade.errors import require
from saccade.frames import Drive

ORDER = ("error", "warning", "note")


@dataclass(frozen=True)
class CheckConfig:
    """How closely to look."""

    frames: int = 300
    """Images to look at; of a longer drive, stretches that are spread over it."""

    def __post_init__(self) -> None:
        require(40 <= self.frames <= 10**6, "frames", "40 to 1e6", self.frames)


def check_drive(
    drive: Drive,
    config: CheckConfig = CheckConfig(),
    progress: Callable[[int, int], None] | None = None,
) -> CheckReport:
    """Look through a drive for what would spoil a run.

    Args:
        drive: to be checked.
        config: how closely to look.
        progress: told the number of frames looked at, and of all.

    Returns:
        What was found, the worst first.
    """
    return report_on(drive, survey_drive(drive, config.frames, progress))


def report_on(drive: Drive, survey: Survey) -> CheckReport:
    """What is wrong with a drive of which this was seen."""
    series, lag = series_of(drive, survey), lag_of(drive, survey)
    findings = [
        *check_images(drive, survey),
        *check_motion(survey),
        *check_camera(drive.camera),
        *check_clock(drive),
        *check_stereo(survey),
    ]
    motion = _of_motion(drive, series, lag) if has_odometry(drive) else []
    findings += motion
    if not drive.control[:, :2].any():
        findings.append(_without_ways())
    if not any(finding.check.startswith("camera") for finding in motion):
        findings += check_ground(drive, survey)  # a camera that is askew makes turns look like tilt
    findings.sort(key=lambda finding: ORDER.index(finding.severity))
    return CheckReport(
        drive.name, len(drive), len(survey), tuple(findings), _figures(survey, series, lag)
    )


def _of_motion(drive: Drive, series: Series, lag: Lag | None) -> list[Finding]:
    """Odometry and mounting; what follows from a finding is not said again."""
    findings = [*check_jumps(drive), *check_turns(series, lag)]
    askew = check_rotation(series)
    if askew:
        return [*findings, *askew]
    ways = check_translations(series)
    if any(finding.check in ("way sign", "standing") for finding in ways):
        return [*findings, *ways]
    return [*findings, *ways, *check_lateral_extrinsics(series, drive.camera)]


def _without_ways() -> Finding:
    return Finding(
        "note",
        "no odometry",
        "nobody says how far the robot went: there is nothing to compare the images with",
        "Write an odometry.csv if there is any",
        0.0,
        "steps",
    )


def _figures(survey: Survey, series: Series, lag: Lag | None) -> dict[str, Any]:
    """What was measured on the way."""
    figures: dict[str, Any] = {
        "points_per_frame": float(np.mean(survey.points)),
        "motions_known_percent": 100 * float(np.isfinite(survey.rotation[1:, 0]).mean())
        if len(survey) > 1
        else 0.0,
    }
    if lag is not None:
        figures |= {"turn_correlation": lag.agreement, "clock_lag_frames": lag.frames}
    steps = np.stack([series.rotation[:, 2], series.duration], 1)
    turn = fit(steps, series.odometry[:, 2])
    if turn is not None:
        figures |= {
            "turn_scale": float(turn.value[0]),
            "turn_drift_deg_per_s": float(np.rad2deg(turn.value[1])),
            "turn_noise_deg": float(np.rad2deg(turn.sigma)),
        }
    way = fit(series.translation[:, :1], series.odometry[:, 0]) if series.metric else None
    if way is not None:
        figures |= {"way_scale": float(way.value[0]), "way_noise_m": way.sigma}
    return figures
