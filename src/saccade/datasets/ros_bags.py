"""ROS 1 bags (.bag) and ROS 2 bags (folders with metadata.yaml)."""

import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import local
from typing import Any

import numpy as np

from saccade.datasets.poses import Poses, rotation_matrices
from saccade.datasets.tables import LARGEST
from saccade.errors import ImageError, LogError, SaccadeError
from saccade.extras import import_optional
from saccade.io.files import LARGEST_TEXT, check_file, open_file, reason_of
from saccade.types import FloatArray, IntArray

ODOMETRY = "nav_msgs/msg/Odometry"
POSES = (ODOMETRY, "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
TRUTH_WORDS = ("truth", "gt", "vicon", "mocap")
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
"""Messages as ROS 2 has had them since Humble, for its bags without definitions: Humble's own."""


def seconds_of(message: Any) -> float:
    """The time in the header of a message."""
    return stamp_of(message.header)


def stamp_of(header: Any) -> float:
    """The time of a header in seconds."""
    return float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)


def finite(values: Any, name: str) -> FloatArray:
    """Numbers of a message as float64."""
    numbers = np.asarray(values, np.float64)
    if not (np.abs(numbers) < LARGEST).all():
        raise LogError(f"{name}: expected finite numbers under {LARGEST:g}, found others")
    return numbers


def pose_of(message: Any) -> tuple[float, ...]:
    """Position and quaternion x, y, z, w of an Odometry, a PoseStamped or a TransformStamped."""
    if hasattr(message, "transform"):
        position, rotation = message.transform.translation, message.transform.rotation
    else:
        pose = message.pose
        pose = pose.pose if hasattr(pose, "pose") else pose
        position, rotation = pose.position, pose.orientation
    return (
        *(position.x, position.y, position.z),
        *(rotation.x, rotation.y, rotation.z, rotation.w),
    )


MAGIC = b"#ROSBAG V2.0\n"
"""First bytes of a ROS 1 bag."""


class Bag:
    """An open bag."""

    def __init__(self, path: Path) -> None:
        self.path, self._thread = path, local()
        self._readers: list[Any] = []
        weakref.finalize(self, _close, self._readers)
        self._open()

    @property
    def _reader(self) -> Any:
        """The reader of this thread: a ROS 2 bag is an SQLite database, bound to one thread."""
        return self._thread.reader if hasattr(self._thread, "reader") else self._open()

    def _open(self) -> Any:
        highlevel = import_optional("rosbags.highlevel", "ros")
        typesys = import_optional("rosbags.typesys", "ros")
        default = typesys.get_typestore(typesys.Stores.LATEST)
        for kind, fields in DEFINITIONS.items():
            default.register(typesys.get_types_from_msg(fields, kind))
        try:
            _check(self.path)
            reader = highlevel.AnyReader([self.path], default_typestore=default)
            reader.open()
            _check_connections(reader.connections)
        except Exception as error:  # rosbags raises what the broken bytes happen to provoke
            raise LogError(f"{self.path}: expected a ROS bag: {_first_line(error)}") from error
        self._thread.reader = reader
        self._readers.append(reader)
        return reader

    def topics(self, types: Sequence[str]) -> list[str]:
        """Sorted names of the topics of some types, with or without package, with messages."""
        topics = {c.topic for c in self._reader.connections if is_of(c.msgtype, types)}
        return sorted(topic for topic in topics if self._reader.topics[topic].msgcount)

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
        connections = [c for c in self._reader.connections if c.topic == topic]
        kind, stamp = connections[0].msgtype, None
        name = f"{self.path}, {topic}"
        if kind not in self._reader.typestore.fielddefs:
            raise LogError(
                f"{name}: expected the definition of {kind} in the bag, found none; "
                "`ros2 bag convert` to mcap adds it where that package is installed"
            )
        try:
            for connection, stamp, raw in self._reader.messages(connections, start, stop):
                kind = connection.msgtype
                yield stamp, self._reader.deserialize(raw, kind)
        except Exception as error:
            raise LogError(f"{name}: expected {kind}: {_first_line(error)}") from error
        if stamp is None:
            raise LogError(f"{name}: expected messages, found none")

    def stamps(self, topic: str) -> tuple[IntArray, FloatArray]:
        """Times of recording in nanoseconds (n,), and of the headers in seconds (n,)."""
        times = [(stamp, seconds_of(message)) for stamp, message in self.messages(topic)]
        recorded, headers = zip(*times, strict=True)
        return np.array(recorded, np.int64), np.array(headers)

    def at(self, topic: str, stamp: int) -> Any:
        """The message recorded at a time in nanoseconds."""
        try:
            return next(self.messages(topic, stamp, stamp + 1))[1]
        except LogError as error:
            raise ImageError(str(error)) from error


def is_of(kind: str, types: Sequence[str]) -> bool:
    """Whether a type is one of some, which may lack the package."""
    return kind in types or kind.rpartition("/")[2] in types


def odometry_topic(bag: Bag) -> str | None:
    """The topic of odometry that is no ground truth, if there is one."""
    return next((topic for topic in bag.topics((ODOMETRY,)) if not _is_truth(topic)), None)


def truth_topic(bag: Bag) -> str | None:
    """The topic of ground truth, if there is one."""
    return next((topic for topic in bag.topics(POSES) if _is_truth(topic)), None)


def _is_truth(topic: str) -> bool:
    return any(word in topic.lower() for word in TRUTH_WORDS)


def read_poses(bag: Bag, topic: str, zero: float) -> Poses:
    """Poses of a topic, sorted by time in seconds from `zero` on."""
    name = f"{bag.path}, {topic}"
    rows = [(seconds_of(message) - zero, *pose_of(message)) for _, message in bag.messages(topic)]
    table = finite(sorted(rows), name)
    return Poses(table[:, 0], rotation_matrices(table[:, 4:], name), table[:, 1:4])


def _check(path: Path) -> None:
    """Refuse devices, pipes and oversized metadata before rosbags opens them."""
    if path.is_dir():
        for file in path.iterdir():
            check_file(file, LARGEST_TEXT if file.suffix == ".yaml" else None)
        return
    with open_file(path) as opened:
        if opened.read(len(MAGIC)) != MAGIC:
            raise ValueError("it does not begin with the signature of version 2.0")


def _check_connections(connections: Sequence[Any]) -> None:
    """Check the types of metadata.yaml, which rosbags does not."""
    for connection in connections:
        for name, expected in (("topic", str), ("msgtype", str), ("msgcount", int)):
            value = getattr(connection, name)
            if not isinstance(value, expected):
                message = f"{name} of a topic: expected {expected.__name__}, found {value!r}"
                raise TypeError(message)


@contextmanager
def reading(name: str, error_type: type[SaccadeError]) -> Iterator[None]:
    """Context that refuses messages without the fields of their type.

    A bag contains its own message definitions, which may differ from those of ROS.
    """
    try:
        yield
    except SaccadeError:
        raise
    except (AttributeError, LookupError, TypeError, ValueError, OverflowError) as error:
        message = f"{name}: expected messages as ROS defines them: {_first_line(error)}"
        raise error_type(message) from error


def _close(readers: list[Any]) -> None:
    for reader in readers:
        with suppress(Exception):  # SQLite closes a database of another thread on collection
            reader.close()


def _first_line(error: Exception) -> str:
    return reason_of(error).partition("\n")[0]
