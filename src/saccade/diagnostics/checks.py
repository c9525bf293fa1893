"""Runs all checks of a drive."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from saccade.diagnostics.findings import CheckReport, Finding
from saccade.diagnostics.odometry import (
    TURNING,
    check_direction,
    check_jumps,
    check_translations,
    check_truth,
    check_turns,
)
from saccade.diagnostics.recording import (
    check_egomotion,
    check_images,
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
from saccade.frames import Camera, Drive

MIN_DISPARITIES = 200
"""Minimum number of disparities for a check of the rectification."""
MAX_NEGATIVE = 0.05
"""Maximum fraction of negative disparities that wrong matches can explain."""
MAX_ROW_OFFSET = 1.0
"""Maximum difference in pixels between the rows of a point in both images."""
MAX_ANGLE = np.deg2rad(3.0)
"""Maximum error of yaw and pitch, in radians."""
GROSS_ANGLE = np.deg2rad(30.0)
"""Minimum angle in radians for exchanged axes."""
MAX_OFFSET = 0.15
"""Maximum error of the forward position in meters; a robot's center of rotation varies."""
MAX_RELATIVE_OFFSET = 0.6
"""Maximum relative error of the forward position."""
SLIP_PER_ACCELERATION = 0.006
"""Standard deviation of the side-slip angle per lateral acceleration, in radians per m/s^2. The
true poses of KITTI 00 to 09 have .003 to .008."""
SLIP_SIGMAS = 3.0
"""Maximum side-slip in turns, in standard deviations; it has the same effect as a camera at another
position."""


def check_intrinsics(camera: Camera) -> Iterator[Finding]:
    """Implausible intrinsics."""
    offset = 100 * max(
        abs(camera.cx - (camera.width - 1) / 2) / camera.width,
        abs(camera.cy - (camera.height - 1) / 2) / camera.height,
    )
    field_of_view = float(2 * np.rad2deg(np.arctan(camera.width / 2 / camera.fx)))
    if offset > 15:
        what = f"the principal point is {offset:.0f} % of the image away from its center"
        yield Finding.of("principal point", what, offset)
    if not 20 < field_of_view < 140:
        what = f"the focal length gives a field of view of {field_of_view:.0f} deg"
        yield Finding.of("field of view", what, field_of_view)
    if abs(camera.fx / camera.fy - 1) > 0.1:
        what = f"the focal lengths in x and y differ: {camera.fx:.0f} and {camera.fy:.0f} px"
        yield Finding.of("focal lengths", what, camera.fx / camera.fy)


def check_rectification(survey: Survey) -> Iterator[Finding]:
    """Checks for swapped left and right images, and for misaligned rows."""
    if len(survey.disparity) < MIN_DISPARITIES:
        return
    negative = float(np.mean(survey.disparity < -1.0))
    if negative > MAX_NEGATIVE:
        swapped = negative > 0.5
        what = (
            f"{100 * negative:.0f} % of the points have a negative disparity: they are further "
            "right in the right image"
        )
        if swapped:
            advice = "Swap the left and the right images"
            yield Finding.of(
                "disparity sign", what, 100 * negative, advice=advice, severity="error"
            )
        else:
            yield Finding.of("disparity sign", what, 100 * negative)
    rows = survey.row_offset[np.isfinite(survey.row_offset)]
    offset = float(np.median(np.abs(rows))) if len(rows) >= MIN_DISPARITIES else 0.0
    if offset > MAX_ROW_OFFSET:
        what = f"the same points are {offset:.1f} px higher or lower in the right image (median)"
        yield Finding.of("rows", what, offset)


def check_rotation(moving: MotionSeries) -> Iterator[Finding]:
    """Checks for exchanged or reversed axes of the camera."""
    moving = moving[np.linalg.norm(moving.translation, axis=1) > 0]
    if len(moving) < MIN_STEPS:
        return
    length = np.linalg.norm(moving.translation, axis=1)[:, None]
    sign = np.sign(moving.odometry[:, :1])
    direction = np.median(sign * moving.translation / length, 0)
    direction /= max(float(np.linalg.norm(direction)), 1e-12)
    angle = float(np.arccos(np.clip(direction[0], -1, 1)))
    if GROSS_ANGLE < angle < np.pi - GROSS_ANGLE:  # `check_direction` reports backward motion
        vector = ", ".join(f"{each:.2f}" for each in direction)
        what = (
            f"when the robot moves ahead, the camera moves {np.rad2deg(angle):.0f} deg away from "
            f"it: along ({vector}) ahead, left, up"
        )
        yield Finding.of("camera rotation", what, float(np.rad2deg(angle)))


