"""Where the camera is on the robot, and where it looks, against how it moves."""

import numpy as np

from saccade.diagnostics.findings import Finding
from saccade.diagnostics.motion_series import Series
from saccade.diagnostics.robust_line import fit
from saccade.frames import Camera

ASKEW = np.deg2rad(3.0)
"""Radians by which the camera may look beside the way."""
WRONG = np.deg2rad(30.0)
"""Radians from which it is mounted otherwise than was said."""
PLACE = 0.15
"""Metres by which its place may be off."""
SHARE = 0.6
"""The same as a share of its distance: a robot's own origin, about which it turns, is vague."""


def check_rotation(series: Series) -> list[Finding]:
    """Whether the camera looks quite elsewhere than is said."""
    length = np.linalg.norm(series.translation, axis=1)
    moving = series.moving & (length > 0)
    if len(series) < 20 or moving.sum() < 20:
        return []
    ahead = np.sign(series.odometry[moving, 0])[:, None]
    direction = np.median(ahead * series.translation[moving] / length[moving, None], 0)
    direction /= max(float(np.linalg.norm(direction)), 1e-12)
    off = float(np.arccos(np.clip(direction[0], -1, 1)))
    if not WRONG < off < np.pi - WRONG:
        return []  # straight back is not told from a way with the wrong sign, see `check_ways`
    words = ", ".join(f"{each:.2f}" for each in direction)
    return [
        Finding(
            "error",
            "camera rotation",
            f"when the robot goes ahead, the camera moves {np.rad2deg(off):.0f} deg away from "
            f"ahead: along ({words}) ahead, left, up",
            "Look at camera.rotation: it turns vectors of the camera (x right, y down, z along "
            "the optical axis) into the robot's (x ahead, y left, z up)",
            float(np.rad2deg(off)),
            "deg",
        )
    ]


def check_lateral_extrinsics(series: Series, camera: Camera) -> list[Finding]:
    """Whether the camera looks a little elsewhere, or is at another place, than is said."""
    if len(series) < 20 or series.moving.sum() < 20:
        return []
    return [*_check_askew(series), *_check_lever(series, camera)]


def _check_askew(series: Series) -> list[Finding]:
    """Looking a little to the side, or up or down, of the way that is driven."""
    moving = series.moving
    ahead = series.translation[moving, 0]
    findings = []
    for column, axis, check in (
        (1, ("left", "right"), "camera yaw"),
        (2, ("up", "down"), "camera pitch"),
    ):
        A = ahead[:, None]
        side = series.translation[moving, column]
        if column == 1:
            A = np.stack([ahead, series.rotation[moving, 2]], 1)
            side = side - series.odometry[moving, 1]
        found = fit(A, side)
        if found is None or not found.differs(0, 0.0, float(np.tan(ASKEW))):
            continue
        angle = float(np.rad2deg(np.arctan(found.value[0])))
        toward = axis[1] if angle > 0 else axis[0]
        findings.append(
            Finding(
                "warning",
                check,
                f"the camera looks {abs(angle):.1f} deg further {toward} than camera.rotation says",
                f"Turn camera.rotation by so much {toward}",
                angle,
                "deg",
            )
        )
    return findings


def _check_lever(series: Series, camera: Camera) -> list[Finding]:
    """How far the camera swings to the side while the robot turns: its place ahead of the axle."""
    moving = series.moving
    turn = series.rotation[moving, 2]
    side = series.translation[moving, 1] - series.odometry[moving, 1]
    found = fit(np.stack([turn, series.translation[moving, 0]], 1), side)
    place = float(camera.position[0])
    if found is None or not found.differs(0, place, max(PLACE, SHARE * abs(place))):
        return []
    return [
        Finding(
            "warning",
            "camera place",
            f"while the robot turns the camera swings as if it were {found.value[0]:.2f} m ahead "
            f"of the robot's origin (within {2 * found.error[0]:.2f}), camera.position says "
            f"{place:.2f} m",
            "Look at camera.position: it is where the camera is in the robot's frame, not where "
            "the robot is in the camera's",
            float(found.value[0]),
            "m",
        )
    ]
