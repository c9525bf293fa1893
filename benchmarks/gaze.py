"""Gaze policies of a camera that turns: position errors in worlds of landmarks (docs/gaze.md).

    uv run python benchmarks/gaze.py [--first-seed 20] [--map known]

Wheels have systematic errors, landmarks stand in groups, and the map is made or known before. ATE
is the absolute trajectory error without alignment in meters, the median. Its ratios to that of
`fixed` and `sweep` are geometric means over worlds and seeds, with 95 % intervals over the seeds;
then come the ratios to `fixed` in each world, and that of the worst drive. Closed: drives that
observed landmarks of the first lap again in the second. Inside: poses whose true position lies in
the 99.7 % ellipse.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from measuring import arguments, geometric_mean, in_processes, with_interval
from saccade.evaluation.trajectory import score_drive
from saccade.gaze import POLICIES, Gazer, Policy
from saccade.plane import steps_between
from saccade.simulation import WorldConfig, simulate_world
from saccade.simulation.drive import ENCODER_SIGMA
from saccade.slam import EkfConfig, Slam
from saccade.slam.models import observe, wrap
from saccade.types import LandmarkLog, Trajectory

FIELD_OF_VIEW = float(np.radians(50))
"""Field of view of the camera in radians."""
REACH = 8.0
"""Range of the camera in meters."""
RATE = float(np.radians(120))
"""Turn rate of the camera in radians per second."""
PERIOD = 0.2
"""Time between two scans in seconds."""
SPEED = 1.0
"""Speed of the robot in meters per second."""
LAPS = 2
KNOWN_SIGMA = 0.02
"""Standard deviation of the landmarks of a known map in meters."""
COURSES = {
    "pond": (62.0, 0.0, 1),
    "clover": (80.0, 0.9, 2),
    "island": (96.0, 1.4, 3),
    "park": (114.0, 1.0, 4),
    "yard": (70.0, 0.5, 5),
    "campus": (105.0, 1.2, 6),
}
"""Length in meters, amplitude of the curvature, and seed of the landmarks of each world."""


def landmark_world(name: str) -> WorldConfig:
    """An uneven world of `COURSES`."""
    length, curvature, layout = COURSES[name]
    return WorldConfig(
        course_length=length,
        curvature_amplitude=curvature,
        steps=round(LAPS * length / SPEED / PERIOD),
        step_length=SPEED * PERIOD,
        step_time=PERIOD,
        landmarks=40,
        group_size=4,
        layout=layout,
        landmark_spread=6.0,
        range_limits=(0.3, REACH),
        range_percent=0.0,
        range_sigma=0.1,
        bearing_sigma_deg=1.0,
        odometry_percent=1.0,
        scale_percent=3.0,
        heading_drift_deg=1.5,
    )


@dataclass(frozen=True)
class Run:
    """One drive with one policy."""

    world: str
    policy: str | Policy
    seed: int
    known: bool = False
    """Whether the map is known before."""
    fov: float = FIELD_OF_VIEW


def drive(run: Run) -> tuple[float, bool, float]:
    """ATE in meters, whether a loop was closed, and the fraction of the poses inside 3 sigma."""
    log = simulate_world(landmark_world(run.world), run.seed)
    slam = _robot(log, run.known)
    gazer = Gazer(
        slam,
        run.fov,
        REACH,
        rate=RATE,
        period=PERIOD,
        policy=run.policy,
        seed=run.seed,
        pan_sigma=ENCODER_SIGMA,
    )
    encoder = ENCODER_SIGMA * np.random.default_rng([run.seed, 1]).standard_normal(len(log.time))
    steps = steps_between(log.truth.pose)  # a robot that follows a path knows those to come
    results = []
    pan, closed, first = 0.0, False, dict[int, int]()
    scans = np.searchsorted(log.observation_pose, np.arange(len(log.time) + 1))
    for i, time in enumerate(log.time.tolist()):
        rows = np.arange(scans[i], scans[i + 1])
        rows = rows[np.abs(wrap(log.observation[rows, 1] - pan)) <= run.fov / 2]
        labels = log.landmark[rows]
        moved = (log.control[i - 1], log.control_covariance[i - 1]) if i else (None, None)
        z = log.observation[rows] + np.array([0.0, encoder[i]])
        scan = z, gazer.add_pan_error(log.observation_covariance[rows]), labels
        results.append(slam.step(time, *moved, *(scan if len(rows) else ())))
        gazer.record(pan=pan + encoder[i], labels=labels)
        for label in labels.tolist():
            closed |= i - first.setdefault(label, i) > len(log.time) / LAPS / 2
        pan = gazer.next(steps[i:] if i < len(steps) else None).pan
    poses, covariances = zip(*((each.pose, each.covariance) for each in results), strict=True)
    estimate = Trajectory(log.time, np.array(poses), np.array(covariances))
    error = score_drive(estimate, log.truth)
    return error.ate_unaligned_m, closed, error.inside_3sigma


def _robot(log: LandmarkLog, known: bool) -> Slam:
    """A robot at the start of a log, with all landmarks in its map if this is known."""
    config = EkfConfig(association="known", recover=False)
    slam = Slam(config, start=log.start, odometry_bias=log.odometry_bias)
    if known:
        z = observe(log.start, log.landmark_truth.xy)[0]
        R = KNOWN_SIGMA**2 * np.stack([np.ones(len(z)), z[:, 0] ** -2.0], 1)[:, None] * np.eye(2)
        slam.step(float(log.time[0]), z=z, R=R, labels=log.landmark_truth.id)
        slam.mode = "localize"
    return slam


def main() -> None:
    given = arguments(
        __doc__,
        map={"choices": ("new", "known"), "default": "new"},
        worlds=list(COURSES),
        policies=list(POLICIES),
        seeds=10,
        first_seed=0,
        jobs=1,
    )
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    chosen = product(given.worlds, given.policies, seeds)
    runs = [Run(*each, given.map == "known") for each in chosen]
    shape = len(given.worlds), len(given.policies), given.seeds, 3
    table = np.array([*in_processes(drive, runs, given.jobs)]).reshape(shape)
    log = np.log(table[..., 0])
    print(f"{'':8} ATE [m]  to fixed          to sweep           closed   inside [%]")
    for p, policy in enumerate(given.policies):
        ratios = [
            with_interval(geometric_mean((log[:, p] - log[:, given.policies.index(other)]).mean(0)))
            for other in ("fixed", "sweep")
            if other in given.policies
        ]
        closed, inside = table[:, p, :, 1], 100 * table[:, p, :, 2].mean()
        print(f"{policy:8} {np.exp(np.median(log[:, p])):7.3f}  {'  '.join(ratios)}"
              f"  {closed.sum():3.0f} of {closed.size}  {inside:5.1f}")  # fmt: skip
    if "fixed" not in given.policies:
        return
    print("to fixed", *(f"{world:>8}" for world in given.worlds), "  worst drive")
    for p, policy in enumerate(given.policies):
        gain = log[:, p] - log[:, given.policies.index("fixed")]
        by_world = (f"{ratio:8.2f}" for ratio in np.exp(gain.mean(1)))
        print(f"{policy:8}", *by_world, f"{np.exp(gain.max()):13.2f}")


if __name__ == "__main__":
    main()
