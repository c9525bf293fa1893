"""Drives from ROS 1 bags (.bag) and ROS 2 bags (a folder with metadata.yaml), by rosbags.

Topics are found by their types, and where there are several by their names:

    sensor_msgs Image or CompressedImage    "left" before others, and not "depth" or "right";
                                            one with "right"; one with "depth" (16UC1 in mm,
                                            32FC1 in m)
    sensor_msgs CameraInfo                  that which shares most of its name with the image's
    nav_msgs Odometry                       the one without "truth" or "gt" in its name
    Odometry, PoseStamped, TransformStamped with "truth", "gt", "vicon" or "mocap" in the name:
                                            truth, of the robot

    tf2_msgs TFMessage                      one that ends in "static": where the camera is on the
                                            robot, if it joins the frames of image and odometry

A camera.toml in the folder of the bag goes before CameraInfo and transforms. Times are those of the
messages' headers, from the first image on. Without odometry nothing is known of the way (see
`unknown_increments`). Needs the extra `ros`.
"""

import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from posixpath import commonpath
from threading import local
from typing import Any

import numpy as np

from saccade.datasets.drives.camera_file import CAMERA_FILE, Calibration, read_calibration
from saccade.datasets.drives.camera_poses import (
    Poses,
    off_plane_components,
    project_to_plane,
    rotations,
)
from saccade.datasets.drives.image_files import in_time, metres, undistort
from saccade.datasets.drives.odometry_increments import (
    OdometryIncrements,
    increments_from_poses,
    unknown_increments,
)
from saccade.datasets.drives.ros_messages import (
    calibration_of,
    measured,
    pixels_of,
    pose_of,
    seconds_of,
)
from saccade.datasets.drives.ros_transforms import extrinsics
from saccade.datasets.drives.sidecar_files import Truth, assemble_drive
from saccade.datasets.drives.tum_rgbd import associated
from saccade.datasets.drives.undistortion import Lens
from saccade.errors import DriveError, ImageError, SaccadeError
from saccade.extras import import_optional
from saccade.files import LARGEST_TEXT, check_file, open_file, reason_of
from saccade.frames import Camera, Drive, Frame
from saccade.types import FloatArray, Image, IntArray

TOGETHER = 0.01
"""Seconds by which the images of one frame may be apart."""
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
)
MAGIC = b"#ROSBAG V2.0\n"
"""Of a bag of ROS 1."""
TRUE = ("truth", "gt", "vicon", "mocap")


