"""A simulated robot in six rooms with AprilTags, apart from the simulator of the package.

Rooms of 5 x 4 m in two rows, with doors. A differential drive visits the rooms in random order for
240 m in 20 minutes. Its camera sees tags on the walls where no wall is between. The log has wrong
labels, a drift of the heading, and, if asked for, wheels that differ or a robot that is moved.
"""

from dataclasses import dataclass, replace

import numpy as np

from saccade.types import LandmarkLog, LandmarkMap, Trajectory

ROOM = 5.0, 4.0  # meters
ROOMS = 3, 2
DOOR = 1.0  # meters
SPEED, INTERVAL = 0.2, 0.5  # meters per second, seconds
TURN_RATE = 0.8  # radians per second
WHEELBASE = 0.35  # meters


@dataclass(frozen=True)
class Apartment:
    """Settings of the simulation."""

    distance: float = 240.0
    tags: int = 40
    hidden: int = 7
    """Tags that a piece of furniture hides."""
    field_of_view: float = np.radians(80)
    max_range: float = 5.0
    detection_probability: float = 0.9
    range_sigma: float = 0.03
    """Relative standard deviation of a range."""
    bearing_sigma: float = np.radians(0.7)
    distance_sigma: float = 0.02
    """Standard deviation of a driven distance, in meters per root of a meter."""
    drift: float = 0.014
    """Standard deviation of the heading, in radians per root of a meter."""
    wrong_labels: float = 0.005
    wheel_difference: float = 0.0
    """Fraction by which the wheels' circumferences differ."""
    range_scale: float = 1.0
    camera_yaw: float = 0.0
    """Radians by which the camera is turned, unknown to the robot."""
    labels: bool = True
    moved: bool = False
    """Whether the robot is moved to another room in the middle, unnoticed by odometry."""


def simulate(seed: int, world: Apartment = Apartment()) -> LandmarkLog:
    """The log of a robot, with its true trajectory and tags."""
    rng = np.random.default_rng(seed)
    walls, doors = _walls(rng)
    tags, normals = _place_tags(rng, walls, world.tags)
    hidden = rng.permutation(world.tags)[: world.hidden]
    poses, moved_at = _drive(rng, doors, world)
    n = len(poses)
    control, covariance = np.zeros((n - 1, 2)), np.zeros((n - 1, 2, 2))
    for i in range(n - 1):
        step = poses[i + 1] - poses[i]
        d, turn = float(np.hypot(*step[:2])), _wrap(step[2])
        if i == moved_at:
            d = turn = 0.0
        length = max(d, 0.02 * abs(turn))
        sigma = world.distance_sigma * np.sqrt(length), world.drift * np.sqrt(length)
        true = np.array([d, turn])
        bias = np.array([0.0, world.wheel_difference / WHEELBASE * d])
        control[i] = true + bias + rng.normal(size=2) * sigma
        covariance[i] = np.diag(np.square(np.maximum(sigma, 1e-6)))
    rows, z, label = [], [], []
    visible = np.setdiff1d(np.arange(world.tags), hidden)
    for i, pose in enumerate(poses):
        for tag in visible[_sees(pose, tags[visible], normals[visible], walls, world)]:
            if rng.random() > world.detection_probability:
                continue
            offset = tags[tag] - pose[:2]
            r, bearing = np.hypot(*offset), np.arctan2(offset[1], offset[0]) - pose[2]
            r *= world.range_scale * (1 + world.range_sigma * rng.normal())
            bearing += world.bearing_sigma * rng.normal() - world.camera_yaw
            rows.append(i)
            z.append([r, _wrap(bearing)])
            wrong = rng.random() < world.wrong_labels
            label.append(rng.integers(world.tags) if wrong else tag)
    observation = np.array(z)
    R = np.zeros((len(z), 2, 2))
    R[:, 0, 0] = np.square(world.range_sigma * observation[:, 0])
    R[:, 1, 1] = world.bearing_sigma**2
    start = poses[0]
    time = INTERVAL * np.arange(n)
    landmark = np.array(label) if world.labels else np.full(len(label), -1)
    return LandmarkLog(
        name=f"apartment {seed}",
        start=start,
        time=time,
        motion="turn_then_translate",
        control=control,
        control_covariance=covariance,
        observation_pose=np.array(rows),
        observation=observation,
        observation_covariance=R,
        landmark=landmark,
        truth=Trajectory(time, poses),
        landmark_truth=LandmarkMap(np.arange(world.tags), tags),
    )


def without_labels(log: LandmarkLog) -> LandmarkLog:
    """The same log with the labels withheld."""
    return replace(log, landmark=np.full(len(log.landmark), -1))


def _wrap(angle: float) -> float:
    return float(np.angle(np.exp(1j * angle)))


