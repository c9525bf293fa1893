"""A ROS 2 node: odometry and detected landmarks in, pose with covariance, tf and map out.

    python slam_node.py --ros-args -r odom:=/wheel/odometry -r detections:=/tags -p known:=true

| topic | message | |
|---|---|---|
| `odom` | `nav_msgs/Odometry` | read; its twist covariance is the noise, if it has one |
| `detections` | `vision_msgs/Detection3DArray` | read; `id`: a number, where `known` |
| `pose` | `geometry_msgs/PoseWithCovarianceStamped` | written after every scan, in `map` |
| `landmarks` | `visualization_msgs/MarkerArray` | written after every scan: 3 sigma ellipses |
| `/tf` | `map` to the frame of the odometry | written after every scan |

`ScanQueue` is what the callbacks do, without ROS: it takes messages in any order, waits until
odometry covers a scan, and composes odometry to the control between two scans.
"""

from bisect import bisect_left, insort
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from saccade import slam

PLANE = np.ix_((0, 1, 5), (0, 1, 5))
"""Rows and columns of x, y and heading in a covariance of ROS, (6, 6)."""


@dataclass(frozen=True)
class NodeConfig:
    """Noise where messages give none, and what becomes of messages that are late or missing."""

    distance_sigma: float = 0.05
    """Standard deviation of odometry after one metre, in metres."""
    turn_sigma: float = 0.05
    """The same after one metre or a turn of one radian, in radians."""
    range_sigma: float = 0.05
    """Standard deviation of a detection's range, as a fraction of it."""
    bearing_sigma: float = 0.02
    """The same of its bearing, in radians."""
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Metres, metres, radians: the frame of the detections in that of the robot."""
    max_wait: float = 0.5
    """Seconds that a scan waits for odometry."""
    max_speed: float = 5.0
    """Metres and radians per second; faster odometry was reset, and is no motion."""
    unknown_speed: float = 0.5
    """Standard deviation of the velocity while there is no odometry, in metres and radians per
    second."""


class Odometry(NamedTuple):
    """One message."""

    time: float
    """Seconds."""
    pose: np.ndarray
    """(3,) in the frame of the odometry."""
    rate_covariance: np.ndarray | None
    """(3, 3) of the velocity in the frame of the robot."""


class Scan(NamedTuple):
    """One message of detections."""

    time: float
    z: np.ndarray
    R: np.ndarray
    names: np.ndarray


class Update(NamedTuple):
    """A step of the filter."""

    time: float
    """Seconds since the first message."""
    step: slam.StepResult
    map_to_odom: np.ndarray | None
    """(3,) pose of the frame of the odometry in the map; None without odometry."""


@dataclass
class ScanQueue:
    """Brings messages into the order of their stamps, and passes them to the filter."""

    filter: slam.Slam
    config: NodeConfig = field(default_factory=NodeConfig)
    dropped: int = 0
    """Scans that came after a later one had been processed."""
    restarts: int = 0
    """Clocks that went back, and odometry that was reset."""
    _odometry: list[Odometry] = field(default_factory=list)
    _scans: list[Scan] = field(default_factory=list)
    _origin: int | None = None
    _now: float = 0.0
    _last: float | None = None

    def on_odometry(self, message: Any) -> list[Update]:
        """Take a `nav_msgs/Odometry`; gives the steps that this makes possible."""
        time = self._seconds(message.header.stamp)
        rate = np.reshape(message.twist.covariance, (6, 6))[PLANE]
        known = bool((rate.diagonal() > 0).any())
        sample = Odometry(time, _pose(message.pose.pose), rate if known else None)
        i = self._index(time)
        if not (i < len(self._odometry) and self._odometry[i].time == time):
            self._odometry.insert(i, sample)
        return self._process()

    def on_detections(self, message: Any) -> list[Update]:
        """Take a `vision_msgs/Detection3DArray`; gives the steps that this makes possible."""
        time = self._seconds(message.header.stamp)
        if self._last is not None and time <= self._last:
            self.dropped += 1
            return []
        insort(self._scans, self._scan(time, message.detections), key=lambda each: each.time)
        return self._process()

    def _seconds(self, stamp: Any) -> float:
        """Seconds since the first message; a clock that goes back far starts anew."""
        nanoseconds = int(stamp.sec) * 10**9 + int(stamp.nanosec)
        if self._origin is None:
            self._origin = nanoseconds
        time = (nanoseconds - self._origin) * 1e-9
        if time < self._now - 10 * self.config.max_wait:
            self.restarts += 1
            self._origin = nanoseconds - round((self._now + self.config.max_wait) * 1e9)
            self._odometry, self._scans = [], []
            time = self._now + self.config.max_wait
        self._now = max(self._now, time)
        return time

    def _scan(self, time: float, detections: Any) -> Scan:
        detections = [each for each in detections if each.results]
        k, (x0, y0, yaw) = len(detections), self.config.mount
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.array([[c, -s], [s, c]])
        xy, C, names = np.empty((k, 2)), np.empty((k, 2, 2)), np.full(k, -1)
        for i, each in enumerate(detections):
            pose = each.results[0].pose
            xy[i] = turn @ (pose.pose.position.x, pose.pose.position.y) + (x0, y0)
            C[i] = turn @ np.reshape(pose.covariance, (6, 6))[:2, :2] @ turn.T
            names[i] = int(each.id) if each.id.isdecimal() else -1
        z = np.stack([np.hypot(*xy.T), np.arctan2(xy[:, 1], xy[:, 0])], 1)
        H = slam.observe(np.zeros(3), xy)[1][:, :, 3:]  # (k, 2, 2) by the position
        R = H @ C @ H.transpose(0, 2, 1)
        sigma = np.stack([self.config.range_sigma * z[:, 0], np.full(k, self.config.bearing_sigma)])
        without = C.trace(axis1=1, axis2=2) <= 0
        R[without] = (sigma.T[:, :, None] ** 2 * np.eye(2))[without]
        finite = np.isfinite(z).all(1) & np.isfinite(R).all((1, 2))
        return Scan(time, z[finite], R[finite], names[finite])

    def _process(self) -> list[Update]:
        updates = []
        while self._scans:
            time = self._scans[0].time
            covered = len(self._odometry) > 0 and self._odometry[-1].time >= time
            if not covered and self._now - time <= self.config.max_wait:
                return updates
            updates.append(self._step(self._scans.pop(0)))
        wait, settled = self.config.max_wait, self._index(self._now - self.config.max_wait)
        if settled > 0:  # no scan is waited for that is older than these messages
            time = self._odometry[settled - 1].time
            last = self._odometry[0].time if self._last is None else self._last
            if self._now - last > 2 * wait and time > last:
                none = np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0, np.int64)
                updates.append(self._step(Scan(time, *none)))
        return updates

    def _step(self, scan: Scan) -> Update:
        control = U = None
        if self._last is None and self._odometry:
            self._last = min(scan.time, self._odometry[0].time)  # the filter starts there
        if self._last is not None and scan.time > self._last:
            control, U = self._control(self._last, scan.time)
        step = self.filter.step(scan.time, control, U, scan.z, scan.R, scan.names)
        self._last = scan.time
        update = Update(scan.time, step, self._map_to_odom(scan.time, step.pose))
        del self._odometry[: max(self._index(scan.time + 1e-9) - 2, 0)]
        return update

    def _index(self, time: float) -> int:
        """Number of odometry messages before a time."""
        return bisect_left(self._odometry, time, key=lambda each: each.time)

    def _control(self, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """The motion (3,) between two times, and its covariance (3, 3)."""
        inside = [each for each in self._odometry if start < each.time < end]
        known = self._odometry[:1] + self._odometry[-1:]
        times = [t for t in (start, end) if known and known[0].time <= t <= known[-1].time]
        knots = sorted([*inside, *map(self._at, times)], key=lambda each: each.time)
        moved, C, covered = np.zeros(3), np.zeros((3, 3)), 0.0
        for one, other in pairwise(knots):
            dt = other.time - one.time
            motion, U = self._increment(one, other, dt)
            moved, Fx, Fu = slam.compose(moved, motion)
            C = Fx @ C @ Fx.T + Fu @ U @ Fu.T
            covered += dt
        unknown = max(end - start - covered, 0.0)
        moved = slam.compose(moved, unknown * self._velocity())[0]
        return moved, C + (self.config.unknown_speed * unknown) ** 2 * np.eye(3)

    def _velocity(self) -> np.ndarray:
        """(3,) per second, by the last two messages; a robot without odometry goes on like that."""
        if len(self._odometry) < 2:
            return np.zeros(3)
        one, other = self._odometry[-2:]
        velocity = _relative(one.pose, other.pose) / (other.time - one.time)
        return velocity if np.abs(velocity).max() <= self.config.max_speed else np.zeros(3)

    def _increment(
        self, one: Odometry, other: Odometry, dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        motion = _relative(one.pose, other.pose)
        distance, turn = np.hypot(*motion[:2]), abs(motion[2])
        if max(distance, turn) > self.config.max_speed * dt:
            self.restarts += 1
            return np.zeros(3), (self.config.unknown_speed * dt) ** 2 * np.eye(3)
        if other.rate_covariance is not None:
            whole = self._interval(other.time)  # of which dt is a part, with a part of the variance
            return motion, other.rate_covariance * whole * dt
        along = self.config.distance_sigma**2 * distance
        return motion, np.diag([along, along, self.config.turn_sigma**2 * (distance + turn)])

    def _interval(self, time: float) -> float:
        """Seconds between the messages around a time."""
        i = max(self._index(time), 1)
        return self._odometry[i].time - self._odometry[i - 1].time

    def _at(self, time: float) -> Odometry:
        """Odometry at a time between the first and the last message, by interpolation."""
        i = self._index(time)
        after = self._odometry[i]
        if after.time == time:
            return after
        before = self._odometry[i - 1]
        part = (time - before.time) / (after.time - before.time)
        step = after.pose - before.pose
        step[2] = slam.wrap(step[2])
        return Odometry(time, before.pose + part * step, after.rate_covariance)

    def _map_to_odom(self, time: float, pose: np.ndarray) -> np.ndarray | None:
        if not self._odometry or not self._odometry[0].time <= time <= self._odometry[-1].time:
            return None
        return slam.compose(pose, _relative(self._at(time).pose, np.zeros(3)))[0]


def _pose(pose: Any) -> np.ndarray:
    """x, y and heading (3,) of a `geometry_msgs/Pose`."""
    q = pose.orientation
    heading = np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    return np.array([pose.position.x, pose.position.y, heading])


def _relative(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """A pose (3,) in the frame of another."""
    (dx, dy), c, s = (other - one)[:2], np.cos(one[2]), np.sin(one[2])
    return np.array([c * dx + s * dy, c * dy - s * dx, slam.wrap(other[2] - one[2])])


def fill_pose(pose: Any, values: np.ndarray) -> None:
    """Set a `geometry_msgs/Pose` to x, y and heading (3,)."""
    pose.position.x, pose.position.y = float(values[0]), float(values[1])
    pose.orientation.z, pose.orientation.w = np.sin(values[2] / 2), np.cos(values[2] / 2)


def ros_covariance(covariance: np.ndarray) -> list[float]:
    """The 36 numbers of ROS for a covariance (3, 3) of x, y and heading."""
    whole = np.zeros((6, 6))
    whole[PLANE] = covariance
    return whole.ravel().tolist()


def fill_marker(marker: Any, number: int, xy: np.ndarray, covariance: np.ndarray) -> None:
    """Make a `visualization_msgs/Marker` the 3 sigma ellipse of a landmark."""
    values, vectors = np.linalg.eigh(covariance)
    marker.id, marker.type, marker.ns = number, 2, "landmarks"  # 2: a sphere, scaled
    fill_pose(marker.pose, np.array([*xy, np.arctan2(vectors[1, 1], vectors[0, 1])]))
    minor, major = 6 * np.sqrt(np.maximum(values, 1e-6))
    marker.scale.x, marker.scale.y, marker.scale.z = float(major), float(minor), 0.02
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = 0.9, 0.6, 0.0, 0.7


def main() -> None:
    """Run the node."""
    import rclpy
    from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
    from nav_msgs.msg import Odometry as OdometryMessage
    from rclpy.node import Node
    from tf2_ros import TransformBroadcaster
    from vision_msgs.msg import Detection3DArray
    from visualization_msgs.msg import Marker, MarkerArray

    rclpy.init()
    node = Node("saccade_slam")
    known = node.declare_parameter("known", False).value
    config = slam.EkfConfig(association="known" if known else "mutual")
    queue = ScanQueue(slam.Slam(config))
    poses = node.create_publisher(PoseWithCovarianceStamped, "pose", 10)
    landmarks = node.create_publisher(MarkerArray, "landmarks", 1)
    broadcaster = TransformBroadcaster(node)
    frame = "odom"

    def publish(stamp: Any, update: Update) -> None:
        pose = PoseWithCovarianceStamped()
        pose.header.stamp, pose.header.frame_id = stamp, "map"
        fill_pose(pose.pose.pose, update.step.pose)
        pose.pose.covariance = ros_covariance(update.step.covariance)
        poses.publish(pose)
        if update.map_to_odom is not None:
            tf = TransformStamped()
            tf.header.stamp, tf.header.frame_id, tf.child_frame_id = stamp, "map", frame
            x, y, heading = update.map_to_odom.tolist()
            tf.transform.translation.x, tf.transform.translation.y = x, y
            tf.transform.rotation.z = np.sin(heading / 2)
            tf.transform.rotation.w = np.cos(heading / 2)
            broadcaster.sendTransform(tf)
        markers, found = MarkerArray(), queue.filter.map
        delete = Marker()
        delete.action = 3  # all
        markers.markers.append(delete)
        for i, xy in enumerate(found.xy):
            marker = Marker()
            marker.header.stamp, marker.header.frame_id = stamp, "map"
            fill_marker(marker, int(found.id[i]), xy, found.covariance[i])
            markers.markers.append(marker)
        landmarks.publish(markers)

    def handle(callback: Callable[[Any], list[Update]], message: Any) -> None:
        for update in callback(message):
            publish(message.header.stamp, update)

    def on_odometry(message: Any) -> None:
        nonlocal frame
        frame = message.header.frame_id
        handle(queue.on_odometry, message)

    node.create_subscription(OdometryMessage, "odom", on_odometry, 100)
    node.create_subscription(
        Detection3DArray, "detections", lambda message: handle(queue.on_detections, message), 10
    )
    rclpy.spin(node)


if __name__ == "__main__":
    main()
