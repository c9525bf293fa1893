"""Warnings for wrong maps: labels withheld, robots that are moved, and maps that are merged.

    uv run python benchmarks/reliability.py [--seeds 8] [--first 1]      (docs/slam.md)

Worlds of two simulators: `saccade.simulation`, and six rooms with tags on the walls, written apart
from the package. For each world without labels: maps that are wrong (mean NEES of the smoothed
poses over 15) and how many of them are warned of; maps that are right (under 6) and warned of;
robots that are moved by 8 m or more at half time, how many were found again (NEES under 15 from
then on), and how many of the others are neither warned of nor lost. Then, with labels, merges of a
right map with right and with broken ones: accepted, and ruined (landmark RMSE more than doubled).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from kidnapped import kidnapped
from measuring import ROBOT, arguments, without_labels
from saccade import slam
from saccade.errors import LogError
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam.consistency import pose_nees
from saccade.slam.filter.robot_models import wrap
from saccade.types import FloatArray, LandmarkLog, LandmarkMap, Trajectory

ROOM, COLUMNS, ROWS = np.array([5.0, 4.0]), 3, 2
WRONG, RIGHT = 15.0, 6.0


@dataclass(frozen=True)
class Rooms:
    """A robot in six rooms. Some errors are not in the log's covariances."""

    distance: float = 240.0
    tags: int = 33
    view: float = np.radians(80)
    reach: float = 5.0
    drift: float = 0.014
    """Standard deviation of the heading, in radians per root of a meter."""
    alike: bool = False
    """Whether the tags are at the same places in every room."""
    moved: bool = False
    wheels: float = 0.0
    """Fraction by which the circumferences of the wheels differ."""
    stretch: float = 1.0
    """Factor of the ranges."""
    yaw: float = 0.0
    """Radians by which the camera is turned."""
    wrong_labels: float = 0.0
    """Fraction of the tags with the label of another one."""


WORLDS: dict[str, WorldConfig | Rooms] = {
    "circle": WorldConfig.loop(),
    "slippery": WorldConfig.slippery(),
    "robot": ROBOT,
    "groups": replace(ROBOT, landmarks=45, group_size=3, layout=7),
    "narrow": replace(ROBOT, steps=900, field_of_view_deg=90, odometry_percent=2.5, layout=3),
    "dense": replace(ROBOT, landmarks=80, landmark_spread=4, range_limits=(0.3, 4.0), layout=4),
    "rooms": Rooms(),
    "rooms, drift": Rooms(drift=0.03),
    "rooms, 55 tags": Rooms(tags=55),
    "rooms, near": Rooms(reach=3.5),
    "rooms, wide": Rooms(reach=8.0, view=np.radians(120)),
    "rooms, alike": Rooms(tags=42, alike=True),
}
BROKEN = {
    "right": Rooms(),
    "right, other course": Rooms(distance=150.0),
    "wheels 1 %": Rooms(wheels=0.01),
    "ranges 5 %": Rooms(stretch=1.05),
    "yaw 5 degrees": Rooms(yaw=np.radians(5)),
    "labels exchanged": Rooms(wrong_labels=0.2),
    "labels withheld": Rooms(drift=0.05),
}


def simulate_rooms(world: Rooms, seed: int, building: int | None = None) -> LandmarkLog:
    """The log of a robot that visits rooms in random order."""
    rng = np.random.default_rng([seed, 1])
    walls, doors, tags, normals = _building(world, seed if building is None else building)
    poses, moved_at = _drive(rng, doors, world)
    step = np.diff(poses, axis=0)
    control = np.stack([np.hypot(step[:, 0], step[:, 1]), wrap(step[:, 2])], 1)
    control[moved_at] = 0.0
    length = np.maximum(control[:, :1], 0.02 * np.abs(control[:, 1:]))
    sigma = np.maximum(np.sqrt(length) * [0.02, world.drift], 1e-6)
    control[:, 1] += world.wheels / 0.35 * control[:, 0]
    control += sigma * rng.normal(size=control.shape)
    seen = [(i, t) for i, p in enumerate(poses) for t in _visible(p, tags, normals, walls, world)]
    pose, tag = np.array(seen)[rng.random(len(seen)) < 0.9].T
    z = slam.observe(poses[pose].T, tags[tag])[0]
    z[:, 0] *= world.stretch * (1 + 0.03 * rng.normal(size=len(z)))
    z[:, 1] = wrap(z[:, 1] - world.yaw + np.radians(0.7) * rng.normal(size=len(z)))
    R = np.stack([0.03 * z[:, 0], np.full(len(z), np.radians(0.7))], 1)[:, :, None] ** 2 * np.eye(2)
    label, wrong = np.arange(len(tags)), rng.random(len(tags)) < world.wrong_labels
    label[wrong] = rng.permutation(label[wrong])
    time = 0.5 * np.arange(len(poses))
    return LandmarkLog(
        name=f"rooms {seed}",
        start=poses[0],
        time=time,
        motion="turn_then_translate",
        control=control,
        control_covariance=sigma[:, :, None] ** 2 * np.eye(2),
        observation_pose=pose,
        observation=z,
        observation_covariance=R,
        landmark=label[tag],
        truth=Trajectory(time, poses),
        landmark_truth=LandmarkMap(np.arange(len(tags)), tags),
    )


