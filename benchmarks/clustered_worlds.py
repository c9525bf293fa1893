"""Logs without landmark identities in worlds whose landmarks stand in groups.

    OMP_NUM_THREADS=1 uv run python benchmarks/clustered_worlds.py

A robot with a narrow field of view drives between six groups of two or three landmarks, with
stretches in which it observes nothing. Rows are single runs: with the identities of the landmarks,
and without them by nearest neighbors ("mutual") and by the default, "auto".

- position: RMSE in metres, map: landmarks, found: different true ones, wrong: associations that are
  not of the landmark's most frequent identity, used: observations that were associated
- "known" is wrong in what the filter with identities would have chosen without them, scan by scan:
  a bound for rules that never revise a decision
"""

import argparse
import copy
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from saccade import slam
from saccade.slam.association.alternatives import Alternatives
from saccade.slam.scans import scans_of
from saccade.types import FloatArray, LandmarkLog, Trajectory
from withheld import associated, rmse

AREA = np.array([7.0, 9.0])
"""Metres."""
FIELD_OF_VIEW, REACH = 0.45, 6.5
"""Half of it in radians; metres."""
BEARING = 0.012
"""Standard deviation of bearings, radians."""


@dataclass(frozen=True)
class ClusteredWorld:
    """A world and its noise."""

    spacing: tuple[float, float] = (0.15, 0.25)
    """Metres between neighbors of a group, from and to."""
    size: tuple[int, int] = (2, 3)
    """Landmarks of a group, from and to."""
    range_sigma: float = 0.08
    """Metres, of ranges."""
    range_bias: float = 0.0
    """Metres, standard deviation of an error of the range of each landmark that stays the same."""
    slip: float = 0.0
    """Probability of a step in which the wheels turn and the robot does not."""


WORLDS = {
    "pairs": ClusteredWorld(),
    "fine": ClusteredWorld(spacing=(0.15, 0.2), range_sigma=0.05),
    "wide": ClusteredWorld(spacing=(0.3, 0.4), range_sigma=0.15),
    "biased": ClusteredWorld(spacing=(0.2, 0.3), range_bias=0.05),
    "slip": ClusteredWorld(spacing=(0.2, 0.3), slip=0.01),
    "single": ClusteredWorld(size=(1, 1)),
}


def wrong_by_prediction(log: LandmarkLog) -> float:
    """Share of the observations of which another landmark is more probable than the right one.

    The filter is given the identities; of its map, every scan has its jointly most probable
    association.
    """
    config, rule = slam.EkfConfig(association="known"), Alternatives()
    live, wrong, used = slam.slam_for(log, config), 0, 0
    for scan in scans_of(log, config, log.landmark):
        predicted = copy.deepcopy(live.ekf)
        if scan.control is not None:
            predicted.predict(*scan.control)
        if len(scan.z) > 0:
            found = rule(predicted, scan.z, scan.R, rule.least_new_cost)[0].association
            named = found >= 0
            wrong += int((live.identities[found[named]] != scan.names[named]).sum())
            used += int(named.sum())
        live.process(scan)
    return wrong / max(used, 1)


