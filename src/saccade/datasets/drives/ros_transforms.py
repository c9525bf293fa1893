"""Extrinsics of the parts of a robot, from the static transforms of ROS."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from saccade.datasets.drives.camera_poses import rotation_matrices
from saccade.datasets.drives.ros_messages import finite, pose_of
from saccade.types import FloatArray


def extrinsics(messages: Iterable[Any], base: str, part: str, name: str) -> FloatArray | None:
    """Pose (4, 4) of a part in a base frame; None where no chain of transforms connects them.

    Args:
        messages: TFMessages with static transforms.
        base: name of the base frame, such as base_link.
        part: name of the frame of the part.
        name: of the file, for the error message.

    Raises:
        LogError: an invalid quaternion.
    """
    edges: dict[str, list[tuple[str, FloatArray]]] = {}
    for message in messages:
        for transform in message.transforms:
            parent, child = _frame(transform.header.frame_id), _frame(transform.child_frame_id)
            pose = _matrix(transform, name)
            inverse = np.asarray(np.linalg.inv(pose), np.float64)
            edges.setdefault(parent, []).append((child, pose))
            edges.setdefault(child, []).append((parent, inverse))
    poses = {_frame(base): np.eye(4)}
    stack = list(poses)
    while stack:
        parent = stack.pop()
        for child, pose in edges.get(parent, []):
            if child not in poses:
                poses[child] = poses[parent] @ pose
                stack.append(child)
    return poses.get(_frame(part))


def _frame(name: str) -> str:
    """The name of a frame without the leading slash of old bags."""
    return name.lstrip("/")


def _matrix(transform: Any, name: str) -> FloatArray:
    values = finite([pose_of(transform)], name)
    pose = np.eye(4)
    pose[:3, :3] = rotation_matrices(values[:, 3:], name)[0]
    pose[:3, 3] = values[0, :3]
    return pose
