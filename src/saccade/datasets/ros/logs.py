"""Landmark logs from ROS 1 bags (.bag) and ROS 2 bags (a folder with metadata.yaml).

Landmarks are of the first topic of a known type, or of those that are wanted. Their
positions are transformed into the frame of the robot, that of the odometry, by tf at the time of
each, and projected to the ground. Odometry is of nav_msgs Odometry, or of tf, from odom
to the robot.
Ground truth of the robot is a topic with "truth", "gt", "vicon" or "mocap" in its name.

Times are those of the headers, from the first odometry on. There is a pose at every time of an
observation, and others between them. Needs the extra `ros`.

Types of landmarks are recognized by their names without the package:

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
"""

import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.datasets.drives.odometry import OdometryIncrements, compose_increments
from saccade.datasets.drives.sidecar_files import project_to_plane
from saccade.datasets.logs.conversions import (
    ASSUMED_ODOMETRY,
    ASSUMED_SENSOR,
    OdometryNoise,
    sensor_variances,
    to_range_bearing,
)
from saccade.datasets.ros.bags import (
    FIELDS,
    Bag,
    Transforms,
    bare,
    pose_of,
    poses_from,
    stamp_of,
)
from saccade.datasets.tables import LARGEST
from saccade.errors import LogError, LogWarning
from saccade.io.files import reading
from saccade.plane import path_of, steps_between
from saccade.types import BoolArray, FloatArray, LandmarkLog, Trajectory

OTHER_TOPICS = ("map", "path", "particle", "cloud", "goal", "plan", "traj", "truth")
"""Words in the names of topics that are chosen last: they rarely are observations."""
TF_DELAY = 1e-3
"""Seconds from a detection to the transform of its tag, which has the same stamp."""
_ADD, _AT_POSE = 0, (0, 1, 2, 3, 10)
"""Action of a Marker; types of those with one position: arrow, cube, sphere, cylinder and mesh."""
IN_TF = (np.nan, np.nan, np.nan)
"""Position of a tag that the message does not have: it is a frame of tf."""


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
    if found and found[0].position is IN_TF:
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
            yield Detection(name, time, camera, IN_TF, np.zeros((3, 3)))


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
    """Tags by the transforms of their times; those without one keep the position NaN.

    Raises:
        LogError: none has a transform.
    """
    numbered = {(parent, _number(child)): child for parent, child in transforms.edges}
    placed = []
    for each in found:
        own = numbered.get((each.frame, _number(each.name)), "")
        poses = transforms.edges.get(
            (each.frame, each.name), transforms.edges.get((each.frame, own))
        )
        delay = np.abs(poses.time - each.time) if poses is not None else np.array([np.inf])
        if poses is not None and delay.min() < TF_DELAY:
            x, y, z = poses.position[delay.argmin()].tolist()
            each = each._replace(position=(x, y, z))
        placed.append(each)
    if np.isnan([each.position for each in placed]).all():
        raise LogError(
            f"{name}: expected transforms from {found[0].frame} to the frames of tags, such as "
            f"{found[0].name}, at the times of their detections; found {transforms.frames}"
        )
    return placed


MAX_STEP = 0.5
"""Seconds: poses are inserted between observations that are farther apart."""
MIN_RANGE = 1e-3
"""Metres: a landmark that is nearer, above or below the robot's origin, has no bearing."""
BASES = ("base_link", "base_footprint")
"""Names of the robot's frame, where odometry does not say it."""
PLANE = [0, 7, 35]
"""Variances of x, y and heading among the 36 numbers of a covariance of ROS."""
MAX_SPEED = 50.0
"""Metres and radians per second; faster odometry was reset, and is no motion."""
UNKNOWN_SPEED = 0.5
"""Standard deviation of the speed while it was reset, in metres and radians per second."""
MAX_RATE_VARIANCE = 100.0
"""Variance of a speed in square metres and radians per second that stands for unknown."""
MAX_DURATION = 1e5
"""Seconds; a longer log has a corrupt time stamp."""