def _building(world: Rooms, seed: int) -> tuple[FloatArray, dict, FloatArray, FloatArray]:
    """Walls (w, 4) from end to end, doors by their two rooms, tags (n, 2) and their normals."""
    rng, walls, doors = np.random.default_rng(seed), [], {}
    for axis, room in ((axis, room) for axis in (0, 1) for room in range(COLUMNS * ROWS)):
        cell = np.array([room % COLUMNS, room // COLUMNS])
        along = np.eye(2)[1 - axis] * ROOM
        for side in (0, 1) if cell[axis] == 0 else (1,):
            a = (cell + side * np.eye(2)[axis]) * ROOM
            other = room + (1, COLUMNS)[axis]
            if side == 0 or cell[axis] == (COLUMNS, ROWS)[axis] - 1:
                walls.append([*a, *(a + along)])
                continue
            door = a + along * rng.uniform(0.3, 0.7)
            half = along / np.linalg.norm(along) / 2
            walls += [[*a, *(door - half)], [*(door + half), *(a + along)]]
            doors[room, other] = door
    tags, normals, places = [], [], []
    for number in range(world.tags):
        if world.alike and number >= len(places) * COLUMNS * ROWS:
            places.append(_on_wall(rng))
        room = number % (COLUMNS * ROWS) if world.alike else rng.integers(COLUMNS * ROWS)
        xy, normal = places[-1] if world.alike else _on_wall(rng)
        tags.append(xy + ROOM * [room % COLUMNS, room // COLUMNS])
        normals.append(normal)
    return np.array(walls), doors, np.array(tags), np.array(normals)


def _on_wall(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """A point on a wall of a room, beside the door, and the normal there."""
    axis, side = rng.integers(2, size=2)
    along = rng.choice([rng.uniform(0.08, 0.28), rng.uniform(0.72, 0.92)])
    normal = np.eye(2)[axis] * (1 - 2 * side)
    return ROOM * (np.eye(2)[axis] * side + np.eye(2)[1 - axis] * along) + 0.02 * normal, normal


def _drive(rng: np.random.Generator, doors: dict, world: Rooms) -> tuple[FloatArray, list[int]]:
    """True poses (n, 3), and the step at which the robot is moved, if it is."""

    def center(room: int) -> FloatArray:
        return (np.array([room % COLUMNS, room // COLUMNS]) + 0.5) * ROOM

    def spot(room: int) -> FloatArray:
        return center(room) + rng.uniform(-0.5, 0.5, 2) * (ROOM - 2)

    room, previous, poses, moved_at = 0, -1, [np.append(center(0), 0.0)], list[int]()
    driven = 0.0
    while driven < world.distance:
        if world.moved and not moved_at and driven > world.distance / 2:
            moved_at.append(len(poses) - 1)
            room = COLUMNS * ROWS - 1 - room
            while np.hypot(*(to := spot(room)) - poses[-1][:2]) < 8 and room % COLUMNS != 1:
                pass
            poses.append(np.append(to, rng.uniform(-np.pi, np.pi)))
        ways = [pair for pair in doors if room in pair]
        pair = ways[rng.integers(len(ways))]
        if previous in pair and len(ways) > 1:
            continue
        previous, room = room, sum(pair) - room
        through = (center(room) - center(previous)) / np.hypot(*(center(room) - center(previous)))
        for target in (doors[pair] - 0.5 * through, doors[pair] + 0.5 * through, spot(room)):
            offset = target - poses[-1][:2]
            heading = np.arctan2(offset[1], offset[0])
            turn, distance = wrap(heading - poses[-1][2]), np.hypot(*offset)
            for _ in range(n := max(int(np.ceil(abs(turn) / 0.4)), 1)):
                poses.append(np.append(poses[-1][:2], wrap(poses[-1][2] + turn / n)))
            for _ in range(n := max(int(np.ceil(distance / 0.1)), 1)):
                poses.append(np.append(poses[-1][:2] + offset / n, heading))
            driven += distance
    return np.array(poses), moved_at


def _visible(
    pose: FloatArray, tags: FloatArray, normals: FloatArray, walls: FloatArray, world: Rooms
) -> FloatArray:
    """Tags in view that face the robot, with no wall between."""
    offset = tags - pose[:2]
    r, bearing = np.hypot(*offset.T), wrap(np.arctan2(offset[:, 1], offset[:, 0]) - pose[2])
    seen = (r < world.reach) & (np.abs(bearing) < world.view / 2)
    seen = np.flatnonzero(seen & (-(offset * normals).sum(1) > 0.3 * r))
    a, wall = walls[:, :2], walls[:, 2:] - walls[:, :2]
    to = offset[seen, None]  # (s, 1, 2)
    cross = to[..., 0] * wall[:, 1] - to[..., 1] * wall[:, 0] + 1e-12
    start = a - pose[:2]
    by_ray = (start[:, 0] * wall[:, 1] - start[:, 1] * wall[:, 0]) / cross
    by_wall = (start[:, 0] * to[..., 1] - start[:, 1] * to[..., 0]) / cross
    inside = (by_ray > 0) & (by_ray < 1) & (by_wall > 0) & (by_wall < 1)
    return seen[~inside.any(1)]


def simulate(world: WorldConfig | Rooms, seed: int, moved: bool) -> LandmarkLog:
    """A log of a world of either simulator."""
    if isinstance(world, Rooms):
        return simulate_rooms(replace(world, moved=moved), seed)
    return kidnapped(world, seed, 10.0, seed % 2 == 0) if moved else simulate_world(world, seed)


def nees(log: LandmarkLog, result: slam.SlamResult) -> float:
    """Mean NEES of the poses after the robot was found, if it was lost."""
    values = pose_nees(result.trajectory, log.truth, 0)
    return float(np.nanmean(values[np.flatnonzero(result.lost).max(initial=-1) + 1 :]))


def print_worlds(seeds: Iterator[int]) -> None:
    """Print the table of the worlds without labels."""
    print("world             wrong  warned   right  warned   moved   found  silent")
    totals = np.zeros(7, np.int64)
    for name, world in WORLDS.items():
        row = np.zeros(7, np.int64)
        for seed in seeds:
            log = without_labels(simulate(world, seed, False))
            result = slam.run(log)
            value, warned = nees(log, result), bool(result.warning)
            row[:4] += (
                value > WRONG,
                value > WRONG and warned,
                value < RIGHT,
                value < RIGHT and warned,
            )
            log = without_labels(simulate(world, seed, True))
            result = slam.run(log)
            right = nees(log, result) < WRONG
            row[4:] += 1, right, not right and not result.warning and not result.lost[-1]
        totals += row
        print(f"{name:16}" + "".join(f"{each:8}" for each in row), flush=True)
    print(f"{'all':16}" + "".join(f"{each:8}" for each in totals))


def print_merges(seeds: Iterator[int]) -> None:
    """Print what becomes of a right map that is merged with others of the same building."""
    print("second map            accepted  ruined  of   reasons")

    def mapped(log: LandmarkLog, **settings: object) -> slam.Slam:
        robot = slam.slam_for(log, slam.EkfConfig(**settings))
        slam.run(log, initial=robot)
        return robot

    def rmse(robot: slam.Slam, log: LandmarkLog, ids: FloatArray) -> float:
        kept = np.isin(robot.map.label, ids)
        error = robot.map.xy[kept] - log.landmark_truth.xy[robot.map.label[kept]]
        return float(np.sqrt(np.square(error).sum(1).mean()))

    for name, world in BROKEN.items():
        accepted, ruined, reasons = 0, 0, []
        for seed in seeds:
            log = simulate_rooms(Rooms(), seed)
            other = simulate_rooms(world, seed + 1000, seed)
            other = without_labels(other) if name == "labels withheld" else other
            first = mapped(log)
            second = mapped(other, estimate_systematic_errors=name != "wheels 1 %")
            before = rmse(first, log, first.map.label)
            try:
                merged = slam.merge_maps(first, second).slam
            except LogError as error:
                reasons.append(str(error)[:60])
                continue
            accepted += 1
            ruined += rmse(merged, log, first.map.label) > max(2 * before, before + 0.1)
        print(f"{name:20}{accepted:10}{ruined:8}{len(seeds):4}   {reasons[:1]}", flush=True)


def main() -> None:
    given = arguments(__doc__, seeds=8, first=1)
    seeds = range(given.first, given.first + given.seeds)
    print_worlds(seeds)
    print_merges(seeds)


if __name__ == "__main__":
    main()
