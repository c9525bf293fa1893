"""What each mechanism is worth: one table of mechanisms, each switched off over worlds and logs.

    uv run python benchmarks/ablations.py [--logs DATA/logs --seeds 4 --only NAME ...]

A row is a mechanism, how to switch it off, and the worlds and logs in which it pays. Its figures
with it and without it are printed, which are better when smaller, and their ratio. A mechanism
whose ratios are all 1 goes.
"""

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import large_map
import surveyed_tags
from conditions import conditioned
from kidnapped import kidnapped
from measuring import ROBOT, arguments, without_labels
from recorded_logs import read_dlr
from reliability import Rooms, simulate_rooms
from saccade import datasets, slam, visual
from saccade.evaluation.trajectory import position_rmse, score_drive
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam.consistency import pose_nees
from saccade.types import LandmarkLog

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.clustered_world import clustered_world


@dataclass(frozen=True)
class Mechanism:
    """A mechanism, and how to switch it off."""

    cases: tuple[str, ...]
    """Names in `CASES`."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Fields of `EkfConfig` without it."""
    constants: Mapping[str, Any] = field(default_factory=dict)
    """Values by "module:name", such as a threshold that is never reached, or a function."""

    @contextmanager
    def off(self) -> Iterator[slam.EkfConfig]:
        """Switches the mechanism off; yields the settings."""
        with ExitStack() as stack:
            for place, value in self.constants.items():
                module, name = place.split(":")
                stack.enter_context(patch.object(import_module(module), name, value))
            yield slam.EkfConfig(**self.settings)


def rmse(log: LandmarkLog, config: slam.EkfConfig) -> float:
    """Position RMSE of the smoothed trajectory in meters."""
    return position_rmse(slam.run(log, config).trajectory, log.truth)


def inconsistency(log: LandmarkLog, config: slam.EkfConfig) -> float:
    """Mean NEES of the filtered poses over the 3 that is expected; at least 1."""
    found = slam.run(log, replace(config, smooth=False)).filtered
    return max(float(np.nanmean(pose_nees(found, log.truth, config.errors))) / 3, 1.0)


def cpu_seconds(log: LandmarkLog, config: slam.EkfConfig) -> float:
    """CPU seconds of the filter."""
    start = time.process_time()
    slam.run(log, replace(config, smooth=False))
    return time.process_time() - start


def rejected(log: LandmarkLog, config: slam.EkfConfig) -> float:
    """Number of rejected labels, of which nearly all are right."""
    return float(slam.run(log, replace(config, smooth=False)).rejected.sum())


def lost(log: LandmarkLog, config: slam.EkfConfig) -> float:
    """Number of lost poses of a robot that was not carried, plus one."""
    return 1.0 + float(np.sum(slam.run(log, replace(config, smooth=False)).lost))


Figure = Callable[[LandmarkLog, slam.EkfConfig], float]


def worlds(world: WorldConfig | Rooms, figure: Figure = rmse, *, labels: bool = True) -> Any:
    """A figure over simulated logs of a world."""

    def measure(given: Any, config: slam.EkfConfig) -> list[float]:
        make = simulate_rooms if isinstance(world, Rooms) else simulate_world
        logs = [make(world, seed) for seed in range(1, given.seeds + 1)]
        return [figure(log if labels else without_labels(log), config) for log in logs]

    return measure


def recorded(file: str, figure: Figure = rmse, **options: Any) -> Any:
    """A figure on a recorded log; nothing without its file."""

    def measure(given: Any, config: slam.EkfConfig) -> list[float]:
        path = given.logs / file
        if not path.exists():
            return []
        log = read_dlr(path) if "dlr" in file else datasets.load("auto", path, **options)
        return [figure(log, config)]

    return measure


def moved(given: Any, config: slam.EkfConfig) -> list[float]:
    """Position RMSE of a robot that is moved by 15 m."""
    logs = [kidnapped(ROBOT, seed, 15.0, turned=False) for seed in range(1, given.seeds + 1)]
    return [rmse(log, replace(config, smooth=False)) for log in logs]


def whole_map_in_view(given: Any, config: slam.EkfConfig) -> list[float]:
    """CPU seconds of a sensor that sees the whole map, and reports three landmarks in each scan."""
    world = WorldConfig(
        course_length=100, landmarks=400, landmark_spread=15, steps=1500, range_limits=(0.5, 200.0)
    )
    seconds = []
    for seed in range(1, given.seeds + 1):
        log, rng = simulate_world(world, seed), np.random.default_rng(seed)
        order = np.lexsort((rng.random(len(log.observation)), log.observation_pose))
        first = np.searchsorted(log.observation_pose, log.observation_pose)
        chosen = np.sort(order[np.arange(len(order)) - first < 3])
        thin = {
            name: getattr(log, name)[chosen]
            for name in ("observation_pose", "observation", "observation_covariance", "landmark")
        }
        log, config = replace(log, **thin), replace(config, association="known")
        seconds.append(min(cpu_seconds(log, config) for _ in range(2)))  # the first one compiles
    return seconds