class BagOdometry(NamedTuple):
    """n poses of a robot by its odometry."""

    source: str
    """The topic, or the frames of tf."""
    base: str
    """The frame of the robot."""
    poses: Trajectory
    """From the first on; the robot stands still where odometry was reset."""
    covariance: FloatArray
    """(n - 1, 3, 3) of the motion to each pose in the frame of the previous."""

    def between(self, time: FloatArray) -> OdometryIncrements:
        """Motions between times (m + 1,) in seconds, strictly ascending, within the poses."""
        known = self.poses.time
        knots = np.union1d(known[(known > time[0]) & (known < time[-1])], time)
        interval = np.searchsorted(known, knots[:-1], side="right") - 1
        part = (np.diff(knots) / np.diff(known)[interval])[:, None, None]
        pieces = OdometryIncrements(
            steps_between(self.poses.at(knots)), part * self.covariance[interval]
        )
        return compose_increments(pieces, np.searchsorted(knots, time), self.source)


def _read_odometry(bag: Bag, transforms: Transforms, noise: OdometryNoise) -> BagOdometry:
    """Odometry of a bag.

    Motions have the variances of the twist, independent in each message, where it has such; else
    those of `noise`.

    Raises:
        LogError: there is none, or too little.
    """
    topic = bag.odometry_topic()
    if topic is not None:
        messages = {stamp_of(message.header): message for _, message in bag.messages(topic)}
        ordered = sorted(messages.items())
        rows = [(time, *pose_of(message)) for time, message in ordered]
        path = project_to_plane(poses_from(rows, f"{bag.path}, {topic}"))
        twist = [np.asarray(m.twist.covariance, np.float64)[PLANE] for _, m in ordered]
        base = bare(ordered[0][1].child_frame_id)
        if not base:
            base = next((each for each in BASES if transforms.has(each)), BASES[0])
        return _odometry(f"{bag.path}, {topic}", topic, base, path, np.array(twist), noise)
    for (parent, base), poses in transforms.edges.items():
        if parent.endswith("odom") and len(poses.time) > 1:
            source, unknown = f"{parent} to {base}", np.zeros((len(poses.time), 3))
            path = project_to_plane(poses)
            return _odometry(f"{bag.path}, {source}", source, base, path, unknown, noise)
    raise LogError(
        f"{bag.path}: expected nav_msgs/msg/Odometry, or transforms from odom; found "
        f"{bag.all_topics()}, and transforms of {transforms.frames}"
    )


def _odometry(
    name: str, source: str, base: str, path: Trajectory, twist: FloatArray, noise: OdometryNoise
) -> BagOdometry:
    """Odometry by poses (n,), and the variances (n, 3) of speeds and turn rate at each."""
    span = float(np.ptp(path.time))
    if not 0 < span < MAX_DURATION:
        raise LogError(
            f"{name}: expected odometry over up to {MAX_DURATION:.0f} s, found {span:g} s"
        )
    motion, duration = steps_between(path.pose), np.diff(path.time)[:, None]
    distance, turn = np.hypot(motion[:, 0], motion[:, 1]), np.abs(motion[:, 2])
    along, heading = noise.variances(distance, turn)
    variance, twist = np.stack([along, along, heading], 1), twist[1:]
    is_known = ((twist >= 0) & (twist < MAX_RATE_VARIANCE)).all(1) & (twist > 0).any(1)
    variance[is_known] = (np.square(duration) * twist)[is_known]
    is_reset = np.maximum(distance, turn) > MAX_SPEED * duration[:, 0]
    motion[is_reset], variance[is_reset] = 0.0, np.square(UNKNOWN_SPEED * duration)[is_reset]
    if is_reset.any():
        count = int(is_reset.sum())
        _warn(f"{name} was reset {count} times; the motion there is unknown")
    poses = Trajectory(path.time, path_of(motion))
    return BagOdometry(source, base, poses, variance[:, :, None] * np.eye(3))


def _warn(message: str) -> None:
    warnings.warn(message, LogWarning, stacklevel=5)


