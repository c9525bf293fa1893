"""How a camera is mounted on a robot, and how it turns there, from its poses over time."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from saccade.datasets.poses import Poses
from saccade.errors import DriveError
from saccade.frames import Camera, CameraTurn, Frame
from saccade.types import FloatArray

STILL = 1e-4
"""Rotations that differ by less, in radians, are those of a camera that does not turn."""
MAX_ROLL = 0.02
"""Radians by which a camera that pans and tilts may roll about its optical axis."""
MAX_SHIFT = 0.01
"""Metres by which its optical center may move on the robot without a remark."""


@dataclass(frozen=True, eq=False)
class Mounting:
    """Pose of a camera in the frame of the robot, and its turns from there."""

    position: FloatArray
    """(3,) meters."""
    rotation: FloatArray
    """(3, 3) from the frame of the camera into that of the robot."""
    turns: tuple[CameraTurn, ...] | None = None
    """Of each frame of the drive; None of a camera that does not turn."""
    assumptions: tuple[str, ...] = ()
    """What does not hold exactly, one line each."""

    def mount(self, camera: Camera) -> Camera:
        """The camera in this place."""
        return replace(camera, position=self.position, rotation=self.rotation)

    def turned(self, load: Callable[[int], Frame]) -> Callable[[int], Frame]:
        """A `Drive.load` whose frames know how the camera was turned."""
        turns = self.turns
        return load if turns is None else lambda i: replace(load(i), turn=turns[i])


def mounting_of(poses: Poses, name: str) -> Mounting:
    """Mounting of a camera by its poses in the frame of the robot.

    Pan and tilt are the azimuth and elevation of the optical axis, so that without them the
    camera faces ahead.

    Args:
        poses: at each frame of the drive.
        name: of the recording, for messages.

    Raises:
        DriveError: the camera also rolls about its optical axis.
    """
    R = poses.rotation
    if _angle(R, R[0]) < STILL:
        return Mounting(poses.position[0].copy(), R[0].copy())
    x, y, z = R[:, :, 2].T  # of the optical axis
    directions = zip(np.arctan2(y, x).tolist(), np.arcsin(z.clip(-1, 1)).tolist(), strict=True)
    turns = tuple(CameraTurn(pan, tilt) for pan, tilt in directions)
    mounted = np.stack([turn.rotation for turn in turns]).transpose(0, 2, 1) @ R
    roll = _angle(mounted, mounted[0])
    if roll > MAX_ROLL:
        raise DriveError(
            f"{name}: expected a camera that pans and tilts, found one that also rolls about its "
            f"optical axis, by {roll:.2g} rad"
        )
    center = poses.position.mean(0)
    shift = float(np.linalg.norm(poses.position - center, axis=1).max())
    assumptions: tuple[str, ...] = ()
    if shift > MAX_SHIFT:
        assumptions = (
            f"{name}: the optical center moves by up to {shift:.2f} m on the robot while the "
            "camera turns; its mean position is used",
        )
    return Mounting(center, mounted[0], turns, assumptions)


def _angle(rotations: FloatArray, other: FloatArray) -> float:
    """Largest angle in radians between rotations (n, 3, 3) and another (3, 3)."""
    chord = np.linalg.norm(rotations - other, axis=(1, 2)).max() / np.sqrt(8)
    return float(2 * np.arcsin(min(chord, 1.0)))
