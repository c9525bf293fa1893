"""ROS 1 bags (.bag) and ROS 2 bags (.mcap, .db3 or their folder), and the transforms in them."""

import re
import warnings
import weakref
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from threading import local
from typing import Any

import numpy as np

from saccade.datasets.tables import LARGEST
from saccade.errors import ImageError, LogError, LogWarning
from saccade.extras import import_optional
from saccade.frames import Poses
from saccade.io.files import LARGEST_TEXT, check_file, natural_order, open_file, reading
from saccade.types import FloatArray, IntArray

ODOMETRY = "nav_msgs/msg/Odometry"
POSES = (ODOMETRY, "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
TRUTH = "gt|.*(truth|vicon|mocap).*"
"""Pattern of words in the names of topics with ground truth."""
BAG_SUFFIXES = (".bag", ".db3", ".mcap")
DEFINITIONS = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\nstring id"
    ),
    "vision_msgs/msg/Detection3DArray": (
        "std_msgs/Header header\nvision_msgs/Detection3D[] detections"
    ),
    "apriltag_msgs/msg/Point": "float64 x\nfloat64 y",
    "apriltag_msgs/msg/AprilTagDetection": (
        "string family\nint32 id\nint32 hamming\nfloat32 goodness\nfloat32 decision_margin\n"
        "apriltag_msgs/Point centre\napriltag_msgs/Point[4] corners\nfloat64[9] homography"
    ),
    "apriltag_msgs/msg/AprilTagDetectionArray": (
        "std_msgs/Header header\napriltag_msgs/AprilTagDetection[] detections"
    ),
}
"""Message definitions of ROS 2 Humble and later, for bags without definitions (Humble's)."""


def stamp_of(header: Any) -> float:
    """The time of a header in seconds."""
    return float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)


def pose_of(message: Any) -> tuple[float, ...]:
    """Position and quaternion x, y, z, w of a Pose or a Transform, or of a message with one."""
    while hasattr(message, "pose"):
        message = message.pose
    if hasattr(message, "transform"):
        message = message.transform
    if hasattr(message, "translation"):
        position, rotation = message.translation, message.rotation
    else:
        position, rotation = message.position, message.orientation
    return (
        *(position.x, position.y, position.z),
        *(rotation.x, rotation.y, rotation.z, rotation.w),
    )


def finite(values: Any, name: str) -> FloatArray:
    """Numbers of a message as float64, checked to be finite."""
    numbers = np.asarray(values, np.float64)
    if not (np.abs(numbers) < LARGEST).all():
        raise LogError(f"{name}: expected finite numbers under {LARGEST:g}, found others")
    return numbers


MAGIC = b"#ROSBAG V2.0\n"
"""First bytes of a ROS 1 bag."""


def bag_files(path: Path) -> list[Path]:
    """The files of a bag: the path itself, or the files of a folder without metadata.yaml.

    Raises:
        LogError: the files are not the parts NAME_0, NAME_1, ... of a single bag.
    """
    if not path.is_dir() or (path / "metadata.yaml").exists():
        return [path]
    files = [file for file in path.iterdir() if file.suffix.lower() in BAG_SUFFIXES]
    if len({re.sub("_[0-9]+$", "", file.stem) + file.suffix for file in files}) > 1:
        names = ", ".join(sorted(file.name for file in files))
        raise LogError(f"{path}: expected one bag, found {names}; give one of these files")
    return sorted(files, key=natural_order)


def is_bag(path: Path) -> bool:
    """Whether a folder is a ROS 2 bag, or has the parts of a bag."""
    return path.is_dir() and ((path / "metadata.yaml").exists() or bool(bag_files(path)))


def has_word(topic: str, pattern: str) -> bool:
    """Whether a word of a topic, such as /stereo/rightCamera/image_raw, matches a pattern."""
    words = re.findall("[A-Z]?[a-z]+|[A-Z]+(?![a-z])", topic)
    return any(re.fullmatch(pattern, word.lower()) for word in words)


@contextmanager
def _reading(name: object, expected: str) -> Iterator[None]:
    """`reading` for bags: on broken bytes rosbags raises any exception and trusts any size."""
    try:
        with reading(name, LogError, expected, Exception):
            yield
    except MemoryError as error:
        raise LogError(f"{name}: expected {expected}, found sizes beyond the memory") from error


