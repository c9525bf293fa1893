"""Landmarks in messages of ROS.

    AprilTagDetectionArray   apriltag_ros and others: poses in the message; apriltag_msgs: the tags
                             are frames of tf, FAMILY:ID, or below the camera with a name that ends
                             in the number
    AlvarMarkers             ar_track_alvar_msgs
    ArucoDetection           aruco_opencv_msgs
    FiducialTransformArray   fiducial_msgs
    ObservationRangeBearing  mrpt_msgs
    Detection3DArray         vision_msgs, of ROS 1 and 2; identity by id (once tracking_id), never
                             by class; position of the first hypothesis, else of the box
    MarkerArray              visualization_msgs; markers that are added and have one position;
                             identity by namespace and id, unless ids count within each message;
                             or aruco_msgs
    PoseArray                geometry_msgs; without identities

Types are recognized by their names without the package.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.datasets.ros.bags import Bag, Transforms, bare, pose_of, stamp_of
from saccade.errors import LogError
from saccade.types import FloatArray

OTHER_TOPICS = ("map", "path", "particle", "cloud", "goal", "plan", "traj", "truth")
"""Words in the names of topics that are chosen last: they rarely are observations."""
TF_DELAY = 1e-3
"""Seconds from a detection to the transform of its tag, which has the same stamp."""
_ADD, _AT_POSE = 0, (0, 1, 2, 3, 10)
"""Action of a Marker; types of those with one position: arrow, cube, sphere, cylinder and mesh."""


class Detection(NamedTuple):
    """A landmark in a message."""

    name: str
    """Its identity; empty if unknown."""
    time: float
    """Seconds."""
    frame: str
    """The frame of its position."""
    position: tuple[float, float, float]
    """Metres."""
    covariance: FloatArray
    """(3, 3) in square metres; zero if unknown."""
    parent: str = ""
    """The frame of the sensor, if `frame` is the landmark's own, which moves in it."""


def landmark_topics(bag: Bag, wanted: Sequence[str] = ()) -> list[str]:
    """Topics with landmarks: those that are wanted, or the first by its type, then by its name.

    Raises:
        LogError: there is none, or a wanted one is of another type.
    """
    topics = [topic for kind in _READERS for topic in _by_name(bag.topics((kind,)))]
    missing = [topic for topic in wanted if topic not in topics]
    if not topics or missing:
        expected = f"the topic {missing[0]}" if missing else "a topic"
        raise LogError(
            f"{bag.path}: expected {expected} of {', '.join(_READERS)}; found {bag.all_topics()}"
        )
    return list(wanted) or topics[:1]


def _by_name(topics: list[str]) -> list[str]:
    return sorted(topics, key=lambda topic: any(word in topic.lower() for word in OTHER_TOPICS))


def read_detections(bag: Bag, topic: str, transforms: Transforms) -> list[Detection]:
    """The landmarks in all messages of a topic."""
    kind = bag.kind(topic)
    read = _READERS[kind.rpartition("/")[2]]
    scans = [list(read(each, 1e-9 * stamp)) for stamp, each in bag.messages(topic)]
    names = [[each.name for each in scan] for scan in scans]
    if kind == "visualization_msgs/msg/MarkerArray" and _are_counted(names):
        scans = [[each._replace(name="") for each in scan] for scan in scans]
    found = [each for scan in scans for each in scan]
    if found and found[0].parent:
        return _in_tag_frames(found, transforms, f"{bag.path}, {topic}")
    return found


def identities(names: Sequence[str]) -> npt.NDArray[Any]:
    """Names (k,) by the numbers in which they end, -1 for none; if ambiguous, as they are."""
    distinct = set(names) - {""}
    endings = {name: _number(name) for name in distinct}
    if len(set(endings.values()) - {None}) < len(distinct):
        return np.array(names, object)
    return np.array([endings[name] if name else -1 for name in names], np.int64)


def _number(name: str) -> int | None:
    """The number in which a name ends."""
    ending = re.search(r"(?<![0-9])[0-9]{1,15}$", name)
    return None if ending is None else int(ending[0])


Reader = Callable[[Any, float], Iterator[Detection]]
"""Gives the landmarks of a message that was recorded at a time."""


def _fields(items: str, number: str = "", pose: str = "") -> Reader:
    """Reader of messages whose landmarks have their number and pose in fields of these names."""

    def read(message: Any, recorded: float) -> Iterator[Detection]:
        for each in getattr(message, items):
            name = str(getattr(each, number)) if number else ""
            found = getattr(each, pose) if pose else each
            yield _detection(name, found, (each, message), recorded)

    return read


def _april_tags(message: Any, recorded: float) -> Iterator[Detection]:
    for each in message.detections:
        if hasattr(each, "pose"):
            number = int(np.ravel(each.id)[0])  # a bundle has several
            yield _detection(str(number), each.pose, (message,), recorded)
        else:
            name, camera = f"{each.family}:{each.id}", bare(message.header.frame_id)
            time = _time((message.header,), recorded)
            yield Detection(name, time, name, (0.0, 0.0, 0.0), np.zeros((3, 3)), camera)