def excess_landmarks(given: Any, config: slam.EkfConfig) -> list[float]:
    """Landmarks beyond the true number, plus one, where a seventh of the observations are false."""
    excess = []
    for seed in range(1, given.seeds + 1):
        log, rng = simulate_world(ROBOT, seed), np.random.default_rng(seed)
        n = len(log.observation)
        m = n // 6
        pose = np.append(log.observation_pose, rng.integers(1, len(log.time), m))
        reach = log.observation[:, 0].max()
        false = np.stack([rng.uniform(0.5, reach, m), rng.uniform(-np.pi, np.pi, m)], 1)
        order = np.argsort(pose, kind="stable")
        like = np.append(np.arange(n), rng.integers(0, n, m))
        log = replace(
            log,
            observation_pose=pose[order],
            observation=np.concatenate([log.observation, false])[order],
            observation_covariance=log.observation_covariance[like][order],
            landmark=np.full(n + m, -1),
        )
        assert log.landmark_truth is not None
        excess.append(1.0 + max(len(slam.run(log, config).map) - len(log.landmark_truth), 0))
    return excess


def wrong_labels(given: Any, config: slam.EkfConfig) -> list[float]:
    """Position RMSE in meters by labels that are believed, of which one in a hundred is wrong."""
    errors = []
    for seed in range(1, given.seeds + 1):
        log, rng = simulate_world(ROBOT, seed), np.random.default_rng(seed)
        wrong = rng.random(len(log.landmark)) < 0.01
        label = np.where(wrong, rng.permutation(log.landmark), log.landmark)
        errors.append(rmse(replace(log, landmark=label), replace(config, association="known")))
    return errors


def among_groups(given: Any, config: slam.EkfConfig) -> list[float]:
    """Position RMSE in meters without labels, among landmarks that are close to each other."""
    seeds = range(1, given.seeds + 1)
    return [rmse(without_labels(clustered_world(seed, steps=600)), config) for seed in seeds]


def field(trees: int) -> Any:
    """CPU seconds of a sweep over a field of trees."""

    def measure(given: Any, config: slam.EkfConfig) -> list[float]:
        return [cpu_seconds(large_map.world(10 * trees, trees, 1), config)]

    return measure


def poses_until_found(given: Any, config: slam.EkfConfig) -> list[float]:
    """Poses until a robot knows where it is, among tags of which half are in its map."""
    numbers = []
    for seed in range(given.seeds):
        driven = surveyed_tags.drive(seed, surveyed_tags.LOST, max_tags=1)
        found = surveyed_tags.follow(driven, None, config, surveyed_tags.HALF)
        numbers.append(float(np.sum(found.lost)))
    return numbers