class Bag:
    """An open bag that any thread can read."""

    def __init__(self, path: Path) -> None:
        self.path, self._thread = path, local()
        self._readers: list[Any] = []
        weakref.finalize(self, _close, self._readers)
        self._open()

    @property
    def _reader(self) -> Any:
        """The reader of this thread, since the SQLite database of a ROS 2 bag is bound to one."""
        return self._thread.reader if hasattr(self._thread, "reader") else self._open()

    def _open(self) -> Any:
        highlevel = import_optional("rosbags.highlevel", "ros")
        typesys = import_optional("rosbags.typesys", "ros")
        default = typesys.get_typestore(typesys.Stores.LATEST)
        for kind, fields in DEFINITIONS.items():
            default.register(typesys.get_types_from_msg(fields, kind))
        with _reading(self.path, "a ROS bag"):
            files = bag_files(self.path)
            for file in files:
                _check(file)
            reader = highlevel.AnyReader(files, default_typestore=default)
            reader.open()
        self._thread.reader = reader
        self._readers.append(reader)
        return reader

    def topics(self, types: Sequence[str]) -> list[str]:
        """Sorted names of the nonempty topics of the given types."""
        kinds = {c.topic: c.msgtype for c in self._reader.connections}
        topics = self._reader.topics
        return sorted(
            name for name, kind in kinds.items() if kind in types and topics[name].msgcount
        )

    def kind(self, topic: str) -> str:
        """Type of the messages of a topic, such as nav_msgs/msg/Odometry."""
        return str(next(c.msgtype for c in self._reader.connections if c.topic == topic))

    def all_topics(self) -> str:
        """The names of all topics, for messages."""
        return ", ".join(sorted({c.topic for c in self._reader.connections})) or "no topic"

    def messages(
        self, topic: str, start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[int, Any]]:
        """Time of recording in nanoseconds and message, for every message of a topic."""
        name, kind, stamp = f"{self.path}, {topic}", self.kind(topic), None
        if kind not in self._reader.typestore.fielddefs:
            raise LogError(
                f"{name}: expected the definition of {kind} in the bag, found none; "
                "`ros2 bag convert` to mcap adds it where that package is installed"
            )
        connections = [c for c in self._reader.connections if c.topic == topic]
        with _reading(name, kind):
            for _, stamp, raw in self._reader.messages(connections, start, stop):
                yield stamp, self._reader.deserialize(raw, kind)
        if stamp is None:
            raise LogError(f"{name}: expected messages, found none")

    def stamps(self, topic: str) -> tuple[IntArray, FloatArray]:
        """Times of recording in nanoseconds (n,), and of the headers in seconds (n,)."""
        times = [(stamp, stamp_of(message.header)) for stamp, message in self.messages(topic)]
        recorded, headers = zip(*times, strict=True)
        return np.array(recorded, np.int64), np.array(headers)

    def first(self, topic: str) -> Any:
        """The first message of a topic."""
        return next(self.messages(topic))[1]

    def at(self, topic: str, stamp: int) -> Any:
        """The message recorded at a time in nanoseconds."""
        try:
            return next(self.messages(topic, stamp, stamp + 1))[1]
        except LogError as error:
            raise ImageError(str(error)) from error

    def odometry_topic(self) -> str | None:
        """The odometry topic that is not ground truth, or None."""
        return next((each for each in self.topics((ODOMETRY,)) if not _is_truth(each)), None)

    def truth_topic(self) -> str | None:
        """The ground-truth topic, or None."""
        return next((each for each in self.topics(POSES) if _is_truth(each)), None)

    def poses(self, topic: str) -> Poses:
        """Poses of a topic, sorted by the times of their headers in seconds."""
        rows = sorted((stamp_of(m.header), *pose_of(m)) for _, m in self.messages(topic))
        return poses_from(rows, f"{self.path}, {topic}")


def _is_truth(topic: str) -> bool:
    return has_word(topic, TRUTH)


def poses_from(rows: Any, name: str) -> Poses:
    """Poses from rows of time, position and quaternion, in the given order."""
    return Poses.from_rows(finite(rows, name), name)


