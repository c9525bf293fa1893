"""Maps of dense worlds from logs without landmark identities.

    OMP_NUM_THREADS=1 uv run python benchmarks/dense_maps.py    (docs/measured.md, docs/limits.md)

A robot drives two laps in a square of 27 m, whose landmarks stand on a grid with a random shift
each, and runs by its defaults with the identities of the landmarks and without. A row is the mean
over seeds:

- sigma: largest standard deviation, with identities, of a predicted observation as a fraction of
  the spacing; over .5 the landmarks are closer together than the robot knows its position
- seen: landmarks that were observed ten times or more; map: landmarks without identities
- split: landmarks of the map beyond the first of the same true one; false: of no true one
- wrong: associated observations that are not of the landmark's most frequent identity
- used: observations that were associated
- known, hidden: RMSE of the position in metres; ratio: the second by the first

"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from measuring import arguments, without_labels
from saccade import slam
from saccade.evaluation.trajectory import position_rmse
from saccade.plane import steps_between
from saccade.types import FloatArray, LandmarkLog, LandmarkMap, Trajectory

SIDE = 27.0
"""Metres of the square."""
STEP = 0.5
"""Metres from scan to scan."""
NOISES = {
    "fine": (0.01, (0.02, 1.0)),
    "middle": (0.03, (0.05, 2.0)),
    "coarse": (0.06, (0.1, 3.0)),
}
"""Of each level: standard deviation of the odometry in metres, and in radians, of a step of one
metre; of range in metres and bearing in degrees."""
REASONABLY_OFTEN = 10
"""Observations of a landmark from which it should be in the map."""


@dataclass(frozen=True)
class DenseWorld:
    """A world and its noise."""

    spacing: float = 3.0
    """Metres between landmarks."""
    reach: float = 10.0
    """Metres up to which they are observed."""
    noise: str = "middle"
    """Of `NOISES`."""
    missed: float = 0.0
    """Probability with which a landmark in reach is missed."""
    laps: int = 2


def simulate(world: DenseWorld, seed: int) -> LandmarkLog:
    """A log with identities, -1 for false detections, and the truth."""
    rng = np.random.default_rng(seed)
    truth = path(world.laps)
    count = round(SIDE / world.spacing)
    grid = (np.arange(count) - (count - 1) / 2) * world.spacing
    landmarks = np.stack(np.meshgrid(grid, grid), -1).reshape(-1, 2)
    landmarks = landmarks + rng.uniform(-0.2, 0.2, landmarks.shape) * world.spacing
    relative, (range_sigma, bearing_sigma) = NOISES[world.noise]
    sigma = np.array([range_sigma, np.deg2rad(bearing_sigma)])
    U = np.diag([relative, relative / 3, relative / 2]) ** 2 * STEP
    rows = []
    for i, pose in enumerate(truth):
        z, _ = slam.observe(pose, landmarks)
        visible = (z[:, 0] < world.reach) & (z[:, 0] > 0.3)
        visible &= rng.random(len(z)) >= world.missed
        names, z = np.flatnonzero(visible), z[visible] + sigma * rng.normal(size=(visible.sum(), 2))
        rows.append(np.column_stack([np.full(len(z), i), names, z]))
    seen = np.concatenate(rows)
    control = steps_between(truth)
    time = np.arange(len(truth), dtype=np.float64)
    return LandmarkLog(
        name=f"{world.spacing} m apart, reach {world.reach} m, {world.noise}",
        start=truth[0],
        time=time,
        motion="compose",
        control=control + rng.normal(size=control.shape) * np.sqrt(U.diagonal()),
        control_covariance=np.tile(U, (len(control), 1, 1)),
        observation_pose=seen[:, 0].astype(np.int64),
        observation=seen[:, 2:],
        observation_covariance=np.tile(np.diag(sigma**2), (len(seen), 1, 1)),
        landmark=seen[:, 1].astype(np.int64),
        truth=Trajectory(time, truth),
        landmark_truth=LandmarkMap(np.arange(len(landmarks)), landmarks),
    )


def path(laps: int) -> FloatArray:
    """Poses (t, 3), equally spaced on a course with turns to both sides."""
    angle = np.linspace(0, 2 * np.pi * laps, 20000 * laps)
    radius = 9 + 2.5 * np.cos(3 * angle)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    length = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    at = np.arange(0, length[-1] - 0.01, STEP)
    heading = np.interp(at, length, np.unwrap(np.arctan2(np.gradient(y), np.gradient(x))))
    return np.stack([np.interp(at, length, x), np.interp(at, length, y), slam.wrap(heading)], 1)


def compare(world: DenseWorld, seed: int) -> list[float]:
    """The columns of a row from sigma to hidden."""
    log = simulate(world, seed)
    named = np.flatnonzero(log.landmark >= 0)
    known = slam.run(
        replace(
            log,
            observation_pose=log.observation_pose[named],
            observation=log.observation[named],
            observation_covariance=log.observation_covariance[named],
            landmark=log.landmark[named],
        )
    )
    S = known.innovation_covariance[np.isfinite(known.consistency.nis)]
    sigma = np.sqrt(np.linalg.eigvalsh(S)[:, 1].max(initial=0.0)) / world.spacing
    seen = (np.bincount(log.landmark[named]) >= REASONABLY_OFTEN).sum()
    hidden = slam.run(without_labels(log))
    used = np.flatnonzero(hidden.association >= 0)
    counts = np.zeros((len(hidden.map), int(log.landmark.max()) + 2), np.int64)
    np.add.at(counts, (hidden.association[used], log.landmark[used]), 1)  # false ones are last
    most = counts.argmax(1)
    false = most == counts.shape[1] - 1
    split = len(most) - false.sum() - len(np.unique(most[~false]))
    wrong = 1 - counts.max(1, initial=0).sum() / max(len(used), 1)
    assert log.truth is not None
    errors = [position_rmse(each.filtered, log.truth) for each in (known, hidden)]
    counted = (seen, len(hidden.map), split, false.sum(), wrong)
    return [sigma, *map(float, counted), len(used) / len(log.landmark), *errors]


def main() -> None:
    given = arguments(
        __doc__,
        spacing=[1.5, 3.0, 6.0],
        reach=[4.0, 10.0, 20.0, 40.0],
        noise={"nargs": "+", "choices": NOISES, "default": list(NOISES)},
        seeds=3,
    )
    print(
        "spacing reach  noise    sigma  seen    map split false   wrong   used   known hidden ratio"
    )
    for spacing, reach, noise in product(given.spacing, given.reach, given.noise):
        world = DenseWorld(spacing, reach, noise)
        rows = [compare(world, seed) for seed in range(given.seeds)]
        sigma, seen, landmarks, split, false, wrong, used, known, hidden = np.mean(rows, 0)
        print(
            f"{spacing:7.1f} {reach:5.0f}  {noise:7} {sigma:6.2f} {seen:5.0f} {landmarks:6.1f}"
            f" {split:5.1f} {false:5.1f} {wrong:7.1%} {used:6.1%} {known:7.3f} {hidden:7.3f}"
            f" {hidden / known:6.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