class Bag:
    """An open bag.

    Raises:
        DriveError: it is none, or broken.
        ConfigError: rosbags is not installed.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._own = path, local()
        self._own.reader = self._opened()
        self._readers = [self._own.reader]
        weakref.finalize(self, _close, self._readers)

    @property
    def reader(self) -> Any:
        """This thread's: a ROS 2 bag is a database, and those do not change threads."""
        if not hasattr(self._own, "reader"):
            self._own.reader = self._opened()
            self._readers.append(self._own.reader)
        return self._own.reader

    def _opened(self) -> Any:
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
        return reader

    def topics(self, types: Sequence[str]) -> list[str]:
        """Names of the topics of some types, those with messages, in their order."""
        found = {each.topic for each in self.reader.connections if each.msgtype in types}
        return sorted(each for each in found if self.reader.topics[each].msgcount)

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Time of recording in nanoseconds and message, of every one of a topic, one by one.

        Raises:
            DriveError: the bag is broken there, or has none though it says so.
        """
        stamp = None
        for connection, stamp, raw in self._raw(topic):
            yield stamp, self._read(raw, connection)
        if stamp is None:
            raise DriveError(f"{self.path}, {topic}: expected messages, found none")

    def stamps(self, topic: str) -> tuple[IntArray, FloatArray]:
        """Times of recording in nanoseconds (n,), and of the headers in seconds (n,)."""
        found = [(stamp, seconds_of(message)) for stamp, message in self.messages(topic)]
        recorded, headers = zip(*found, strict=True)
        return np.array(recorded, np.int64), np.array(headers)

    def at(self, topic: str, stamp: int) -> Any:
        """The message that was recorded at a time.

        Raises:
            ImageError: it cannot be read.
        """
        try:
            for connection, _, raw in self._raw(topic, stamp, stamp + 1):
                return self._read(raw, connection)
        except DriveError as error:
            raise ImageError(str(error)) from error
        raise ImageError(f"{self.path}, {topic}: expected a message at {stamp} ns, found none")

    def _raw(self, topic: str, start: int | None = None, stop: int | None = None) -> Any:
        chosen = [each for each in self.reader.connections if each.topic == topic]
        try:
            yield from self.reader.messages(chosen, start=start, stop=stop)
        except Exception as error:
            raise DriveError(f"{self.path}, {topic}: {_first_line(error)}") from error

    def _read(self, raw: bytes, connection: Any) -> Any:
        try:
            return self.reader.deserialize(raw, connection.msgtype)
        except Exception as error:
            raise DriveError(
                f"{self.path}, {connection.topic}: expected {connection.msgtype}: "
                f"{_first_line(error)}"
            ) from error


def _check(path: Path) -> None:
    """Refuse what rosbags would read to its end, or wait for."""
    if path.is_dir():
        for file in path.iterdir():
            check_file(file, LARGEST_TEXT if file.suffix == ".yaml" else None)
        return
    with open_file(path) as opened:
        if opened.read(len(MAGIC)) != MAGIC:
            raise ValueError("it does not begin as one of version 2.0 does")


def _check_connections(connections: Sequence[Any]) -> None:
    """Refuse what metadata.yaml may say of a topic: rosbags takes any type, and sums and sorts."""
    for each in connections:
        for name, expected in (("topic", str), ("msgtype", str), ("msgcount", int)):
            value = getattr(each, name)
            if not isinstance(value, expected):
                message = f"{name} of a topic: expected {expected.__name__}, found {value!r}"
                raise TypeError(message)


@contextmanager
def _reading(name: str, kind: type[DriveError | ImageError]) -> Iterator[None]:
    """Refuse messages without the fields of their type: a bag brings its own definitions."""
    try:
        yield
    except SaccadeError:
        raise
    except (AttributeError, LookupError, TypeError, ValueError, OverflowError) as error:
        message = f"{name}: expected messages as ROS defines them: {_first_line(error)}"
        raise kind(message) from error


def _close(readers: list[Any]) -> None:
    for reader in readers:
        with suppress(Exception):  # a database of another thread closes when it is forgotten
            reader.close()


@dataclass(frozen=True, eq=False)
class BagFrames:
    """Reads frame i from a bag; what `Drive.load` is."""

    bag: Bag
    topics: tuple[str, str, str]
    """Left, right and depth; empty where there is none."""
    recorded: IntArray
    """(n, 3) nanoseconds of their messages, -1 where one is missing."""
    camera: Camera
    time: FloatArray
    """(n,) seconds."""
    depth_unit: float
    lens: Lens | None

    def __call__(self, i: int) -> Frame:
        """Frame i.

        Raises:
            ImageError: a message is broken, or has another size than the calibration.
        """
        left, right, depth = (self._pixels(which, i) for which in range(3))
        name = f"{self.bag.path}, {self.topics[2]}, frame {i}"
        unit = 1.0 if depth is not None and depth.dtype.kind == "f" else self.depth_unit
        return Frame(
            time=float(self.time[i]),
            image=self._straight(left, 0, i),
            right=self._straight(right, 1, i),
            depth=None if depth is None else metres(depth, unit, self.camera, self.lens, name),
        )

    def _pixels(self, which: int, i: int) -> Image | None:
        topic, stamp = self.topics[which], int(self.recorded[i, which])
        if not topic or stamp < 0:
            return None
        name = f"{self.bag.path}, {topic}, frame {i}"
        with _reading(name, ImageError):
            return pixels_of(self.bag.at(topic, stamp), name)

    def _straight(self, pixels: Image | None, which: int, i: int) -> Image | None:
        name = f"{self.bag.path}, {self.topics[which]}, frame {i}"
        return None if pixels is None else undistort(pixels, self.camera, self.lens, name)


def read_rosbag_drive(path: Path) -> Drive:
    """A drive from a bag.

    Raises:
        DriveError: the bag is broken, or has no images or no calibration.
        ConfigError: rosbags is not installed.
    """
    with _reading(str(path), DriveError):
        return _drive(Bag(path), path)


def _drive(bag: Bag, path: Path) -> Drive:
    topics = _image_topics(bag)
    stamps, clock = bag.stamps(topics[0])
    number, remarks = in_time(clock, f"{path}, {topics[0]}")
    zero = float(clock[number[0]])
    recorded = np.full((len(number), 3), -1)
    recorded[:, 0] = stamps[number]
    for which in (1, 2):
        if topics[which]:
            others, their_clock = bag.stamps(topics[which])
            nearest = associated(clock[number], their_clock, TOGETHER)
            recorded[:, which] = np.where(nearest >= 0, others[nearest], -1)
    calibration = _calibration(bag, topics)
    time = clock[number] - zero
    steps = _steps(bag, time, zero)
    truth = _truth(bag, zero)
    load = BagFrames(
        bag,
        topics,
        recorded,
        calibration.camera,
        time,
        calibration.depth_unit,
        Lens.of(calibration.camera, calibration.distortion),
    )
    return assemble_drive(path.stem, calibration, time, load, steps, truth, remarks)


def _image_topics(bag: Bag) -> tuple[str, str, str]:
    """Left, right and depth."""
    there = bag.topics(IMAGES)
    depth = next((each for each in there if "depth" in each), "")
    right = next((each for each in there if "right" in each and "depth" not in each), "")
    single = [each for each in there if each != right and "depth" not in each]
    if not single:
        raise DriveError(f"{bag.path}: expected a topic of images, found {_listed(bag)}")
    return min(single, key=lambda each: "left" not in each), right, depth


def _calibration(bag: Bag, topics: tuple[str, str, str]) -> Calibration:
    file = bag.path.parent / CAMERA_FILE
    if file.exists():
        return read_calibration(file)
    infos = bag.topics(("sensor_msgs/msg/CameraInfo",))
    if not infos:
        raise DriveError(f"{bag.path}: expected CameraInfo, or {file}, found {_listed(bag)}")
    left, *right = (_nearest(infos, each) for each in topics[:2] if each)
    _, first = next(bag.messages(left))
    second = None
    if right and right[0] != left:
        _, second = next(bag.messages(right[0]))
    found = calibration_of(first, second, f"{bag.path}, {left}")
    return replace(found, camera=_mounted(bag, topics[0], found.camera))


def _mounted(bag: Bag, image: str, camera: Camera) -> Camera:
    """The camera where the fixed transforms of the bag put it on the robot, if they do."""
    transforms = bag.topics(("tf2_msgs/msg/TFMessage",))
    fixed = [topic for topic in transforms if topic.endswith("static")]
    odometry = _odometry_topic(bag)
    if not fixed or odometry is None:
        return camera
    base = next(bag.messages(odometry))[1].child_frame_id
    part = next(bag.messages(image))[1].header.frame_id
    messages = (message for topic in fixed for _, message in bag.messages(topic))
    pose = extrinsics(messages, base, part, f"{bag.path}, {fixed[0]}")
    if pose is None:
        return camera
    return replace(camera, position=pose[:3, 3].copy(), rotation=pose[:3, :3].copy())


def _steps(bag: Bag, time: FloatArray, zero: float) -> OdometryIncrements:
    topic = _odometry_topic(bag)
    if topic is None:
        return unknown_increments(time)
    robot = _poses(bag, topic, zero)
    return increments_from_poses(project_to_plane(robot), time, f"{bag.path}, {topic}")


def _odometry_topic(bag: Bag) -> str | None:
    there = bag.topics(POSES[:1])
    return next((each for each in there if not any(word in each.lower() for word in TRUE)), None)


def _truth(bag: Bag, zero: float) -> Truth:
    for topic in bag.topics(POSES):
        if any(word in topic.lower() for word in TRUE):
            poses = _poses(bag, topic, zero)
            return Truth(project_to_plane(poses), off_plane_components(poses))
    return Truth()


def _poses(bag: Bag, topic: str, zero: float) -> Poses:
    found = [(seconds_of(message) - zero, *pose_of(message)) for _, message in bag.messages(topic)]
    table = measured(sorted(found), f"{bag.path}, {topic}")
    return Poses(table[:, 0], rotations(table[:, 4:], f"{bag.path}, {topic}"), table[:, 1:4])


def _nearest(topics: list[str], to: str) -> str:
    """The topic that shares most of its namespace with another one."""
    return max(topics, key=lambda topic: len(commonpath([topic, to])))


def _listed(bag: Bag) -> str:
    return ", ".join(sorted({each.topic for each in bag.reader.connections})) or "no topic"


def _first_line(error: Exception) -> str:
    return reason_of(error).partition("\n")[0]
