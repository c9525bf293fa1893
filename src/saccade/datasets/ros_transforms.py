"""Transforms between the frames of a robot, as tf publishes them in a bag."""

from array import array
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np

from saccade.datasets.poses import Poses, interpolate_poses, rotation_matrices
from saccade.datasets.ros_bags import Bag, finite, pose_of, seconds_of
from saccade.errors import LogError
from saccade.types import FloatArray

TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


def bare(frame: str) -> str:
    """The name of a frame without the leading slash that tf once had."""
    return frame.lstrip("/")


class Transforms:
    """Poses of frames in one another: constant, or interpolated between those published."""

    def __init__(self, edges: dict[tuple[str, str], Poses]) -> None:
        self.edges = edges
        """Poses of a frame in its parent, by the names of parent and frame; one if constant."""
        self._neighbors: dict[str, list[str]] = {}
        for parent, child in edges:
            self._neighbors.setdefault(parent, []).append(child)
            self._neighbors.setdefault(child, []).append(parent)

    @classmethod
    def read(cls, bag: Bag) -> "Transforms":
        """All transforms of a bag; those of topics that end in "static" are constant.

        Raises:
            LogError: one is no rigid transform.
        """
        edges: dict[tuple[str, str], Poses] = {}
        for topic in sorted(bag.topics(TYPES), key=lambda topic: not topic.endswith("static")):
            messages = (message for _, message in bag.messages(topic))
            static = topic.endswith("static")
            edges |= _edges(messages, static=static, name=f"{bag.path}, {topic}")
        return cls(edges)

    @property
    def frames(self) -> str:
        """The names of all frames, for messages."""
        return ", ".join(sorted(self._neighbors)) or "no frame"

    def without(self, frame: str) -> "Transforms":
        """The transforms that do not pass through a frame."""
        return Transforms({pair: poses for pair, poses in self.edges.items() if frame not in pair})

    def has(self, frame: str) -> bool:
        """Whether a frame is known."""
        return frame in self._neighbors

    def poses(self, base: str, part: str, time: FloatArray) -> Poses | None:
        """Poses of the frame `part` in the frame `base` at times (n,) in seconds.

        Before the first and after the last transform between two frames, these hold. None where
        no chain of transforms connects the frames.
        """
        path = self._path(base, part)
        if path is None:
            return None
        rotation, position = np.tile(np.eye(3), (len(time), 1, 1)), np.zeros((len(time), 3))
        for parent, child in pairwise(path):
            step = self._step(parent, child, time)
            position = position + np.einsum("nij,nj->ni", rotation, step.position)
            rotation = rotation @ step.rotation
        return Poses(time, rotation, position)

    def _step(self, parent: str, child: str, time: FloatArray) -> Poses:
        """Poses (n,) of a frame in its neighbor."""
        if (parent, child) in self.edges:
            return interpolate_poses(self.edges[parent, child], time)
        pose = interpolate_poses(self.edges[child, parent], time)
        inverse = pose.rotation.transpose(0, 2, 1)
        return Poses(time, inverse, -np.einsum("nij,nj->ni", inverse, pose.position))

    def _path(self, base: str, part: str) -> list[str] | None:
        """Names of the frames on the shortest path; None without one."""
        paths = {base: [base]}
        queue = [base]
        for frame in queue:
            for neighbor in self._neighbors.get(frame, []):
                if neighbor not in paths:
                    paths[neighbor] = [*paths[frame], neighbor]
                    queue.append(neighbor)
        return paths.get(part)


def _edges(messages: Iterable[Any], *, static: bool, name: str) -> dict[tuple[str, str], Poses]:
    """Poses of each frame in its parent, in the order of time; the last alone if `static`."""
    rows: dict[tuple[str, str], array[float]] = {}
    for message in messages:
        for transform in message.transforms:
            pair = bare(transform.header.frame_id), bare(transform.child_frame_id)
            time = 0.0 if static else seconds_of(transform)
            rows.setdefault(pair, array("d")).extend((time, *pose_of(transform)))
    edges = {}
    for pair, numbers in rows.items():
        table = finite(numbers, name).reshape(-1, 8)[::-1]  # of several at one time the last
        table = table[np.unique(table[:, 0], return_index=True)[1]]
        try:
            rotation = rotation_matrices(table[:, 4:], name)
        except LogError as error:
            raise LogError(f"{error}, from {pair[0]} to {pair[1]}") from error
        edges[pair] = Poses(table[:, 0], rotation, table[:, 1:4])
    return edges
