"""Landmark logs from ROS 1 bags (.bag) and ROS 2 bags (.mcap, .db3, or their folder).

Landmarks are read from the given topics, or from the first topic of a known type
(`messages.MESSAGE_TYPES`). Positions are transformed by tf to the robot frame at the time of
observation, and projected to the ground. Odometry is nav_msgs Odometry, or the transform from odom
to the robot. Ground truth of the robot is a topic with "truth", "vicon", "mocap" or the word "gt"
in its name.

Times are those of the message headers. The log has a pose at the time
of every observation, and additional poses in between. Needs the extra `ros`.
"""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from saccade.datasets.drives.odometry import OdometryIncrements, compose_increments
from saccade.datasets.logs.conversions import (
    ASSUMED_ODOMETRY,
    ASSUMED_SENSOR,
    OdometryNoise,
    sensor_variances,
    start_of,
)
from saccade.datasets.ros.bags import FIELDS, Bag, Transforms, bare, pose_of, poses_from, stamp_of
from saccade.datasets.ros.messages import Detection, landmark_topics, parse_labels, read_detections
from saccade.datasets.tables import LARGEST, MAX_DURATION
from saccade.errors import LogError, LogWarning
from saccade.frames import Poses
from saccade.io.files import reading
from saccade.plane import long_steps, path_of, steps_between, to_range_bearing
from saccade.types import FloatArray, LandmarkLog, Trajectory

MAX_STEP = 0.5
"""Maximum time between poses of the log, in seconds."""
MIN_LANDMARK_RANGE = 1e-3
"""Minimum range of a landmark with a bearing, in meters."""
BASE = "base_link"
"""Name of the robot frame, if the odometry has no frame name."""
PLANE = [0, 7, 35]
"""Indices of the variances of x, y and heading in a ROS covariance of 36 numbers."""
MAX_SPEED = 50.0
"""Maximum speed in meters or radians per second; beyond it the odometry was reset."""
RESET_SPEED = 0.5
"""Standard deviation of the speed during a reset, in meters or radians per second."""
MAX_RATE_VARIANCE = 100.0
"""Minimum variance of a speed that means unknown, in SI units."""


class BagOdometry(NamedTuple):
    """n odometry poses of a robot."""

    source: str
    """Topic, or frames of tf."""
    base: str
    """The frame of the robot."""
    poses: Trajectory
    """Poses relative to the first; without motion during resets."""
    covariance: FloatArray
    """(n - 1, 3, 3) covariance of the motion to each pose, in the frame of the previous pose."""

    def between(self, time: FloatArray) -> OdometryIncrements:
        """Motions between times (m + 1,) in seconds, strictly ascending, within the poses."""
        known = self.poses.time
        knots = np.union1d(known[(known > time[0]) & (known < time[-1])], time)
        interval = np.searchsorted(known, knots[:-1], side="right") - 1
        part = (np.diff(knots) / np.diff(known)[interval])[:, None, None]
        pieces = OdometryIncrements(
            steps_between(self.poses.interpolate(knots)), part * self.covariance[interval]
        )
        return compose_increments(pieces, np.searchsorted(knots, time), self.source)


def _read_odometry(bag: Bag, transforms: Transforms, noise: OdometryNoise) -> BagOdometry:
    """Odometry of a bag, from its topic or from tf.

    Variances come from the twist, independent in each message, or else from `noise`.
    """
    topic = bag.odometry_topic()
    if topic is not None:
        messages = {stamp_of(message.header): message for _, message in bag.messages(topic)}
        ordered = sorted(messages.items())
        rows = [(time, *pose_of(message)) for time, message in ordered]
        poses = poses_from(rows, f"{bag.path}, {topic}")
        twist = [np.asarray(m.twist.covariance, np.float64)[PLANE] for _, m in ordered]
        base = bare(ordered[0][1].child_frame_id) or BASE
        return _odometry(bag, topic, base, poses, np.array(twist), noise)
    for (parent, base), poses in transforms.edges.items():
        if parent.endswith("odom") and len(poses.time) > 1:
            unknown = np.zeros((len(poses.time), 3))
            return _odometry(bag, f"{parent} to {base}", base, poses, unknown, noise)
    raise LogError(
        f"{bag.path}: expected nav_msgs/msg/Odometry, or transforms from odom; found "
        f"{bag.all_topics()}, and transforms of {transforms.frames}"
    )


