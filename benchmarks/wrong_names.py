"""What wrong landmark names cost: position RMSE over that with the right names.

    OMP_NUM_THREADS=1 uv run python benchmarks/wrong_names.py --runs 20  (docs/limits.md)

For each simulated world and each fault, over so many seeds: the mean RMSE over the mean RMSE with
the right names, its spread (10 to 90 % of the runs), and the largest of one run in meters, beside
its own RMSE with the right names.

Faults: 1 and 5 % of the names are those of a random other landmark; 5 % those of the nearest other
one; two names are swapped in the second half; a quarter of the landmarks have a wrong name at their
first observation; one landmark moves by 3 m half-way; half of the names are missing.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from measuring import arguments, require_one_thread
from saccade import slam
from saccade.evaluation.trajectory import position_rmse
from saccade.simulation import WorldConfig, simulate_world
from saccade.types import LandmarkLog

WORLDS = {
    "loop": WorldConfig.loop(),
    "slippery": WorldConfig.slippery(),
    "coarse": WorldConfig.coarse(),
    "car": WorldConfig.car(),
    "sparse": WorldConfig(landmarks=6),
    "dense": WorldConfig(landmarks=80),
    "bends": WorldConfig(course_length=120.0, curvature_amplitude=2.0, landmarks=40, steps=1500),
    "exploring": WorldConfig(course_length=300.0, landmarks=100, steps=1500, odometry_percent=3.0),
    "narrow": WorldConfig(field_of_view_deg=90.0, range_limits=(0.5, 8.0), landmarks=30),
    "fine": WorldConfig(range_percent=0.0, range_sigma=0.03, bearing_sigma_deg=0.5, landmarks=30),
}


def random_names(log: LandmarkLog, rng: np.random.Generator, fraction: float) -> LandmarkLog:
    """Random other names for this fraction of the observations."""
    names, landmark = np.unique(log.landmark), log.landmark.copy()
    wrong = rng.random(len(landmark)) < fraction
    other = rng.integers(1, len(names), wrong.sum())
    landmark[wrong] = names[(np.searchsorted(names, landmark[wrong]) + other) % len(names)]
    return replace(log, landmark=landmark)


def near_names(log: LandmarkLog, rng: np.random.Generator) -> LandmarkLog:
    """The name of the nearest other landmark for 5 % of the observations."""
    xy = log.landmark_truth.xy
    apart = np.hypot(*(xy[:, None] - xy).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    wrong = rng.random(len(log.landmark)) < 0.05
    return replace(log, landmark=np.where(wrong, apart.argmin(1)[log.landmark], log.landmark))


def swapped_names(log: LandmarkLog, rng: np.random.Generator) -> LandmarkLog:
    """Two names are swapped in the second half."""
    a, b = rng.choice(np.unique(log.landmark), 2, replace=False)
    name, late = np.arange(log.landmark.max() + 1), log.observation_pose > len(log.time) // 2
    name[[a, b]] = b, a
    return replace(log, landmark=np.where(late, name[log.landmark], log.landmark))


def wrong_first_names(log: LandmarkLog, rng: np.random.Generator) -> LandmarkLog:
    """A quarter of the landmarks have a wrong name at their first observation."""
    names, first = np.unique(log.landmark, return_index=True)
    landmark = log.landmark.copy()
    for k in first[rng.random(len(first)) < 0.25]:
        landmark[k] = rng.choice(names[names != landmark[k]])
    return replace(log, landmark=landmark)


def moved_landmark(log: LandmarkLog, rng: np.random.Generator) -> LandmarkLog:
    """One landmark is 3 m away in the second half."""
    moved, angle = rng.choice(np.unique(log.landmark)), rng.uniform(-np.pi, np.pi)
    old = log.landmark_truth.xy[moved]
    new = old + 3 * np.array([np.cos(angle), np.sin(angle)])
    late = (log.landmark == moved) & (log.observation_pose > len(log.time) // 2)
    z = log.observation.copy()
    for k in np.flatnonzero(late):
        pose = log.truth.pose[log.observation_pose[k]]
        z[k] += slam.difference(slam.observe(pose, new)[0], slam.observe(pose, old)[0])
    z[:, 0] = np.maximum(z[:, 0], 0.05)
    return replace(log, observation=z)


def hidden_names(log: LandmarkLog, rng: np.random.Generator) -> LandmarkLog:
    """Half of the names are missing."""
    hidden = rng.random(len(log.landmark)) < 0.5
    return replace(log, landmark=np.where(hidden, -1, log.landmark))


FAULTS: dict[str, Callable[[LandmarkLog, np.random.Generator], LandmarkLog]] = {
    "1 %": lambda log, rng: random_names(log, rng, 0.01),
    "5 %": lambda log, rng: random_names(log, rng, 0.05),
    "near 5 %": near_names,
    "swapped": swapped_names,
    "first": wrong_first_names,
    "moved": moved_landmark,
    "half": hidden_names,
}


def rmse(log: LandmarkLog) -> float:
    """RMSE of the filtered position in meters; the log starts at the true pose."""
    return position_rmse(slam.run(log).filtered, log.truth, aligned=False)


def main() -> None:
    options = arguments(
        __doc__,
        runs=20,
        seed=0,
        worlds={"nargs": "+", "choices": WORLDS, "default": list(WORLDS)},
        faults={"nargs": "+", "choices": FAULTS, "default": list(FAULTS)},
    )
    require_one_thread()
    for world in options.worlds:
        logs = [simulate_world(WORLDS[world], options.seed + i) for i in range(options.runs)]
        right = np.array([rmse(log) for log in logs])
        print(f"{world}: right names {right.mean():.3f} m", flush=True)
        for fault in options.faults:
            errors = np.array(
                [rmse(FAULTS[fault](log, np.random.default_rng(i))) for i, log in enumerate(logs)]
            )
            worst = int((errors / right).argmax())
            low, high = np.quantile(errors / right, [0.1, 0.9])
            print(
                f"  {fault:9} {errors.mean() / right.mean():5.2f} ({low:.2f}-{high:.2f}), "
                f"worst {errors[worst]:.2f} for {right[worst]:.2f} m",
                flush=True,
            )


if __name__ == "__main__":
    main()
