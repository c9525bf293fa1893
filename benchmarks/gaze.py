"""Gaze policies of a camera that turns: position errors in simulated worlds (docs/gaze.md).

    uv run python benchmarks/gaze.py [--first-seed 20] [--map known]
    uv run python benchmarks/gaze.py --level images [--seeds 12] [--bound] [--json FILE]

Landmarks: wheels have systematic errors, landmarks stand in groups, and the map is made or known
before. Closed: drives that observed landmarks of the first lap again in the second. Images: halls
with few posters, rendered and mapped by the whole pipeline, with the motion by wheels. Correct:
re-identifications of the right landmark. The bound maps with seven cameras that look around, whose
frames make one map.

ATE is the median absolute trajectory error without alignment, in meters. Ratios to `fixed` and
`sweep` are geometric means over worlds and seeds, with 95 % intervals over the seeds.
The second table has the ratios to `fixed` in each world and in the worst drive. Inside: poses whose
true position lies in the 99.7 % ellipse. NEES: mean normalized estimation error squared of the
poses, 3 if the covariances are right. The JSON file has ATE, correct or closed, inside and NEES of
each drive.
"""

import json
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from measuring import arguments, geometric_mean, in_processes, with_interval
from saccade import visual
from saccade.evaluation.runs import summarize_drive
from saccade.evaluation.trajectory import score_drive
from saccade.frames import CameraTurn, Drive, Frame
from saccade.gaze import POLICIES, Gazer, Policy
from saccade.plane import steps_between
from saccade.simulation import DriveConfig, PanCamera, WorldConfig, simulate_drive, simulate_world
from saccade.simulation.drive import ENCODER_SIGMA
from saccade.simulation.gaze_drive import SETTINGS, gaze_drive
from saccade.slam import EkfConfig, Slam
from saccade.slam.consistency import pose_nees
from saccade.slam.filter.robot_models import observe, wrap
from saccade.types import FloatArray, LandmarkLog, Trajectory

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

HALLS = {
    "sparse": {"size": (18.0, 14.0), "blocks": 0, "poster_groups": 4},
    "island": {"size": (16.0, 12.0), "blocks": 1, "poster_groups": 1},
    "gallery": {"size": (18.0, 16.0), "blocks": 1, "poster_groups": 3, "corridor": 6.0},
    "kiosks": {"size": (17.0, 13.0), "blocks": 2, "poster_groups": 1},
    "foyer": {"size": (15.0, 15.0), "blocks": 1, "poster_groups": 2, "corridor": 4.0},
}
"""Settings of each hall."""
CAMERAS = 7
"""Number of cameras of the bound."""


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
    egomotion: str = "wheels"


def drive(run: Run) -> tuple[float, bool, float, float]:
    """ATE in meters, whether a loop was closed, fraction of poses inside 3 sigma, and NEES."""
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
    steps = steps_between(log.truth.pose)  # the planned path
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
    return error.ate_unaligned_m, closed, error.inside_3sigma, mean_nees(estimate, log.truth)


def mean_nees(estimate: Trajectory, truth: Trajectory) -> float:
    """Mean NEES of the poses that are not known exactly, at the times of the truth."""
    return float(np.nanmean(pose_nees(estimate, truth, "standard")))


def _robot(log: LandmarkLog, known: bool) -> Slam:
    """A robot at the start of a log, with all landmarks in its map if this is known."""
    config = EkfConfig(association="known", recover=False, range_errors=(0.0, 0.0))
    slam = Slam(config, start=log.start, odometry_bias=log.odometry_bias)
    if known:
        z = observe(log.start, log.landmark_truth.xy)[0]
        R = KNOWN_SIGMA**2 * np.stack([np.ones(len(z)), z[:, 0] ** -2.0], 1)[:, None] * np.eye(2)
        slam.step(float(log.time[0]), z=z, R=R, labels=log.landmark_truth.id)
        slam.mode = "localize"
    return slam


def image_drive(run: Run) -> tuple[float, float, float, float]:
    """ATE in meters, fraction of correct re-identifications, of poses inside 3 sigma, and NEES."""
    hall = replace(DriveConfig.hall(), **HALLS[run.world])
    if run.policy == "bound":
        made = _around(hall, run.seed)
        result = visual.run(made, replace(SETTINGS, egomotion="wheels", detect_interval=1))
    else:
        made, result = gaze_drive(hall, run.policy, run.seed, egomotion=run.egomotion)
    error = score_drive(result.trajectory, made.truth)
    precision = summarize_drive(made, result)["association_precision"]
    correct = 1.0 if precision is None else precision  # nothing was re-identified
    nees = mean_nees(result.trajectory, made.truth)
    return error.ate_unaligned_m, correct, error.inside_3sigma, nees


