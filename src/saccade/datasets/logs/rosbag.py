"""Landmark logs from ROS 1 bags (.bag) and ROS 2 bags (a folder with metadata.yaml).

Landmarks are of the first topic of a type in `ros_landmarks`, or of those that are wanted. Their
positions are transformed into the frame of the robot, that of the odometry, by tf at the time of
each, and projected to the ground. Odometry is of nav_msgs Odometry, or of tf (`ros_odometry`).
Ground truth of the robot is a topic with "truth", "gt", "vicon" or "mocap" in its name.

Times are those of the headers, from the first odometry on. There is a pose at every time of an
observation, and others between them. Needs the extra `ros`.
"""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from saccade.datasets.logs.conversions import (
    ASSUMED_ODOMETRY,
    ASSUMED_SENSOR,
    OdometryNoise,
    sensor_variances,
    to_range_bearing,
)
from saccade.datasets.logs.ros_landmarks import (
    Detection,
    identities,
    landmark_topics,
    read_detections,
)
from saccade.datasets.logs.ros_odometry import BagOdometry, read_odometry
from saccade.datasets.poses import project_to_plane
from saccade.datasets.ros_bags import Bag, read_poses, reading, truth_topic
from saccade.datasets.ros_transforms import Transforms
from saccade.datasets.tables import LARGEST
from saccade.errors import LogError, LogWarning, require
from saccade.types import BoolArray, FloatArray, LandmarkLog

MAX_STEP = 0.5
"""Seconds: poses are inserted between observations that are farther apart."""
MIN_RANGE = 1e-3
"""Metres: a landmark that is nearer, above or below the robot's origin, has no bearing."""


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
        odometry_noise: of odometry without covariance.
        sensor_sigma: of observations without covariance: fraction of the range, and radians.

    Raises:
        LogError: the file is no bag, or lacks landmarks, odometry, or transforms between them.
        ConfigError: a standard deviation that is not positive; the extra is not installed.
    """
    require(min(sensor_sigma) > 0, "sensor_sigma", "two positive numbers", sensor_sigma)
    path = Path(path)
    with reading(str(path), LogError):
        bag = Bag(path)
        topics, transforms = landmark_topics(bag, topic), Transforms.read(bag)
        odometry = read_odometry(bag, transforms, odometry_noise)
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
    _warn(name, usable, odometry)
    observation, R = to_range_bearing(
        position[usable, :2], covariance[usable, :2, :2], lambda k: f"{name}, landmark {k}"
    )
    unknown = ~(np.linalg.eigvalsh(covariance[usable, :2, :2])[:, 0] > 0)
    variances = sensor_variances(observation[unknown, 0], sensor_sigma)
    R[unknown] = variances[:, :, None] * np.eye(2)

    grid = np.linspace(first, last, int(np.ceil((last - first) / MAX_STEP)) + 1)
    pose_time = np.union1d(grid, time[usable])
    motion = odometry.between(pose_time)
    truth_name = truth_topic(bag)
    truth = None if truth_name is None else project_to_plane(read_poses(bag, truth_name, first))
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


def _warn(name: str, usable: BoolArray, odometry: BagOdometry) -> None:
    if not usable.all():
        warnings.warn(
            f"{name}: {int((~usable).sum())} of {len(usable)} landmarks left out, without odometry "
            "at their time, or without a position",
            LogWarning,
            stacklevel=4,
        )
    if odometry.is_reset.any():
        warnings.warn(
            f"{name}: {odometry.source} was reset {int(odometry.is_reset.sum())} times; the motion "
            "there is unknown",
            LogWarning,
            stacklevel=4,
        )