def simulate(name: str, world: ClusteredWorld, seed: int, seconds: float) -> LandmarkLog:
    """A log with identities and truth."""
    rng = np.random.default_rng(seed)
    landmarks = np.concatenate([group(rng, world, center) for center in centers(rng)])
    bias = world.range_bias * rng.normal(size=len(landmarks))
    pose, goal = np.append(AREA / 2, rng.uniform(-np.pi, np.pi)), rng.uniform(0.7, AREA - 0.7)
    poses, controls, covariances, rows, dark = [pose], [], [], [], 0.0
    for step in range(1, round(4 * seconds) + 1):
        while np.hypot(*(goal - pose[:2])) < 0.4:
            goal = rng.uniform(0.7, AREA - 0.7)
        turn = np.arctan2(*(goal - pose[:2])[::-1]) - pose[2]
        turn = float(np.clip(slam.wrap(turn), -0.15, 0.15)) + 0.02 * rng.normal()
        forward = 0.06 if abs(turn) < 0.14 else 0.0125
        control = np.array([forward * np.cos(turn / 2), forward * np.sin(turn / 2), turn])
        if rng.random() >= world.slip:
            pose = slam.compose(pose, control)[0]
        variance = [2.5e-3 * forward, 4e-4 * forward + 1e-8, 5e-3 * abs(turn) + 2e-3 * forward]
        poses.append(pose)
        controls.append(control + rng.normal(size=3) * np.sqrt(variance))
        covariances.append(np.diag(variance))
        dark = rng.exponential(60.0) if dark <= 0 and rng.random() < 0.02 else dark - 1
        z = slam.observe(pose, landmarks)[0]
        seen = (np.abs(z[:, 1]) < FIELD_OF_VIEW) & (z[:, 0] < REACH) & (z[:, 0] > 0.5)
        names = np.flatnonzero(seen & (rng.random(len(z)) < 0.4) & (dark <= 0))
        noisy = z[names] + rng.normal(size=(len(names), 2)) * [world.range_sigma, BEARING]
        noisy[:, 0] = np.maximum(noisy[:, 0] + bias[names], 0.1)
        rows.append(np.column_stack([np.full(len(names), step), noisy, names]))
    table, time = np.concatenate(rows), 0.25 * np.arange(len(poses))
    R = np.diag([world.range_sigma, BEARING]) ** 2
    return LandmarkLog(
        name=f"{name} {seed}",
        start=poses[0],
        time=time,
        motion="compose",
        control=np.array(controls),
        control_covariance=np.array(covariances),
        observation_pose=table[:, 0].astype(np.int64),
        observation=table[:, 1:3].copy(),
        observation_covariance=np.tile(R, (len(table), 1, 1)),
        landmark=table[:, 3].astype(np.int64),
        truth=Trajectory(time, np.array(poses)),
    )


def centers(rng: np.random.Generator, count: int = 6, apart: float = 1.2) -> FloatArray:
    """(count, 2) centers of the groups."""
    found: list[FloatArray] = []
    while len(found) < count:
        center = rng.uniform(0.5, AREA - 0.5)
        if all(np.hypot(*(center - other)) > apart for other in found):
            found.append(center)
    return np.array(found)


def group(rng: np.random.Generator, world: ClusteredWorld, center: FloatArray) -> FloatArray:
    """(n, 2) landmarks in a row that bends."""
    points, heading = [center], rng.uniform(-np.pi, np.pi)
    for _ in range(rng.integers(world.size[0], world.size[1], endpoint=True) - 1):
        heading += rng.uniform(-1, 1)
        step = rng.uniform(*world.spacing) * np.array([np.cos(heading), np.sin(heading)])
        points.append(points[-1] + step)
    return np.array(points)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS), choices=list(WORLDS))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=600.0)
    options = parser.parse_args()
    print("world       association  position   map  found      wrong   used  seconds")
    for name in options.worlds:
        for seed in range(options.seeds):
            log = simulate(name, WORLDS[name], seed, options.seconds)
            hidden = replace(log, landmark=np.full_like(log.landmark, -1))
            for rule, given in (("known", log), ("mutual", hidden), ("auto", hidden)):
                started = perf_counter()
                result = slam.run(given, slam.EkfConfig(association=rule))
                seconds, (found, wrong) = perf_counter() - started, associated(log, result)
                wrong = wrong_by_prediction(log) if rule == "known" else wrong
                print(
                    f"{log.name:12}{rule:12}{rmse(log, result):9.3f} {len(result.map):5}"
                    f"  {found:3} of {len(np.unique(log.landmark)):3} {wrong:6.1%}"
                    f" {(result.association >= 0).mean():6.1%} {seconds:8.1f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