class _Direction(PanCamera):
    """A camera that looks in the direction to which it was set."""

    pan = 0.0

    def angle(self, _: float) -> float:
        return self.pan

    def measured(self, _: float) -> CameraTurn:
        return CameraTurn(self.pan, 0.0, ENCODER_SIGMA)


def _around(hall: DriveConfig, seed: int) -> Drive:
    """A drive whose cameras look all around, one after the other at almost the same time."""
    direction = _Direction()
    made = simulate_drive(hall, seed, direction)

    def load(i: int) -> Frame:
        direction.pan = float(wrap(2 * np.pi * (i % CAMERAS) / CAMERAS))
        return replace(made.load(i // CAMERAS), time=float(time[i]))

    n = CAMERAS * len(made)
    time = np.repeat(made.time, CAMERAS) + 1e-3 * (np.arange(n) % CAMERAS)
    control, covariance = np.zeros((n - 1, 3)), np.full((n - 1, 3, 3), 1e-12 * np.eye(3))
    control[CAMERAS - 1 :: CAMERAS] = made.control
    covariance[CAMERAS - 1 :: CAMERAS] = made.control_covariance
    truth = Trajectory(time, np.repeat(made.truth.pose, CAMERAS, 0))
    return replace(
        made, time=time, control=control, control_covariance=covariance, load=load, truth=truth
    )


def main() -> None:
    given = arguments(
        __doc__,
        level={"choices": ("landmarks", "images"), "default": "landmarks"},
        map={"choices": ("new", "known"), "default": "new"},
        worlds={"nargs": "+"},
        policies={"nargs": "+"},
        egomotion="wheels",
        bound=False,
        seeds=10,
        first_seed=0,
        jobs=1,
        json={"type": Path},
    )
    images = given.level == "images"
    worlds = given.worlds or list(HALLS if images else COURSES)
    policies = given.policies or [each for each in POLICIES if not images or each != "salient"]
    policies += ["bound"] * given.bound
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    known = given.map == "known"
    runs = [
        Run(*each, known, egomotion=given.egomotion) for each in product(worlds, policies, seeds)
    ]
    rows = [*in_processes(image_drive if images else drive, runs, given.jobs)]
    table = np.array(rows, float).reshape(len(worlds), len(policies), given.seeds, 4)
    report(table, worlds, policies, images)
    if given.json is not None:
        text = json.dumps({"worlds": worlds, "policies": policies, "rows": table.tolist()})
        given.json.write_text(text)


def report(table: FloatArray, worlds: list[str], policies: list[str], images: bool) -> None:
    """Prints the figures (worlds, policies, seeds, 4) of `drive` or `image_drive`."""
    log = np.log(table[..., 0])
    print(f"{'':8} ATE [m]  to fixed          to sweep           "
          f"{'correct' if images else 'closed '}  inside [%]  NEES")  # fmt: skip
    for p, policy in enumerate(policies):
        ratios = [
            with_interval(geometric_mean((log[:, p] - log[:, policies.index(other)]).mean(0)))
            for other in ("fixed", "sweep")
            if other in policies
        ]
        second, inside = table[:, p, :, 1], 100 * table[:, p, :, 2].mean()
        nees = table[:, p, :, 3].mean()
        closed = f"{second.sum():3.0f} of {second.size}"
        print(f"{policy:8} {np.exp(np.median(log[:, p])):7.3f}  {'  '.join(ratios)}"
              f"  {f'{second.mean():.4f}' if images else closed}"
              f"  {inside:10.1f}  {nees:4.1f}")  # fmt: skip
    if "fixed" not in policies:
        return
    print("to fixed", *(f"{world:>8}" for world in worlds), "  worst drive  over twice")
    for p, policy in enumerate(policies):
        gain = log[:, p] - log[:, policies.index("fixed")]
        by_world = (f"{ratio:8.2f}" for ratio in np.exp(gain.mean(1)))
        twice = 100 * np.mean(gain > np.log(2))
        print(f"{policy:8}", *by_world, f"{np.exp(gain.max()):13.2f}  {twice:8.1f} %")


if __name__ == "__main__":
    main()
