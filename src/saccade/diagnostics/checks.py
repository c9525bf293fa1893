"""Runs all checks of a drive."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from saccade.diagnostics.calibration import (
    check_extrinsics,
    check_intrinsics,
    check_rectification,
    check_rotation,
)
from saccade.diagnostics.findings import CheckReport, Finding
from saccade.diagnostics.odometry import (
    check_direction,
    check_jumps,
    check_translations,
    check_truth,
    check_turns,
)
from saccade.diagnostics.recording import (
    check_egomotion,
    check_images,
    check_planarity,
    check_timestamps,
)
from saccade.diagnostics.survey import (
    MIN_STEPS,
    Lag,
    MotionSeries,
    Survey,
    fit,
    lag_of,
    series_of,
    survey_drive,
)
from saccade.errors import DriveError, require
from saccade.frames import Drive

ORDER = ("error", "warning", "note")


def check_drive(
    drive: Drive, frames: int = 300, progress: Callable[[int, int], None] | None = None
) -> CheckReport:
    """Check a drive for errors before it is mapped.

    Args:
        drive: the drive.
        frames: number of images to inspect, at least 40; of a longer drive, spread over it.
        progress: called with the number of frames inspected, and of all.

    Returns:
        The findings, the most severe first.

    Raises:
        ConfigError: too few frames to inspect.
        DriveError: the drive has fewer than two frames, so that nothing moves in it.
    """
    require(frames >= 40, "frames", "at least 40", frames)
    if len(drive.control) == 0:
        raise DriveError(f"{drive.name}: expected a drive of at least two frames, found fewer")
    return report_on(drive, survey_drive(drive, frames, progress))


def report_on(drive: Drive, survey: Survey) -> CheckReport:
    """Check a drive that was surveyed."""
    if drive.scale != "metric":  # its controls are an assumption, no odometry
        drive = replace(drive, control=0 * drive.control)
    series, lag = series_of(drive, survey), lag_of(drive, survey)
    findings = [
        *check_images(drive, survey),
        *check_egomotion(survey),
        *check_intrinsics(drive.camera),
        *check_timestamps(drive),
        *check_rectification(survey),
    ]
    odometry, extrinsics = _motion_findings(drive, series, lag)
    findings += odometry + extrinsics
    agree = all(finding.severity == "note" for finding in odometry + extrinsics)
    if not extrinsics and all(finding.severity != "error" for finding in odometry):
        findings += check_truth(drive, survey, agree)
    if not drive.control[:, :2].any():
        what = "there are no translations by odometry to compare the images with"
        advice = "Provide odometry.csv if odometry was recorded"
        findings.append(Finding("note", "no odometry", what, advice, 0.0, "steps"))
    if not extrinsics:  # wrong extrinsics make turns look like tilt
        findings += check_planarity(drive, survey)
    findings.sort(key=lambda finding: ORDER.index(finding.severity))
    figures = _figures(survey, series, lag)
    return CheckReport(drive.name, len(drive), len(survey), tuple(findings), figures)


def _motion_findings(
    drive: Drive, series: MotionSeries, lag: Lag | None
) -> tuple[list[Finding], list[Finding]]:
    """Findings on odometry and on extrinsics, without those that follow from others."""
    if not drive.control.any():
        return [], []
    odometry, moving = [*check_jumps(drive), *check_turns(series, lag)], series.moving
    if len(moving) < MIN_STEPS:
        return odometry, []
    if rotation := [*check_rotation(moving)]:
        return odometry, rotation
    if direction := [*check_direction(moving)]:
        return odometry + direction, []
    return [*odometry, *check_translations(series)], [*check_extrinsics(moving, drive.camera)]


def _figures(survey: Survey, series: MotionSeries, lag: Lag | None) -> dict[str, Any]:
    """Measurements by name."""
    known = np.isfinite(survey.rotation[1:, 0])
    figures: dict[str, Any] = {
        "points_per_frame": float(np.mean(survey.points)),
        "motions_known_percent": 100 * float(known.mean()) if len(known) else 0.0,
    }
    if lag is not None:
        figures |= {"turn_correlation": lag.correlation, "clock_lag_frames": lag.frames}
    steps = np.stack([series.rotation[:, 2], series.duration], 1)
    turn = fit(steps, series.odometry[:, 2])
    if turn is not None:
        figures |= {
            "turn_scale": float(turn.value[0]),
            "turn_bias_deg_per_s": float(np.rad2deg(turn.value[1])),
            "turn_noise_deg": float(np.rad2deg(turn.sigma)),
        }
    if series.metric.any():
        translation = fit(series.translation[:, :1], series.odometry[:, 0])
        if translation is not None:
            figures |= {
                "translation_scale": float(translation.value[0]),
                "translation_noise_m": translation.sigma,
            }
    return figures
