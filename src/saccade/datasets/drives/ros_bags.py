"""ROS 1 bags (.bag) and ROS 2 bags (folders with metadata.yaml), and their messages."""

import weakref
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import local
from typing import Any

import cv2
import numpy as np

from saccade.datasets.drives.calibration import Calibration, pinhole
from saccade.datasets.drives.sidecar_files import rotation_matrices
from saccade.datasets.tables import LARGEST
from saccade.errors import ConfigError, DriveError, ImageError, SaccadeError
from saccade.extras import import_optional
from saccade.files import LARGEST_TEXT, check_file, open_file, reason_of
from saccade.types import FloatArray, Image, IntArray

_ENCODINGS: dict[str, tuple[type[np.generic], int, int | None]] = {
    "mono8": (np.uint8, 1, None),
    "8UC1": (np.uint8, 1, None),
    "rgb8": (np.uint8, 3, None),
    "bgr8": (np.uint8, 3, cv2.COLOR_BGR2RGB),
    "8UC3": (np.uint8, 3, cv2.COLOR_BGR2RGB),
    "rgba8": (np.uint8, 4, cv2.COLOR_RGBA2RGB),
    "bgra8": (np.uint8, 4, cv2.COLOR_BGRA2RGB),
    "mono16": (np.uint16, 1, None),
    "16UC1": (np.uint16, 1, None),
    "32FC1": (np.float32, 1, None),
    "bayer_rggb8": (np.uint8, 1, cv2.COLOR_BayerBG2RGB),
    "bayer_bggr8": (np.uint8, 1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg8": (np.uint8, 1, cv2.COLOR_BayerGR2RGB),
    "bayer_grbg8": (np.uint8, 1, cv2.COLOR_BayerGB2RGB),
}
"""Number type, channels, and OpenCV's conversion to RGB."""
DISTORTION_MODELS = ("plumb_bob", "rational_polynomial", "")


def seconds_of(message: Any) -> float:
    """The time in the header of a message."""
    stamp = message.header.stamp
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def pixels_of(message: Any, name: str) -> Image:
    """The image of an Image or a CompressedImage: gray or RGB, or depth as it is."""
    if hasattr(message, "format"):
        pixels = cv2.imdecode(np.asarray(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            raise ImageError(f"{name}: expected an image, found {message.format[:40]!r}")
        return pixels if pixels.ndim == 2 else cv2.cvtColor(pixels[..., :3], cv2.COLOR_BGR2RGB)
    encoding = message.encoding
    if encoding not in _ENCODINGS:
        raise ImageError(f"{name}: expected one of {', '.join(_ENCODINGS)}, found {encoding!r}")
    number, channels, conversion = _ENCODINGS[encoding]
    kind = np.dtype(number).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = message.height, message.width, message.step
    row = width * channels * kind.itemsize
    if step < row or len(message.data) < height * step:
        raise ImageError(f"{name}: expected {height} rows of {row} bytes, found fewer")
    rows = np.asarray(message.data, np.uint8)[: height * step].reshape(height, step)[:, :row]
    pixels = np.ascontiguousarray(rows).view(kind).astype(number)
    if channels > 1:
        pixels = pixels.reshape(height, width, channels)
    return pixels if conversion is None else cv2.cvtColor(pixels, conversion)


def calibration_of(left: Any, right: Any | None, name: str) -> Calibration:
    """Calibration from the CameraInfo of one camera, or of a rectified stereo pair.

    The projection of the right camera has the baseline; `name` is for the error message.
    """
    K, D, P = (finite(_field(left, each), name) for each in "kdp")
    P = P.reshape(3, 4)
    if left.distortion_model not in DISTORTION_MODELS or len(D) not in (0, 4, 5):
        raise DriveError(
            f"{name}: expected plumb_bob with up to five coefficients, "
            f"found {left.distortion_model!r} with {len(D)}"
        )
    baseline = 0.0
    if right is not None:
        P2 = finite(_field(right, "p"), name).reshape(3, 4)
        baseline = -float(P2[0, 3] / P2[0, 0]) if P2[0, 0] else 0.0
        if np.any(D):
            raise DriveError(
                f"{name}: expected rectified images of a stereo pair, found distortion {D.tolist()}"
            )
        K = P[:, :3]
    try:
        camera = pinhole(K.reshape(3, 3), (left.width, left.height), baseline=baseline)
    except ConfigError as error:
        raise DriveError(f"{name}: {error}") from error
    return Calibration(camera, tuple(D.tolist()) if np.any(D) else ())


def finite(values: Any, name: str) -> FloatArray:
    """Numbers of a message as float64."""
    numbers = np.asarray(values, np.float64)
    if not (np.abs(numbers) < LARGEST).all():
        raise DriveError(f"{name}: expected finite numbers under {LARGEST:g}, found others")
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


def _field(message: Any, name: str) -> Any:
    """A field whose name is a capital in ROS 1."""
    return getattr(message, name) if hasattr(message, name) else getattr(message, name.upper())


def extrinsics(messages: Iterable[Any], base: str, part: str, name: str) -> FloatArray | None:
    """Pose (4, 4) of the frame `part` in the frame `base`, such as base_link, by static TFMessages.

    None where no chain of transforms connects them. `name` is for the error message.
    """
    edges: dict[str, list[tuple[str, FloatArray]]] = {}
    for message in messages:
        for transform in message.transforms:
            frames = (transform.header.frame_id, transform.child_frame_id)
            parent, child = (frame.lstrip("/") for frame in frames)  # tf had a leading slash
            pose = _matrix(transform, name)
            inverse = np.asarray(np.linalg.inv(pose), np.float64)
            edges.setdefault(parent, []).append((child, pose))
            edges.setdefault(child, []).append((parent, inverse))
    poses = {base.lstrip("/"): np.eye(4)}
    stack = list(poses)
    while stack:
        parent = stack.pop()
        for child, pose in edges.get(parent, []):
            if child not in poses:
                poses[child] = poses[parent] @ pose
                stack.append(child)
    return poses.get(part.lstrip("/"))


def _matrix(transform: Any, name: str) -> FloatArray:
    values = finite([pose_of(transform)], name)
    pose = np.eye(4)
    pose[:3, :3] = rotation_matrices(values[:, 3:], name)[0]
    pose[:3, 3] = values[0, :3]
    return pose


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
        try:
            _check(self.path)
            reader = highlevel.AnyReader([self.path], default_typestore=default)
            reader.open()
            _check_connections(reader.connections)
        except Exception as error:  # rosbags raises what the broken bytes happen to provoke
            raise DriveError(f"{self.path}: expected a ROS bag: {_first_line(error)}") from error
        self._thread.reader = reader
        self._readers.append(reader)
        return reader

    def topics(self, types: Sequence[str]) -> list[str]:
        """Sorted names of the topics of some types that have messages."""
        topics = {c.topic for c in self._reader.connections if c.msgtype in types}
        return sorted(topic for topic in topics if self._reader.topics[topic].msgcount)

    def all_topics(self) -> str:
        """The names of all topics, for messages."""
        return ", ".join(sorted({c.topic for c in self._reader.connections})) or "no topic"

    def messages(
        self, topic: str, start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[int, Any]]:
        """Time of recording in nanoseconds and message, for every message of a topic."""
        connections = [c for c in self._reader.connections if c.topic == topic]
        kind, stamp = connections[0].msgtype, None
        try:
            for connection, stamp, raw in self._reader.messages(connections, start, stop):
                kind = connection.msgtype
                yield stamp, self._reader.deserialize(raw, kind)
        except Exception as error:
            name = f"{self.path}, {topic}"
            raise DriveError(f"{name}: expected {kind}: {_first_line(error)}") from error
        if stamp is None:
            raise DriveError(f"{self.path}, {topic}: expected messages, found none")

    def stamps(self, topic: str) -> tuple[IntArray, FloatArray]:
        """Times of recording in nanoseconds (n,), and of the headers in seconds (n,)."""
        times = [(stamp, seconds_of(message)) for stamp, message in self.messages(topic)]
        recorded, headers = zip(*times, strict=True)
        return np.array(recorded, np.int64), np.array(headers)

    def at(self, topic: str, stamp: int) -> Any:
        """The message recorded at a time in nanoseconds."""
        try:
            return next(self.messages(topic, stamp, stamp + 1))[1]
        except DriveError as error:
            raise ImageError(str(error)) from error


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
def reading(name: str, error_type: type[DriveError | ImageError]) -> Iterator[None]:
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
