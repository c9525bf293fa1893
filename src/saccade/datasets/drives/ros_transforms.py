"""Where the parts of a robot are on each other, by the fixed transforms of ROS."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from saccade.datasets.drives.camera_poses import rotations
from saccade.datasets.drives.ros_messages import measured
from saccade.types import FloatArray


def extrinsics(messages: Iterable[Any], base: str, part: str, name: str) -> FloatArray | None:
    """Pose (4, 4) of a part in the frame of another one; None where no chain joins them.

    Args:
        messages: TFMessages with transforms that stay.
        base: the frame that is asked for, such as base_link.
        part: the frame of the part.
        name: of the file, for the message of an error.

    Raises:
        LogError: a quaternion that is none.
    """
    steps: dict[str, list[tuple[str, FloatArray]]] = {}
    for message in messages:
        for each in message.transforms:
            parent, child = _plain(each.header.frame_id), _plain(each.child_frame_id)
            pose = _matrix(each.transform, name)
            steps.setdefault(parent, []).append((child, pose))
            steps.setdefault(child, []).append((parent, _back(pose)))
    found = {_plain(base): np.eye(4)}
    ahead = list(found)
    while ahead:
        here = ahead.pop()
        for there, pose in steps.get(here, []):
            if there not in found:
                found[there] = found[here] @ pose
                ahead.append(there)
    return found.get(_plain(part))


def _back(pose: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(pose), np.float64)


def _plain(frame: str) -> str:
    """Old bags begin the names of frames with a slash."""
    return frame.lstrip("/")


def _matrix(transform: Any, name: str) -> FloatArray:
    turn, place = transform.rotation, transform.translation
    pose = np.eye(4)
    quaternion = measured([[turn.x, turn.y, turn.z, turn.w]], name)
    pose[:3, :3] = rotations(quaternion, name)[0]
    pose[:3, 3] = measured([place.x, place.y, place.z], name)
    return pose