def among_tags(fault: str) -> Any:
    """Median error among surveyed tags in meters, in the last quarter of a drive."""

    def measure(given: Any, config: slam.EkfConfig) -> list[float]:
        drives = [surveyed_tags.drive(seed, fault) for seed in range(given.seeds)]
        starts = [None if fault == surveyed_tags.LOST else each.truth[0] for each in drives]
        found = (surveyed_tags.follow(*each, config) for each in zip(drives, starts, strict=True))
        return [float(np.median(each.error[-len(each.error) // 4 :])) for each in found]

    return measure


def filmed(condition: str) -> Any:
    """Absolute trajectory error of camera drives in a condition, with scale where it is unknown."""

    def measure(given: Any, _: slam.EkfConfig) -> list[float]:
        drives = [conditioned(condition, seed, frames=120) for seed in range(given.seeds)]
        return [
            score_drive(
                visual.run(each).trajectory, each.truth, scale_known=each.scale == "metric"
            ).ate_m
            for each in drives
        ]

    return measure


FILMED = (
    *("vehicle ahead", "object passes", "garbled frame, no odometry"),
    "standing first, one camera, no odometry",
)
"""Camera drives of the benchmark of conditions."""
CASES: dict[str, Callable[[Any, slam.EkfConfig], list[float]]] = {
    "rooms": worlds(Rooms()),
    "rooms, odometry turns": worlds(Rooms(wheels=0.01)),
    "rooms, ranges 3 % long": worlds(Rooms(stretch=1.03)),
    "slippery, NEES": worlds(WorldConfig.slippery(), inconsistency),
    "robot, moved": moved,
    "whole map in view, CPU s": whole_map_in_view,
    "surveyed tags, pushed": among_tags("pushed"),
    "half of the tags surveyed, poses until found": poses_until_found,
    "groups, no labels": among_groups,
    "robot, false observations": excess_landmarks,
    "robot, 1 % wrong labels": wrong_labels,
    "2500 trees, CPU s": field(2500),
    "DLR, CPU s": recorded("dlr/dlr_3298.npz", cpu_seconds),
    **{f"MRCLAM 6.{n}": recorded("mrclam/mrclam6.npz", robot=n) for n in (1, 3)},
    "MRCLAM 9.1, rejected": recorded("mrclam/mrclam9.npz", rejected, robot=1),
    "Victoria Park, lost": recorded("victoria_park/victoria_park_gtsam.txt", lost),
    **{f"drive, {name}": filmed(name) for name in FILMED},
}
"""Figures by name: lists over seeds, better when smaller."""
MECHANISMS: dict[str, Mechanism] = {
    "invariant errors": Mechanism(("slippery, NEES",), {"errors": "standard"}),
    "systematic odometry errors": Mechanism(
        ("rooms", "rooms, odometry turns", "MRCLAM 6.1"), {"estimate_systematic_errors": False}
    ),
    "robust weights": Mechanism(("robot, 1 % wrong labels",), {"huber": np.inf}),
    "smoothing": Mechanism(("rooms", "MRCLAM 6.1"), {"smooth": False}),
    "submaps": Mechanism(("2500 trees, CPU s", "DLR, CPU s"), {"submaps": "never"}),
    "delayed rows": Mechanism(
        ("whole map in view, CPU s",),
        constants={"saccade.slam.filter.state:_num_delayed_rows": lambda _: 8},
    ),
    "several hypotheses": Mechanism(("groups, no labels",), {"max_hypotheses": 1}),
    "culling": Mechanism(("robot, false observations",), {"culling_ratio": None}),
    "kidnapping test": Mechanism(("robot, moved", "surveyed tags, pushed"), {"recover": False}),
    "labels as evidence": Mechanism(
        ("surveyed tags, pushed",),
        constants={"saccade.slam.landmark_evidence:MAX_LABEL_EVIDENCE": 0.0},
    ),
    "wide gate of labels of an uncertain pose": Mechanism(
        ("MRCLAM 9.1, rejected",),
        constants={"saccade.slam.association.labels:LOOP_GATE_RATIO": np.inf},
    ),
    "another pose by labels while mapping": Mechanism(
        ("Victoria Park, lost",), constants={"saccade.slam.kidnapping:MIN_AGREEING": np.inf}
    ),
    "memory of labels": Mechanism(
        ("half of the tags surveyed, poses until found",),
        constants={"saccade.slam.relocalization:LABELED_MEMORY": 10},
    ),
    "parts of an image that agree with odometry": Mechanism(
        ("drive, vehicle ahead", "drive, object passes"),
        constants={
            "saccade.visual.contradictions:MIN_PART": 2.0,
            "saccade.visual.contradictions:MIN_EXPLAINED": 0.0,
        },
    ),
    "points held over garbled frames": Mechanism(
        ("drive, garbled frame, no odometry",), constants={"saccade.visual.pipeline:MAX_HELD": 0}
    ),
    "standstill of a camera without odometry": Mechanism(
        ("drive, standing first, one camera, no odometry",),
        constants={
            "saccade.visual.unscaled_camera:MIN_PARALLAX": 0.0,
            "saccade.visual.unscaled_camera:MAX_EPIPOLAR_RATIO": np.inf,
        },
    ),
}
"""All mechanisms, by name; whoever adds one adds its row."""


def main() -> None:
    given = arguments(
        __doc__, logs={"type": Path, "default": Path("data/logs")}, seeds=4, only=[""]
    )
    chosen = {name: row for name, row in MECHANISMS.items() if not any(given.only)} or {
        name: MECHANISMS[name] for name in given.only
    }
    known: dict[str, list[float]] = {}
    print(f"{'mechanism':43} {'case':45} {'on':>8} {'off':>8} {'off / on':>9}")
    for name, mechanism in chosen.items():
        for case in mechanism.cases:
            if case not in known:
                known[case] = CASES[case](given, slam.EkfConfig())
            with mechanism.off() as config:
                off = CASES[case](given, config)
            if not off:
                print(f"{name:43} {case:45} no data in {given.logs}", file=sys.stderr)
                continue
            a, b = float(np.median(known[case])), float(np.median(off))
            print(f"{name:43} {case:45} {a:8.3f} {b:8.3f} {b / a:9.2f}", flush=True)


if __name__ == "__main__":
    main()