def _ranges(message: Any, recorded: float) -> Iterator[Detection]:
    time, frame = _time((message.header,), recorded), bare(message.header.frame_id)
    sigma = message.sensor_std_range, message.sensor_std_yaw, message.sensor_std_pitch
    for each in message.sensed_data:
        (s, t), (c, u) = np.sin([each.yaw, each.pitch]), np.cos([each.yaw, each.pitch])
        ahead = np.array([u * c, u * s, -t])  # a positive pitch looks down
        across = np.array([-s, c, 0.0])
        axes = np.stack([ahead, each.range * u * across, each.range * np.cross(ahead, across)], 1)
        x, y, z = (each.range * ahead).tolist()
        name = str(each.id) if each.id >= 0 else ""
        yield Detection(name, time, frame, (x, y, z), axes @ np.diag(np.square(sigma)) @ axes.T)


def _objects(message: Any, recorded: float) -> Iterator[Detection]:
    for each in message.detections:
        name = getattr(each, "id", getattr(each, "tracking_id", ""))
        box, headers = each.bbox.center, (each, message)
        pose = each.results[0].pose if len(each.results) else box
        found = _detection(name, pose, headers, recorded)
        yield found if any(found.position) else _detection(name, box, headers, recorded)


def _markers(message: Any, recorded: float) -> Iterator[Detection]:
    if any(not hasattr(each, "action") for each in message.markers):  # those of aruco_msgs
        yield from _fields("markers", "id", "pose")(message, recorded)
        return
    for each in message.markers:
        if each.action == _ADD and each.type in _AT_POSE:
            yield _detection(f"{each.ns}:{each.id}", each.pose, (each,), recorded)


_READERS: dict[str, Reader] = {
    "AprilTagDetectionArray": _april_tags,
    "AlvarMarkers": _fields("markers", "id", "pose"),
    "ArucoDetection": _fields("markers", "marker_id", "pose"),
    "FiducialTransformArray": _fields("transforms", "fiducial_id", "transform"),
    "ObservationRangeBearing": _ranges,
    "Detection3DArray": _objects,
    "MarkerArray": _markers,
    "PoseArray": _fields("poses"),
}
"""By the name of a type, the most specific first."""


def _detection(name: str, pose: Any, owners: Sequence[Any], recorded: float) -> Detection:
    """A landmark by its pose: a Pose, one that is stamped or has a covariance, or a Transform.

    Time and frame are those of the first header that has them: of the pose, then of its owners.
    """
    headers, covariance = [], np.zeros((3, 3))
    while hasattr(pose, "pose"):
        if hasattr(pose, "header"):
            headers.append(pose.header)
        if hasattr(pose, "covariance"):
            covariance = np.reshape(np.asarray(pose.covariance, np.float64), (6, 6))[:3, :3]
        pose = pose.pose
    headers += [each.header for each in owners if hasattr(each, "header")]
    frame = next((bare(each.frame_id) for each in headers if bare(each.frame_id)), "")
    x, y, z = map(float, pose_of(pose)[:3])
    return Detection(name, _time(headers, recorded), frame, (x, y, z), covariance)


def _time(headers: Sequence[Any], recorded: float) -> float:
    """Seconds of the first header that has a stamp, else those of the recording."""
    return next(filter(None, map(stamp_of, headers)), recorded)


def _are_counted(scans: Sequence[Sequence[str]]) -> bool:
    """Whether the numbers of names count the landmarks of each scan, from 0 or from 1."""
    numbers = [[_number(name) for name in scan] for scan in scans if scan]
    counts = (
        all(each == list(range(first, first + len(each))) for each in numbers) for first in (0, 1)
    )
    return len({len(each) for each in numbers}) > 1 and any(counts)


def _in_tag_frames(found: list[Detection], transforms: Transforms, name: str) -> list[Detection]:
    """Landmarks in frames of their own; those without a transform at their time have NaN.

    Raises:
        LogError: none has a transform.
    """
    numbered = {(parent, _number(child)): child for parent, child in transforms.edges}
    placed = []
    for each in found:
        frame = each.frame
        if (each.parent, frame) not in transforms.edges:
            frame = numbered.get((each.parent, _number(each.name)), "")
        poses = transforms.edges.get((each.parent, frame))
        times = np.empty(0) if poses is None else poses.time
        first, last = np.searchsorted(times, [each.time - TF_DELAY, each.time + TF_DELAY])
        lost = each._replace(frame=each.parent, position=(np.nan, np.nan, np.nan))
        placed.append(each._replace(frame=frame) if first < last else lost)
    if np.isnan([each.position for each in placed]).all():
        raise LogError(
            f"{name}: expected transforms from {found[0].parent} to the frames of tags, such as "
            f"{found[0].name}, at the times of their detections; found {transforms.frames}"
        )
    return placed