def _check(path: Path) -> None:
    """Rejects devices, pipes and oversized metadata before rosbags opens them."""
    if path.is_dir():
        for file in path.iterdir():
            check_file(file, LARGEST_TEXT if file.suffix == ".yaml" else None)
        return
    with open_file(path) as opened:
        if path.suffix.lower() == ".bag" and opened.read(len(MAGIC)) != MAGIC:
            raise ValueError("it does not begin with the signature of version 2.0")


FIELDS = (
    *("messages as ROS defines them", AttributeError, LookupError, TypeError, ValueError),
    OverflowError,
)
"""Arguments of `reading` for messages, since definitions in a bag may differ from ROS."""


def _close(readers: list[Any]) -> None:
    for reader in readers:
        with suppress(Exception):  # the collector closes databases of other threads
            reader.close()


TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


def bare(frame: str) -> str:
    """The name of a frame without the leading slash of tf1."""
    return frame.lstrip("/")


class Transforms:
    """Transforms between frames: constant, or interpolated between published transforms."""

    def __init__(self, edges: dict[tuple[str, str], Poses]) -> None:
        self.edges = edges
        """Poses of a frame in its parent, by parent and frame; a single pose if constant."""
        self._neighbors: dict[str, list[str]] = {}
        for parent, child in edges:
            self._neighbors.setdefault(parent, []).append(child)
            self._neighbors.setdefault(child, []).append(parent)

    @classmethod
    def read(cls, bag: Bag) -> "Transforms":
        """All transforms of a bag; topics that end in "static" are constant.

        A frame has one constant parent: the last of several, with a `LogWarning`.
        """
        edges: dict[tuple[str, str], Poses] = {}
        parents: dict[str, str] = {}
        for topic in sorted(bag.topics(TRANSFORMS), key=lambda topic: not topic.endswith("static")):
            rows: dict[tuple[str, str], array[float]] = {}
            for _, message in bag.messages(topic):
                for each in message.transforms:
                    pair = bare(each.header.frame_id), bare(each.child_frame_id)
                    time = stamp_of(each.header)
                    if topic.endswith("static"):
                        time, parents[pair[1]] = 0.0, pair[0]
                    rows.setdefault(pair, array("d")).extend((time, *pose_of(each)))
            for (parent, child), numbers in rows.items():
                table = np.reshape(numbers, (-1, 8))[::-1]  # the last of several with equal times
                table = table[np.unique(table[:, 0], return_index=True)[1]]
                name = f"{bag.path}, {topic}, from {parent} to {child}"
                edges[parent, child] = poses_from(table, name)
        for parent, child in [pair for pair in edges if parents.get(pair[1], pair[0]) != pair[0]]:
            del edges[parent, child]
            warnings.warn(
                f"{bag.path}: frame {child!r} has the parents {parent!r} and then "
                f"{parents[child]!r}; the last one is used",
                LogWarning,
                stacklevel=4,
            )
        return cls(edges)

    @property
    def frames(self) -> str:
        """The names of all frames, for messages."""
        return ", ".join(sorted(self._neighbors)) or "no frame"

    def without(self, frame: str) -> "Transforms":
        """The transforms that do not pass through a frame."""
        return Transforms({pair: poses for pair, poses in self.edges.items() if frame not in pair})

    def poses(self, base: str, part: str, time: FloatArray) -> Poses | None:
        """Poses of the frame `part` in the frame `base` at times (n,) in seconds.

        The first and last transforms are held outside their time span. None if no chain of
        transforms connects the frames.
        """
        paths, queue = {base: [base]}, [base]
        for frame in queue:  # the shortest path to each frame
            for neighbor in self._neighbors.get(frame, []):
                if neighbor not in paths:
                    paths[neighbor] = [*paths[frame], neighbor]
                    queue.append(neighbor)
        if part not in paths:
            return None
        chain = Poses(time, np.tile(np.eye(3), (len(time), 1, 1)), np.zeros((len(time), 3)))
        for parent, child in pairwise(paths[part]):
            if (parent, child) in self.edges:
                chain = chain @ self.edges[parent, child].interpolate(time)
            else:
                chain = chain @ self.edges[child, parent].interpolate(time).inverse
        return chain
