"""Conversions between the motion of a robot on the ground and the motion of its camera."""

from typing import NamedTuple, TypeAlias

import numpy as np

from saccade.frames import Camera
from saccade.slam.filter.robot_models import heading_rotation
from saccade.types import FloatArray

CameraPose: TypeAlias = tuple[FloatArray, FloatArray]
"""Rotation R (3, 3) and translation t (3,) in meters: x' = R x + t in camera frames."""


class RobotMotion(NamedTuple):
    """Motion of the robot for a `CameraPose`, with Jacobian; further axes may be in front."""

    control: FloatArray
    """(3,) control on the ground plane: meters ahead, meters to the left, radians."""
    off_plane: FloatArray
    """(3,) changes of height in meters, of roll (to the right) and pitch (down) in radians."""
    jacobian: FloatArray
    """(6, 6) derivatives of control and off-plane motion by the camera's rotation vector and
    translation, to first order in roll and pitch."""


def robot_motion(
    camera: Camera, R: FloatArray, t: FloatArray, before: Camera | None = None
) -> RobotMotion:
    """Motion of the robot for a `CameraPose` of R (3, 3) and t (3,).

    `camera` is the camera after the motion, `before` the camera before it, if it was turned.
    """
    return mounted_motion(R, t, camera.rotation, (before or camera).rotation, camera.position)


def mounted_motion(
    R: FloatArray, t: FloatArray, after: FloatArray, before: FloatArray, position: FloatArray
) -> RobotMotion:
    """`robot_motion` for camera mountings: rotations (..., 3, 3) and position (3,) on the robot."""
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
    """Motions of the robot between n `CameraPose`s (n, 3, 3), (n, 3), and their Jacobians.

    `mount` (n, 3, 3) are the rotations of the camera on the robot, `position` (3,) its position.

    Returns:
        (n - 1, 6) controls and off-plane motions; and (n - 1, 6, 12) derivatives by rotation vector
        and translation of the poses before and after each step.
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
    """`CameraPose` for a control (3,) on the ground plane; `before` as in `robot_motion`."""
    before = before or camera
    rotation = heading_rotation(-float(control[2]))
    translation = -rotation @ np.append(control[:2], 0.0)
    R = camera.rotation.T @ rotation @ before.rotation
    return R, camera.rotation.T @ (translation - camera.position + rotation @ before.position)


def cross_matrix(v: FloatArray) -> FloatArray:
    """Skew-symmetric matrices (..., 3, 3) of the cross product with v (..., 3)."""
    matrix = np.zeros((*v.shape, 3))
    matrix[..., [2, 0, 1], [1, 2, 0]] = v
    return matrix - _transposed(matrix)


def _transposed(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2)