def _walls(rng: np.random.Generator) -> tuple[np.ndarray, dict[tuple[int, int], np.ndarray]]:
    """Walls (w, 4) as segments x0, y0, x1, y1, and the center of each door by its two rooms."""
    w, h = ROOM
    columns, rows = ROOMS
    walls, doors = [], {}

    def add(a: np.ndarray, b: np.ndarray, rooms: tuple[int, int] | None) -> None:
        if rooms is None:
            walls.append([*a, *b])
            return
        length = float(np.hypot(*(b - a)))
        at = a + (b - a) * rng.uniform(0.3, 0.7)
        half = (b - a) / length * DOOR / 2
        walls.extend([[*a, *(at - half)], [*(at + half), *b]])
        doors[rooms] = at

    for row in range(rows):
        for column in range(columns + 1):
            a, b = np.array([column * w, row * h]), np.array([column * w, (row + 1) * h])
            inside = 0 < column < columns
            room = row * columns + column
            add(a, b, (room - 1, room) if inside else None)
    for row in range(rows + 1):
        for column in range(columns):
            a, b = np.array([column * w, row * h]), np.array([(column + 1) * w, row * h])
            room = row * columns + column
            add(a, b, (room - columns, room) if 0 < row < rows else None)
    return np.array(walls), doors


def _place_tags(
    rng: np.random.Generator, walls: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Tags (n, 2) on either face of the walls, at least .4 m apart, and their normals (n, 2)."""
    length = np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1])
    size = np.array(ROOM) * ROOMS
    tags, normals = [], []
    while len(tags) < count:
        wall = walls[rng.choice(len(walls), p=length / length.sum())]
        a, b = wall[:2], wall[2:]
        along = (b - a) / np.hypot(*(b - a))
        normal = np.array([-along[1], along[0]]) * rng.choice([-1, 1])
        xy = a + (b - a) * rng.uniform(0.1, 0.9) + 0.02 * normal
        inside = (xy > 0).all() and (xy < size).all()
        if inside and all(np.hypot(*(xy - other)) > 0.4 for other in tags):
            tags.append(xy)
            normals.append(normal)
    return np.array(tags), np.array(normals)


def _drive(
    rng: np.random.Generator, doors: dict[tuple[int, int], np.ndarray], world: Apartment
) -> tuple[np.ndarray, int]:
    """True poses (n, 3) through random rooms, and the step at which the robot is moved, or -1."""
    w, h = ROOM
    columns = ROOMS[0]

    def center(room: int) -> np.ndarray:
        return np.array([(room % columns + 0.5) * w, (room // columns + 0.5) * h])

    def spot(room: int) -> np.ndarray:
        return center(room) + rng.uniform(-0.5, 0.5, 2) * (w - 2, h - 2)

    room, poses, driven, moved_at = 0, [np.append(center(0), 0.0)], 0.0, -1
    previous = -1
    while driven < world.distance:
        if world.moved and moved_at < 0 and driven > world.distance / 2:
            far = [
                r for r in range(columns * ROOMS[1]) if np.hypot(*(center(r) - center(room))) > 8
            ]
            room = int(rng.choice(far or [columns * ROOMS[1] - 1 - room]))
            moved_at = len(poses) - 1
            poses.append(np.append(spot(room), rng.uniform(-np.pi, np.pi)))
        nearby = [pair for pair in doors if room in pair]
        onward = [pair for pair in nearby if previous not in pair] or nearby
        pair = onward[rng.integers(len(onward))]
        previous, room = room, pair[0] if pair[1] == room else pair[1]
        door = doors[pair]
        through = center(room) - center(previous)
        through /= np.hypot(*through)
        for target in (door - 0.5 * through, door + 0.5 * through, spot(room)):
            driven += _approach(poses, target)
    return np.array(poses), moved_at


def _approach(poses: list[np.ndarray], target: np.ndarray) -> float:
    """Turn to a target, then drive there; returns the distance."""
    offset = target - poses[-1][:2]
    distance, heading = float(np.hypot(*offset)), float(np.arctan2(offset[1], offset[0]))
    turn = _wrap(heading - poses[-1][2])
    steps = max(int(np.ceil(abs(turn) / (TURN_RATE * INTERVAL))), 1)
    for _ in range(steps):
        x, y, theta = poses[-1]
        poses.append(np.array([x, y, _wrap(theta + turn / steps)]))
    steps = max(int(np.ceil(distance / (SPEED * INTERVAL))), 1)
    for _ in range(steps):
        x, y, _ = poses[-1]
        poses.append(np.array([*(poses[-1][:2] + offset / steps), _wrap(heading)]))
    return distance


def _sees(
    pose: np.ndarray, tags: np.ndarray, normals: np.ndarray, walls: np.ndarray, world: Apartment
) -> np.ndarray:
    """(n,) whether each tag is in view, faces the robot, and no wall is between."""
    offset = tags - pose[:2]
    r = np.hypot(*offset.T)
    bearing = np.angle(np.exp(1j * (np.arctan2(offset[:, 1], offset[:, 0]) - pose[2])))
    faces = -(offset * normals).sum(1) > 0.3 * r
    seen = (r < world.max_range) & (np.abs(bearing) < world.field_of_view / 2) & faces
    for i in np.flatnonzero(seen):
        seen[i] = not _blocked(pose[:2], tags[i], walls)
    return seen


def _blocked(p: np.ndarray, q: np.ndarray, walls: np.ndarray) -> bool:
    """Whether a wall is between two points."""
    a, b = walls[:, :2], walls[:, 2:]

    def side(o: np.ndarray, d: np.ndarray, point: np.ndarray) -> np.ndarray:
        return (d[..., 0] - o[..., 0]) * (point[..., 1] - o[..., 1]) - (d[..., 1] - o[..., 1]) * (
            point[..., 0] - o[..., 0]
        )

    across = side(p, q, a) * side(p, q, b) < 0
    return bool((across & (side(a, b, p) * side(a, b, q) < 0)).any())
