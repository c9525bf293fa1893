"""Traces the textbook's EKF-SLAM through the first scans of a log (appendix C)."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from saccade.errors import LogError
from saccade.textbook.ekf_slam import f, g, h
from saccade.types import FloatArray, LandmarkLog

MAX_SCANS = 8
"""Scans of a log that are traced."""


class State(NamedTuple):
    """State and covariance of the filter."""

    s: FloatArray
    """(3 + 2N,) pose (x, y, heading) and landmarks."""
    P: FloatArray
    """(3 + 2N, 3 + 2N) covariance."""


class Transition(NamedTuple):
    """One step of the filter."""

    before: State
    after: State
    observed: FloatArray | None
    """(2,) position at which the observation puts its landmark; None for a prediction."""


@dataclass
class FilterTrace:
    """The states of a filter in the first scans of a log."""

    transitions: dict[str, Transition] = field(default_factory=dict)
    """The last "predict" and "augment", and the "update" that reduced the covariance most."""
    scans: list[tuple[str, State]] = field(default_factory=list)
    """Title and state after each scan."""


def trace_filter(log: LandmarkLog, ekf_slam: Any, max_scans: int = MAX_SCANS) -> FilterTrace:
    """Run the filter of the textbook over the first scans of a log.

    Args:
        log: with landmark identities.
        ekf_slam: the class `EkfSlam`.
        max_scans: poses with observations.

    Raises:
        LogError: the log has no landmark identities, or another motion model.
    """
    if log.motion == "custom" or (log.landmark < 0).any() or len(log.landmark) == 0:
        raise LogError(
            f"{log.name}: expected observations that name their landmarks, and controls that are "
            "distance and turn, as appendix C has them"
        )
    ekf, trace, max_gain = ekf_slam(log.start), FilterTrace(), -np.inf
    index_of: dict[int, int] = {}
    for pose in range(len(log.time)):
        state = _state(ekf)
        for u, U in _controls(log, pose - 1) if pose else ():
            ekf.predict(u, U)
            trace.transitions["predict"] = Transition(state, _state(ekf), None)
        observations = np.flatnonzero(log.observation_pose == pose)
        for i in observations:
            state, landmark = _state(ekf), int(log.landmark[i])
            z, R = log.observation[i], log.observation_covariance[i]
            observed = g(ekf.x, z)
            if landmark in index_of:
                ekf.update(index_of[landmark], z, R)
                update = Transition(state, _state(ekf), observed)
                if (gain := float(np.trace(state.P - update.after.P))) > max_gain:
                    max_gain, trace.transitions["update"] = gain, update
            else:
                ekf.augment(z, R)
                index_of[landmark] = len(index_of)
                trace.transitions["augment"] = Transition(state, _state(ekf), observed)
        if len(observations):
            count = "1 landmark" if len(index_of) == 1 else f"{len(index_of)} landmarks"
            trace.scans.append((f"scan {len(trace.scans) + 1}: {count}", _state(ekf)))
        if len(trace.scans) == max_scans:
            break
    return trace


def simulated_log() -> LandmarkLog:
    """A robot that drives once around a heptagon among landmarks, under large noise."""
    rng = np.random.default_rng(5)
    landmarks = np.array([[2.6, -0.9], [3.6, 2.4], [1.2, 4.4], [-2.3, 3.0], [-1.4, -0.4]])
    u = np.tile([1.6, 2 * np.pi / 7], (7, 1))
    U, R = np.diag([0.08, 0.06]) ** 2, np.diag([0.15, 0.05]) ** 2
    poses = [np.zeros(3)]
    for control in u:
        poses.append(f(poses[-1], control))
    observations = [
        (pose, landmark, *z)
        for pose, x in enumerate(poses)
        for landmark, m in enumerate(landmarks)
        if (z := h(x, m))[0] < 3.2 and abs(z[1]) < 1.6
    ]
    pose_of, landmark_of, *z_of = np.array(observations).T
    return LandmarkLog(
        name="small world",
        start=np.zeros(3),
        time=np.arange(len(poses), dtype=float),
        motion="drive",
        control=u + rng.multivariate_normal(np.zeros(2), U, len(u)),
        control_covariance=np.tile(U, (len(u), 1, 1)),
        observation_pose=pose_of.astype(np.int64),
        observation=np.transpose(z_of) + rng.multivariate_normal(np.zeros(2), R, len(observations)),
        observation_covariance=np.tile(R, (len(observations), 1, 1)),
        landmark=landmark_of.astype(np.int64),
    )


def _state(ekf: Any) -> State:
    return State(np.array(ekf.s), np.array(ekf.P))


def _controls(log: LandmarkLog, step: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    """The control of a step as (d, phi) with its covariance.

    A control that translates before it turns becomes two, without its lateral uncertainty.
    """
    u, U = log.control[step], log.control_covariance[step]
    if log.motion == "drive":
        yield u, U
        return
    forward, left, turn = u
    phi = np.arctan2(left, forward)
    yield np.array([np.hypot(forward, left), phi]), np.diag([U[0, 0], 0.0])
    yield np.array([0.0, turn - phi]), np.diag([0.0, U[2, 2]])
