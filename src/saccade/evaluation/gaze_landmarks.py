"""A robot with a camera that turns, at the level of landmarks: by a map that it makes or knows."""

import numpy as np

from saccade.evaluation.drives import score_drive
from saccade.frames import steps_between
from saccade.gaze import Gazer, Policy
from saccade.simulation import WorldConfig, simulate_world
from saccade.simulation.drive import ENCODER_SIGMA
from saccade.slam import EkfConfig, Slam
from saccade.slam.models import compose, observe, wrap
from saccade.types import LandmarkLog, Trajectory

FIELD_OF_VIEW, REACH, RATE, PERIOD = float(np.radians(50)), 8.0, float(np.radians(120)), 0.2
"""Of the camera in radians, metres and radians per second; and seconds from scan to scan."""
SPEED, LAPS = 1.0, 2
"""Of the robot in metres per second."""
KNOWN_SIGMA = 0.02
"""Standard deviation of the landmarks of a map that is known, in metres."""
COURSES = {  # metres, curvature, seed of the landmarks
    "pond": (62.0, 0.0, 1),
    "clover": (80.0, 0.9, 2),
    "island": (96.0, 1.4, 3),
    "park": (114.0, 1.0, 4),
    "yard": (70.0, 0.5, 5),
    "campus": (105.0, 1.2, 6),
}


def landmark_world(name: str) -> WorldConfig:
    """An uneven world of `COURSES`: landmarks stand in groups, and wheels err systematically."""
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
        bearing_sigma=1.0,
        odometry_percent=1.0,
        scale_percent=3.0,
        heading_drift=1.5,
    )


def drive_by_landmarks(
    world: WorldConfig,
    policy: str | Policy,
    seed: int,
    known: bool = False,
    fov: float = FIELD_OF_VIEW,
) -> dict[str, float]:
    """Drive through a world; the camera sees what lies in the view that a policy chooses.

    Args:
        world: its scans see in all directions.
        policy: see `Gazer`.
        seed: of all noise, which is equal for all policies, and of what the policy draws.
        known: whether the map is known, else it is made.
        fov: of the camera in radians.

    Returns:
        Root mean squared error of the position in metres, fraction of the positions inside their
        99.7 % ellipse, and whether landmarks of the first lap were seen again in the second.
    """
    log = simulate_world(world, seed)
    assert log.truth is not None
    slam = _robot(log, known)
    gazer = Gazer(
        slam,
        fov,
        REACH,
        rate=RATE,
        period=PERIOD,
        policy=policy,
        seed=seed,
        pan_sigma=ENCODER_SIGMA,
    )
    encoder = ENCODER_SIGMA * np.random.default_rng([seed, 1]).standard_normal(len(log.time))
    steps = steps_between(log.truth.pose)  # a robot that follows a path knows those to come
    results = []
    pan, closed, first = 0.0, False, dict[int, int]()
    scans = np.searchsorted(log.observation_pose, np.arange(len(log.time) + 1))
    for i, time in enumerate(log.time.tolist()):
        rows = np.arange(scans[i], scans[i + 1])
        rows = rows[np.abs(wrap(log.observation[rows, 1] - pan)) <= fov / 2]
        names = log.landmark[rows]
        moved = (log.control[i - 1], log.control_covariance[i - 1]) if i else (None, None)
        z = log.observation[rows] + np.array([0.0, encoder[i]])
        scan = z, gazer.add_pan_error(log.observation_covariance[rows]), names
        results.append(slam.step(time, *moved, *(scan if len(rows) else ())))
        gazer.observed(pan + encoder[i], names)
        for name in names.tolist():
            closed |= i - first.setdefault(name, i) > len(log.time) / LAPS / 2
        pan = gazer.next(steps[i:] if i < len(steps) else None).pan
    poses, covariances = zip(*((each.pose, each.covariance) for each in results), strict=True)
    estimate = Trajectory(log.time, np.array(poses), np.array(covariances))
    error = score_drive(estimate, log.truth)
    inside = error.inside_3sigma
    return {"ate_m": error.ate_unaligned_m, "closed": closed, "inside_3sigma": inside}


def _robot(log: LandmarkLog, known: bool) -> Slam:
    """At the start of a log, with all landmarks in its map if it is known."""
    config = EkfConfig(association="known", recover=False)
    slam = Slam(config, start=log.start, motion=compose, odometry_bias=log.odometry_bias)
    if known:
        assert log.landmark_truth is not None
        z = observe(log.start, log.landmark_truth.xy)[0]
        R = KNOWN_SIGMA**2 * np.stack([np.ones(len(z)), z[:, 0] ** -2.0], 1)[:, None] * np.eye(2)
        slam.step(float(log.time[0]), z=z, R=R, names=log.landmark_truth.id)
        slam.mode = "localize"
    return slam