def check_extrinsics(moving: MotionSeries, camera: Camera) -> Iterator[Finding]:
    """Checks yaw and pitch, and the position ahead of the center of rotation, for small errors."""
    ahead, left, up = moving.translation.T
    left, turn = left - moving.odometry[:, 1], moving.rotation[:, 2]
    for check, A, offset, sides in (
        ("camera yaw", np.stack([ahead, turn], 1), left, ("left", "right")),
        ("camera pitch", ahead[:, None], up, ("up", "down")),
    ):
        fitted = fit(A, offset)
        if fitted is not None and fitted.differs(0, 0.0, float(np.tan(MAX_ANGLE))):
            angle = float(np.rad2deg(np.arctan(fitted.value[0])))
            side = sides[1] if angle > 0 else sides[0]
            what = f"the camera is turned {abs(angle):.1f} deg further {side} than camera.rotation"
            advice = f"Turn camera.rotation {side} by this angle"
            yield Finding.of(check, what, angle, advice=advice)
    speed = moving.odometry[:, 0] / moving.duration
    turning = np.abs(turn) > TURNING * moving.duration  # outside turns the errors are correlated
    if turning.sum() < MIN_STEPS:
        return
    fitted, position = fit(np.stack([turn, ahead], 1), left), float(camera.position[0])
    slip = SLIP_SIGMAS * SLIP_PER_ACCELERATION * float(np.median(np.square(speed[turning])))
    tolerance = max(MAX_OFFSET, MAX_RELATIVE_OFFSET * abs(position), slip)
    if fitted is not None and fitted.differs(0, position, tolerance):
        what = (
            f"in turns the camera moves as if it were {fitted.value[0]:.2f} m ahead of the robot's "
            f"origin (within {2 * fitted.error[0]:.2f}), camera.position is {position:.2f} m"
        )
        yield Finding.of("camera position", what, float(fitted.value[0]))


ORDER = ("error", "warning", "note")


def check_drive(
    drive: Drive, frames: int = 300, progress: Callable[[int, int], None] | None = None
) -> CheckReport:
    """Checks a drive for errors before mapping.

    Args:
        drive: the drive.
        frames: number of images to inspect, at least 40, evenly spaced over the drive.
        progress: function of the number of frames inspected and the total.

    Returns:
        The findings, the most severe first.

    Raises:
        ConfigError: too few frames to inspect.
        DriveError: the drive has fewer than two frames.
    """
    require(frames >= 40, "frames", "at least 40", frames)
    if len(drive.control) == 0:
        raise DriveError(f"{drive.name}: expected a drive of at least two frames, found fewer")
    return report_on(drive, survey_drive(drive, frames, progress))


def report_on(drive: Drive, survey: Survey) -> CheckReport:
    """Checks a drive, given its survey."""
    if drive.scale != "metric":  # the controls are an assumption, not odometry
        drive = replace(drive, control=0 * drive.control)
    control = drive.control
    series, lag = series_of(drive, survey, control), lag_of(drive, survey, control)
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
        what = "odometry has no translations to compare with the images"
        findings.append(Finding.of("no odometry", what, 0.0))
    findings.sort(key=lambda finding: ORDER.index(finding.severity))
    figures = _figures(survey, series, lag)
    return CheckReport(drive.name, len(drive), len(survey), tuple(findings), figures)


def _motion_findings(
    drive: Drive, series: MotionSeries, lag: Lag | None
) -> tuple[list[Finding], list[Finding]]:
    """Findings on odometry and on extrinsics, without consequences of other findings."""
    if not drive.control.any():
        return [], []
    odometry, moving = [*check_jumps(drive), *check_turns(series, lag)], series.moving
    if len(moving) < MIN_STEPS:
        return odometry, []
    if rotation := [*check_rotation(moving)]:
        return odometry, rotation
    if direction := [*check_direction(moving)]:
        return odometry + direction, []
    odometry += check_translations(series)
    return odometry, [*check_extrinsics(moving, drive.camera)]


def _figures(survey: Survey, series: MotionSeries, lag: Lag | None) -> dict[str, Any]:
    """Measurements by name."""
    known = np.isfinite(survey.rotation[1:, 0])
    figures: dict[str, Any] = {
        "points_per_frame": float(np.mean(survey.points)),
        "motions_known_percent": 100 * float(known.mean()) if len(known) else 0.0,
    }
    if lag is not None:
        figures |= {"turn_correlation": lag.correlation, "clock_lag_frames": lag.frames}
    turn = fit(np.stack([series.rotation[:, 2], series.duration], 1), series.odometry[:, 2])
    if turn is not None:
        figures["turn_scale"] = float(turn.value[0])
        figures["turn_bias_deg_per_s"] = float(np.rad2deg(turn.value[1]))
        figures["turn_noise_deg"] = float(np.rad2deg(turn.sigma))
    translation = fit(series.translation[:, :1], series.odometry[:, 0])
    if translation is not None and series.metric.any():
        figures["translation_scale"] = float(translation.value[0])
        figures["translation_noise_m"] = translation.sigma
    return figures