def read_rosbag_log(
    path: str | Path,
    topic: Sequence[str] = (),
    odometry_noise: OdometryNoise = ASSUMED_ODOMETRY,
    sensor_sigma: tuple[float, float] = ASSUMED_SENSOR,
) -> LandmarkLog:
    """A landmark log from a bag; its name has the topics that were used.

    Warns (`LogWarning`) of observations that are left out and of odometry that was reset.

    Args:
        path: the bag.
        topic: topics of landmarks, as of several cameras; by default one is chosen by its type.
        odometry_noise: of odometry whose twist has no covariance.
        sensor_sigma: of observations without covariance: fraction of the range, and radians.

    Raises:
        LogError: the file is no bag, or lacks landmarks, odometry, or transforms between them.
        ConfigError: the extra is not installed.
    """
    path = Path(path)
    with reading(str(path), LogError, *FIELDS):
        bag = Bag(path)
        topics, transforms = landmark_topics(bag, topic), Transforms.read(bag)
        odometry = _read_odometry(bag, transforms, odometry_noise)
        detections = [each for name in topics for each in read_detections(bag, name, transforms)]
        return _log(bag, ", ".join(topics), odometry, transforms, detections, sensor_sigma)


def _log(
    bag: Bag,
    topics: str,
    odometry: BagOdometry,
    transforms: Transforms,
    detections: list[Detection],
    sensor_sigma: tuple[float, float],
) -> LandmarkLog:
    name, (first, last) = f"{bag.path}, {topics}", odometry.poses.time[[0, -1]].tolist()
    detections = sorted(detections, key=lambda each: each.time)
    position, covariance = _on_robot(detections, transforms, odometry.base, name)
    time = np.array([each.time for each in detections])
    usable = (time >= first) & (time <= last) & _is_measured(position)
    if not usable.any():
        raise LogError(
            f"{name}: expected landmarks while there is odometry, from {first:.3f} to "
            f"{last:.3f} s; found {len(detections)} at other times, or without a position"
        )
    if not usable.all():
        _warn(
            f"{name}: {int((~usable).sum())} of {len(usable)} landmarks left out, without odometry "
            "at their time, or without a position"
        )
    observation, R = to_range_bearing(
        position[usable, :2], covariance[usable, :2, :2], lambda k: f"{name}, landmark {k}"
    )
    unknown = ~(np.linalg.eigvalsh(covariance[usable, :2, :2])[:, 0] > 0)
    variances = sensor_variances(observation[unknown, 0], sensor_sigma)
    R[unknown] = variances[:, :, None] * np.eye(2)

    grid = np.linspace(first, last, int(np.ceil((last - first) / MAX_STEP)) + 1)
    pose_time = np.union1d(grid, time[usable])
    motion = odometry.between(pose_time)
    truth_name = bag.truth_topic()
    truth = None if truth_name is None else project_to_plane(bag.poses(truth_name, first))
    return LandmarkLog(
        name=f"{bag.path.stem}, {topics} with {odometry.source}",
        start=np.zeros(3) if truth is None else truth.at(np.zeros(1))[0],
        time=pose_time - first,
        motion="compose",
        control=motion.control,
        control_covariance=motion.covariance,
        observation_pose=np.searchsorted(pose_time, time[usable]).astype(np.int64),
        observation=observation,
        observation_covariance=R,
        landmark=identities([each.name for each in detections])[usable],
        truth=truth,
    )


def _on_robot(
    detections: list[Detection], transforms: Transforms, base: str, name: str
) -> tuple[FloatArray, FloatArray]:
    """Positions (k, 3) in the frame of the robot, and their covariances (k, 3, 3)."""
    position = np.array([each.position for each in detections]).reshape(-1, 3)
    covariance = np.array([each.covariance for each in detections]).reshape(-1, 3, 3)
    covariance = np.where(np.isfinite(covariance).all((1, 2), keepdims=True), covariance, 0.0)
    covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
    time = np.array([each.time for each in detections])
    frames = np.array([each.frame for each in detections])
    for frame in np.unique(frames).tolist():
        rows = np.flatnonzero(frames == frame)
        poses = transforms.poses(base, frame, time[rows])
        if poses is None:
            raise LogError(
                f"{name}: expected transforms from {base} to {frame!r}, found {transforms.frames}"
            )
        R = poses.rotation
        position[rows] = np.einsum("nij,nj->ni", R, position[rows]) + poses.position
        covariance[rows] = R @ covariance[rows] @ R.transpose(0, 2, 1)
    return position, covariance


def _is_measured(position: FloatArray) -> BoolArray:
    """Which positions (k, 3) have a range and a bearing."""
    bounded = (np.abs(position) < LARGEST).all(1)
    x, y = np.where(np.expand_dims(bounded, 1), position[:, :2], 0.0).T
    return np.asarray(bounded & (np.hypot(x, y) > MIN_RANGE))
