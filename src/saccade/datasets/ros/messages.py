"""Landmarks in ROS messages: a table with one line per message type."""

import re
from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.datasets.ros.bags import Bag, Transforms, bare, pose_of, stamp_of
from saccade.errors import LogError
from saccade.types import FloatArray

TF_DELAY = 1e-3
"""Maximum difference in seconds between the stamps of a detection and of its tag's transform."""


class Detection(NamedTuple):
    """A landmark in a message."""

    label: str
    """Label; empty if unknown."""
    time: float
    """Seconds."""
    frame: str
    """Frame of the position."""
    position: tuple[float, float, float]
    """Position in meters; NaN if the message has none and the tag is a tf frame."""
    covariance: FloatArray
    """(3, 3) in square meters; zero if unknown."""


class MessageType(NamedTuple):
    """Fields of a type of message."""

    items: str
    """Field with the list of landmarks."""
    label: Callable[[Any], object]
    """Label of a landmark."""
    pose: Callable[[Any], Any] | None
    """Pose of a landmark; None if tf has the transform from the camera to the label."""


def _detected_pose(detection: Any) -> Any:
    """Pose of the first hypothesis of a Detection3D, else of its box."""
    poses = [each.pose for each in detection.results]
    return next((each for each in poses if any(pose_of(each)[:3])), detection.bbox.center)


def _detection_label(detection: Any) -> str:
    """`id`, or `tracking_id` in older versions; never the class."""
    return str(getattr(detection, "id", getattr(detection, "tracking_id", "")))


def _family_and_id(tag: Any) -> str:
    return f"{tag.family}:{tag.id}"


MESSAGE_TYPES = {
    "apriltag_ros/msg/AprilTagDetectionArray": MessageType(
        "detections", lambda tag: tag.id[0], attrgetter("pose")
    ),
    "apriltag_msgs/msg/AprilTagDetectionArray": MessageType("detections", _family_and_id, None),
    "ar_track_alvar_msgs/msg/AlvarMarkers": MessageType(
        "markers", attrgetter("id"), attrgetter("pose")
    ),
    "aruco_opencv_msgs/msg/ArucoDetection": MessageType(
        "markers", attrgetter("marker_id"), attrgetter("pose")
    ),
    "aruco_msgs/msg/MarkerArray": MessageType("markers", attrgetter("id"), attrgetter("pose")),
    "fiducial_msgs/msg/FiducialTransformArray": MessageType(
        "transforms", attrgetter("fiducial_id"), attrgetter("transform")
    ),
    "vision_msgs/msg/Detection3DArray": MessageType("detections", _detection_label, _detected_pose),
    "geometry_msgs/msg/PoseArray": MessageType("poses", lambda pose: "", lambda pose: pose),
}
"""Message types with landmarks, in the order of the default choice."""


def landmark_topics(bag: Bag, wanted: Sequence[str] = ()) -> list[str]:
    """The given landmark topics; by default the first topic by type, then by name."""
    topics = [topic for kind in MESSAGE_TYPES for topic in bag.topics((kind,))]
    missing = [topic for topic in wanted if topic not in topics]
    if not topics or missing:
        expected = f"the topic {missing[0]}" if missing else "a topic"
        raise LogError(
            f"{bag.path}: expected {expected} of {', '.join(MESSAGE_TYPES)}; found "
            f"{bag.all_topics()}"
        )
    return list(wanted) or topics[:1]


def read_detections(bag: Bag, topic: str, transforms: Transforms) -> list[Detection]:
    """The landmarks in all messages of a topic."""
    kind = MESSAGE_TYPES[bag.kind(topic)]
    found = [
        each
        for stamp, message in bag.messages(topic)
        for each in _detections(kind, message, 1e-9 * stamp)
    ]
    if kind.pose is not None or not found:
        return found
    placed = [_in_tag_frame(each, transforms) for each in found]
    if np.isnan([each.position for each in placed]).all():
        raise LogError(
            f"{bag.path}, {topic}: expected transforms from {found[0].frame} to the frames of "
            f"tags, such as {found[0].label}, at the times of their detections; found "
            f"{transforms.frames}"
        )
    return placed


def _detections(kind: MessageType, message: Any, recorded: float) -> Iterator[Detection]:
    """The landmarks of a message that was recorded at a time in seconds.

    Time and frame come from the first header that has them: pose, landmark, then message.
    """
    for each in getattr(message, kind.items):
        pose: Any = kind.pose and kind.pose(each)
        headers, covariance = [], np.zeros((3, 3))
        nested = pose
        while hasattr(nested, "pose"):
            headers += [nested.header] if hasattr(nested, "header") else []
            if hasattr(nested, "covariance"):
                covariance = np.reshape(np.asarray(nested.covariance, np.float64), (6, 6))[:3, :3]
            nested = nested.pose
        headers += [owner.header for owner in (each, message) if hasattr(owner, "header")]
        frames = [bare(header.frame_id) for header in headers]
        x, y, z = (np.nan, np.nan, np.nan) if pose is None else map(float, pose_of(pose)[:3])
        yield Detection(
            label=str(kind.label(each)),
            time=next(filter(None, map(stamp_of, headers)), recorded),
            frame=next(filter(None, frames), ""),
            position=(x, y, z),
            covariance=covariance,
        )


def _in_tag_frame(tag: Detection, transforms: Transforms) -> Detection:
    """The tag positioned by its transform at the same time; NaN without such a transform."""
    poses = transforms.edges.get((tag.frame, tag.label))
    if poses is None:
        return tag
    delay = np.abs(poses.time - tag.time)
    if delay.min() >= TF_DELAY:
        return tag
    x, y, z = poses.position[delay.argmin()].tolist()
    return tag._replace(position=(x, y, z))


def parse_labels(names: Sequence[str]) -> npt.NDArray[Any]:
    """Labels (k,): the trailing numbers of the names, -1 for none; the names if ambiguous."""
    distinct = set(names) - {""}
    endings = {name: _number(name) for name in distinct}
    if len(set(endings.values()) - {None}) < len(distinct):
        return np.array(names, object)
    return np.array([endings[name] if name else -1 for name in names], np.int64)


def _number(name: str) -> int | None:
    """The trailing number of a name."""
    ending = re.search(r"(?<![0-9])[0-9]{1,15}$", name)
    return None if ending is None else int(ending[0])