def _odometry(
    bag: Bag, source: str, base: str, poses: Poses, twist: FloatArray, noise: OdometryNoise
) -> BagOdometry:
    """Odometry from poses (n,) and the variances (n, 3) of speeds and turn rate at each pose."""
    path, span = poses.on_plane, float(np.ptp(poses.time))
    if not 0 < span < MAX_DURATION:
        raise LogError(
            f"{bag.path}, {source}: expected odometry over up to {MAX_DURATION:.0f} s, found "
            f"{span:g} s"
        )
    motion, duration = steps_between(path.pose), np.diff(path.time)[:, None]
    distance, turn = np.hypot(motion[:, 0], motion[:, 1]), np.abs(motion[:, 2])
    along, heading = noise.variances(distance, turn)
    variance, twist = np.stack([along, along, heading], 1), twist[1:]
    is_known = ((twist >= 0) & (twist < MAX_RATE_VARIANCE)).all(1) & (twist > 0).any(1)
    variance[is_known] = (np.square(duration) * twist)[is_known]
    is_reset = np.maximum(distance, turn) > MAX_SPEED * duration[:, 0]
    is_reset |= long_steps(path.time, path.pose)[1]
    motion[is_reset], variance[is_reset] = 0.0, np.square(RESET_SPEED * duration)[is_reset]
    if is_reset.any():
        count = int(is_reset.sum())
        _warn(f"{bag.path}, {source} was reset {count} times; the motion there is unknown")
    path = Trajectory(path.time, path_of(motion))
    return BagOdometry(source, base, path, variance[:, :, None] * np.eye(3))


def _warn(message: str) -> None:
    warnings.warn(message, LogWarning, stacklevel=5)


def read_rosbag_log(
    path: str | Path,
    topic: Sequence[str] = (),
    odometry_noise: OdometryNoise = ASSUMED_ODOMETRY,
    sensor_sigma: tuple[float, float] = ASSUMED_SENSOR,
) -> LandmarkLog:
    """A landmark log from a bag; its name lists the topics in use.

    Issues a `LogWarning` for omitted observations and for resets of the odometry.

    Args:
        path: the bag.
        topic: landmark topics, for example of several cameras; by default the first topic of a
            known type.
        odometry_noise: noise of odometry without covariance in the twist.
        sensor_sigma: standard deviations of observations without covariance: range, as a
            fraction, and bearing in radians.
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
    xy, covariance = _on_robot(detections, transforms, odometry.base, name)
    time = np.array([each.time for each in detections])
    usable = (time >= first) & (time <= last)
    usable &= np.hypot(*xy.T) > MIN_LANDMARK_RANGE  # False for NaN
    if not usable.any():
        raise LogError(
            f"{name}: expected landmarks during the odometry, {first:.3f} to {last:.3f} s; found "
            f"{len(detections)} at other times or without a position"
        )
    if not usable.all():
        _warn(
            f"{name}: left out {int((~usable).sum())} of {len(usable)} landmarks without odometry "
            "at their time or without a position"
        )
    observation, R = to_range_bearing(
        xy[usable], covariance[usable], lambda k: f"{name}, landmark {k}"
    )
    unknown = ~(np.linalg.eigvalsh(covariance[usable])[:, 0] > 0)
    variances = sensor_variances(observation[unknown, 0], sensor_sigma)
    R[unknown] = variances[:, :, None] * np.eye(2)
    grid = np.linspace(first, last, int(np.ceil((last - first) / MAX_STEP)) + 1)
    pose_time = np.union1d(grid, time[usable])
    motion = odometry.between(pose_time)
    truth_name = bag.truth_topic()
    truth = None if truth_name is None else bag.poses(truth_name).on_plane
    return LandmarkLog(
        name=f"{bag.path.stem}, {topics} with {odometry.source}",
        start=start_of(truth, first, name),
        time=pose_time,
        control=motion.control,
        control_covariance=motion.covariance,
        observation_pose=np.searchsorted(pose_time, time[usable]).astype(np.int64),
        observation=observation,
        observation_covariance=R,
        landmark=parse_labels([each.label for each in detections])[usable],
        truth=truth,
    )


def _on_robot(
    detections: list[Detection], transforms: Transforms, base: str, name: str
) -> tuple[FloatArray, FloatArray]:
    """Positions (k, 2) on the ground in the robot frame, with covariances (k, 2, 2).

    Unmeasured positions are NaN, unknown covariances are zero.
    """
    position = np.array([each.position for each in detections]).reshape(-1, 3)
    position[~(np.abs(position) < LARGEST).all(1)] = np.nan
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
    return position[:, :2], covariance[:, :2, :2]
