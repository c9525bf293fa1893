"""The motion of a robot on the ground, and that of its camera: each from the other."""

from typing import NamedTuple, TypeAlias

import numpy as np

from saccade.frames import Camera
from saccade.slam.models import heading_rotation
from saccade.types import FloatArray

CameraPose: TypeAlias = tuple[FloatArray, FloatArray]
"""R (3, 3) and t (3,) in meters: points X of the first camera frame become R X + t."""


class RobotMotion(NamedTuple):
    """The motion of the robot of a `CameraPose`; with further axes in front, of several."""

    control: FloatArray
    """(3,) meters ahead and to the left, radians turned, on the ground plane."""
    off_plane: FloatArray
    """(3,) change of height in meters, of roll (to the right) and pitch (down) in radians."""
    jacobian: FloatArray
    """(6, 6) of both by the camera's rotation vector and translation, to first order in roll and
    pitch."""


def robot_motion(
    camera: Camera, R: FloatArray, t: FloatArray, before: Camera | None = None
) -> RobotMotion:
    """The robot's motion of a `CameraPose` of R (3, 3) and t (3,).

    `camera` is as it is turned after the motion, `before` as before it, by default the same.
    """
    return mounted_motion(R, t, camera.rotation, (before or camera).rotation, camera.position)


def mounted_motion(
    R: FloatArray, t: FloatArray, after: FloatArray, before: FloatArray, position: FloatArray
) -> RobotMotion:
    """`robot_motion` of a camera of rotations (..., 3, 3) after and before, at a position (3,)."""
    rotation = after @ R @ _transposed(before)
    back = _transposed(rotation)
    moved = (after @ t[..., None])[..., 0] + position
    into, shift = back @ after, moved - rotation @ position
    x, y, z = np.moveaxis(-(back @ shift[..., None])[..., 0], -1, 0)
    turn = np.arctan2(rotation[..., 0, 1], rotation[..., 0, 0])
    roll = np.arctan2(rotation[..., 1, 2], rotation[..., 2, 2])
    pitch = np.arctan2(-rotation[..., 0, 2], np.hypot(rotation[..., 0, 0], rotation[..., 0, 1]))
    J = np.zeros((*t.shape[:-1], 6, 6))
    J[..., [0, 1, 3], :3] = -back @ cross_matrix(moved) @ after
    J[..., [0, 1, 3], 3:] = J[..., [4, 5, 2], :3] = -into
    return RobotMotion(np.stack([x, y, turn], -1), np.stack([z, roll, pitch], -1), J)


def step_motions(
    poses: CameraPose, mount: FloatArray, position: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Motions (n - 1, 6) of the robot between n `CameraPose`s (n, 3, 3), (n, 3) from one frame.

    Each is control and off-plane motion. The camera has rotations `mount` (n, 3, 3) and a position
    (3,) on the robot. Also returns their derivatives (n - 1, 6, 12) by rotation vector and
    translation of the pose before and of that after.
    """
    rotation, translation = poses
    R = rotation[1:] @ _transposed(rotation[:-1])
    turned = (R @ translation[:-1, :, None])[:, :, 0]
    motion = mounted_motion(R, translation[1:] - turned, mount[1:], mount[:-1], position)
    by_rotation, by_translation = motion.jacobian[:, :, :3], motion.jacobian[:, :, 3:]
    by_rotation = by_rotation + by_translation @ cross_matrix(turned)
    after = np.concatenate([by_rotation, by_translation], 2)
    before = np.concatenate([by_rotation @ R, by_translation @ R], 2)
    return np.concatenate(motion[:2], 1), np.concatenate([-before, after], 2)


def camera_motion(camera: Camera, control: FloatArray, before: Camera | None = None) -> CameraPose:
    """The `CameraPose` of a control (3,) on the ground plane; `before` as for `robot_motion`."""
    before = before or camera
    rotation = heading_rotation(-float(control[2]))
    translation = -rotation @ np.append(control[:2], 0.0)
    R = camera.rotation.T @ rotation @ before.rotation
    return R, camera.rotation.T @ (translation - camera.position + rotation @ before.position)


def cross_matrix(v: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices that multiply as the cross product by v (..., 3) does."""
    matrix = np.zeros((*v.shape, 3))
    matrix[..., [2, 0, 1], [1, 2, 0]] = v
    return matrix - _transposed(matrix)


def _transposed(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2)
