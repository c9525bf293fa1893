"""Calibration: intrinsics, rectification of a stereo rig, and extrinsics."""

from collections.abc import Iterator

import numpy as np

from saccade.diagnostics.findings import Finding
from saccade.diagnostics.motion_series import MIN_STEPS, MotionSeries
from saccade.diagnostics.robust_regression import fit
from saccade.diagnostics.survey import Survey
from saccade.frames import Camera

MIN_DISPARITIES = 200
"""Points from which something is said."""
MAX_NEGATIVE = 0.05
"""Fraction of the points with a negative disparity: wrong matches."""
MAX_ROW_OFFSET = 1.0
"""Pixels between the rows of a point in both images."""
MAX_ANGLE = np.deg2rad(3.0)
"""Radians by which yaw and pitch of the camera may be off."""
GROSS_ANGLE = np.deg2rad(30.0)
"""Radians from which axes are mixed up."""
MAX_OFFSET = 0.15
"""Metres by which the position may be off."""
MAX_RELATIVE_OFFSET = 0.6
"""The same as a fraction of the position: a robot's center of rotation is uncertain."""


def check_intrinsics(camera: Camera) -> Iterator[Finding]:
    """Intrinsics that hardly any camera has."""
    offset = 100 * max(
        abs(camera.cx - (camera.width - 1) / 2) / camera.width,
        abs(camera.cy - (camera.height - 1) / 2) / camera.height,
    )
    field_of_view = float(2 * np.rad2deg(np.arctan(camera.width / 2 / camera.fx)))
    if offset > 15:
        yield Finding(
            "warning",
            "principal point",
            f"the principal point lies {offset:.0f} % of the image off its center",
            "Check whether the calibration is of images of another size or cut",
            offset,
            "%",
        )
    if not 20 < field_of_view < 140:
        yield Finding(
            "warning",
            "field of view",
            f"the focal length makes a field of view of {field_of_view:.0f} deg",
            "Check whether the calibration is of images of another size",
            field_of_view,
            "deg",
        )
    if abs(camera.fx / camera.fy - 1) > 0.1:
        yield Finding(
            "warning",
            "focal lengths",
            f"the focal lengths in x and y differ: {camera.fx:.0f} and {camera.fy:.0f} px",
            "Check whether the images were resized in one direction",
            camera.fx / camera.fy,
            "ratio",
        )


def check_rectification(survey: Survey) -> Iterator[Finding]:
    """Whether left and right are exchanged, and the rows aligned."""
    if len(survey.disparity) < MIN_DISPARITIES:
        return
    negative = float(np.mean(survey.disparity < -1.0))
    if negative > MAX_NEGATIVE:
        swapped = negative > 0.5
        yield Finding(
            "error" if swapped else "warning",
            "disparity sign",
            f"{100 * negative:.0f} % of the points have a negative disparity: they lie further "
            "right in the right image",
            "Exchange the left and the right images"
            if swapped
            else "Check the rectification, and whether both images are of the same time",
            100 * negative,
            "%",
        )
    rows = survey.row_offset[np.isfinite(survey.row_offset)]
    offset = float(np.median(np.abs(rows))) if len(rows) >= MIN_DISPARITIES else 0.0
    if offset > MAX_ROW_OFFSET:
        yield Finding(
            "warning",
            "rows",
            f"the same points lie {offset:.1f} px higher or lower in the right image (median)",
            "Rectify the images, or calibrate again",
            offset,
            "px",
        )


def check_rotation(series: MotionSeries) -> Iterator[Finding]:
    """Gross errors of the rotation."""
    length = np.linalg.norm(series.translation, axis=1)
    moving = series.moving & (length > 0)
    if len(series) < MIN_STEPS or moving.sum() < MIN_STEPS:
        return
    sign = np.sign(series.odometry[moving, 0])[:, None]
    direction = np.median(sign * series.translation[moving] / length[moving, None], 0)
    direction /= max(float(np.linalg.norm(direction)), 1e-12)
    angle = float(np.arccos(np.clip(direction[0], -1, 1)))
    if GROSS_ANGLE < angle < np.pi - GROSS_ANGLE:  # backward is `check_direction`'s
        vector = ", ".join(f"{each:.2f}" for each in direction)
        yield Finding(
            "error",
            "camera rotation",
            f"when the robot moves ahead, the camera moves {np.rad2deg(angle):.0f} deg away from "
            f"it: along ({vector}) ahead, left, up",
            "Check camera.rotation: it rotates vectors of the camera (x right, y down, z along "
            "the optical axis) into the robot's frame (x ahead, y left, z up)",
            float(np.rad2deg(angle)),
            "deg",
        )


def check_extrinsics(series: MotionSeries, camera: Camera) -> Iterator[Finding]:
    """Smaller errors of yaw, pitch, and the position ahead of the center of rotation."""
    moving = series.moving
    if len(series) < MIN_STEPS or moving.sum() < MIN_STEPS:
        return
    ahead, turn = series.translation[moving, 0], series.rotation[moving, 2]
    left = series.translation[moving, 1] - series.odometry[moving, 1]
    up = series.translation[moving, 2]
    for check, A, offset, sides in (
        ("camera yaw", np.stack([ahead, turn], 1), left, ("left", "right")),
        ("camera pitch", ahead[:, None], up, ("up", "down")),
    ):
        fitted = fit(A, offset)
        if fitted is not None and fitted.differs(0, 0.0, float(np.tan(MAX_ANGLE))):
            angle = float(np.rad2deg(np.arctan(fitted.value[0])))
            side = sides[1] if angle > 0 else sides[0]
            yield Finding(
                "warning",
                check,
                f"the camera is turned {abs(angle):.1f} deg further {side} than camera.rotation",
                f"Turn camera.rotation {side} by this angle",
                angle,
                "deg",
            )
    fitted, position = fit(np.stack([turn, ahead], 1), left), float(camera.position[0])
    tolerance = max(MAX_OFFSET, MAX_RELATIVE_OFFSET * abs(position))
    if fitted is not None and fitted.differs(0, position, tolerance):
        yield Finding(
            "warning",
            "camera position",
            f"in turns the camera moves as if it were {fitted.value[0]:.2f} m ahead of the robot's "
            f"origin (within {2 * fitted.error[0]:.2f}), camera.position is {position:.2f} m",
            "Check camera.position: it is that of the camera in the robot's frame, not of the "
            "robot in the camera's",
            float(fitted.value[0]),
            "m",
        )
