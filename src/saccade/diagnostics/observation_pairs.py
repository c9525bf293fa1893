"""Pairs of observations of a landmark within a short time, compared through odometry."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from saccade.plane import path_of, point_covariance, rotated, rotations, to_points
from saccade.types import FloatArray, IntArray, LandmarkLog

MIN_LAG_PAIRS = 30
"""Minimum number of pairs of observations at one lag."""
MAX_LAG_PAIRS = 2000
"""Approximate maximum number of pairs at one lag."""
MIN_MOTION = 0.08
"""Minimum relative movement of a landmark between the observations of a pair."""
MAX_MOTION = 0.45
"""Maximum median relative movement of the landmarks at a lag."""
FACTORS: FloatArray = np.exp2(np.arange(-7.0, 8.0))
"""Candidate factors of the standard deviations."""
EXACT_VARIANCE = 1e-8
"""Variance added to observations, relative to the squared range, since exact ones have none."""


@dataclass(frozen=True, eq=False)
class Readings:
    """The numbers of a log under a given convention."""

    control: FloatArray
    """(t, 3) forward, left, turn."""
    control_covariance: FloatArray
    """(t, 3, 3)."""
    observation: FloatArray
    """(k, 2) range, bearing."""
    observation_covariance: FloatArray
    """(k, 2, 2)."""
    time: FloatArray
    """(t + 1,) times of the poses."""
    observed: FloatArray
    """(k,) time of each observation."""

    def scaled(self, control: tuple[float, ...], observation: tuple[float, ...]) -> "Readings":
        """The log in other units, including the standard deviations."""
        u, z = np.array(control), np.array(observation)
        return replace(
            self,
            control=self.control * u,
            control_covariance=self.control_covariance * np.outer(u, u),
            observation=self.observation * z,
            observation_covariance=self.observation_covariance * np.outer(z, z),
        )

    def observing(self, distance: FloatArray, bearing: FloatArray) -> "Readings":
        """The log with other ranges (k,) and bearings (k,), and the same covariances."""
        return replace(self, observation=np.stack([distance, bearing], 1))


def pairs(log: LandmarkLog) -> tuple[IntArray, IntArray]:
    """Earlier (m,) and later (m,) observations of a landmark within a short time.

    Lags double, starting with the shortest lag of noticeable movement; at most three are used.
    """
    none = np.empty(0, np.int64)
    time, xy = log.time[log.observation_pose], to_points(log.observation)
    if len(time) == 0 or np.ptp(log.time) <= 0:
        return none, none
    track = _tracks(log, xy)
    order = np.lexsort((time, track))
    elapsed = time[order] - time[0]
    key = np.unique(track[order], return_inverse=True)[1] * 4 * (np.ptp(log.time) + 1) + elapsed
    duration = np.diff(log.time)
    lag = float(np.median(duration[duration > 0]))
    found: list[tuple[IntArray, IntArray]] = []
    while lag < np.ptp(log.time) and len(found) < 3:
        later = np.minimum(np.searchsorted(key, key + lag * (1 - 1e-6)), len(key) - 1)
        apart = key[later] - key
        first = np.flatnonzero((apart >= lag * (1 - 1e-6)) & (apart < 2 * lag))
        first = first[:: 1 + len(first) // MAX_LAG_PAIRS]
        a, b = order[first], order[later[first]]
        lag *= 2
        if len(a) < MIN_LAG_PAIRS:
            continue
        ranges = np.maximum(log.observation[a, 0] + log.observation[b, 0], 1e-12)
        movement = np.hypot(*(xy[a] - xy[b]).T) / ranges
        if np.median(movement) > MAX_MOTION and found:
            break
        if np.median(movement) < MIN_MOTION:
            found.clear()  # a longer lag is more informative
        moved = movement > MIN_MOTION  # pairs without movement fit every convention
        found.append((a[moved], b[moved]))
    if not found:
        return none, none
    return np.concatenate([a for a, _ in found]), np.concatenate([b for _, b in found])


def _tracks(log: LandmarkLog, xy: FloatArray) -> IntArray:
    """(k,) landmark number of each observation: the label.

    Without labels, observations are linked to isolated mutual nearest neighbors in consecutive
    scans.
    """
    number = np.arange(len(xy))
    if (log.landmark >= 0).any():
        return np.where(log.landmark >= 0, log.landmark, -1 - number)
    scans = np.split(number, np.flatnonzero(np.diff(log.observation_pose)) + 1)
    for last, scan in pairwise(scans):
        distance = np.hypot(*(xy[last][:, None] - xy[scan]).transpose(2, 0, 1))
        near = distance.argmin(1)
        mutual = np.flatnonzero(distance.argmin(0)[near] == np.arange(len(last)))
        for i in mutual.tolist():
            j = near[i]
            limit = np.minimum(*log.observation[[last[i], scan[j]], 0])
            others = np.concatenate([np.delete(distance[i], j), np.delete(distance[:, j], i)])
            if distance[i, j] < 0.3 * min(limit, others.min(initial=np.inf)):
                number[scan[j]] = number[last[i]]
    return number


def residuals(log: Readings, a: IntArray, b: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (m, 2) of the later observations, with covariances due to sensor and odometry."""
    U, path = log.control_covariance, path_of(log.control)
    along = rotations(path[:-1, 2])
    grown = np.zeros((len(log.time), 5))
    grown[1:, :4] = np.cumsum((along @ U[:, :2, :2] @ along.transpose(0, 2, 1)).reshape(-1, 4), 0)
    grown[1:, 4] = np.cumsum(U[:, 2, 2])
    knots = np.column_stack([path, grown])
    state = np.stack([np.interp(log.observed, log.time, column) for column in knots.T], 1)
    x, y, xy = state[a], state[b], to_points(log.observation)
    turn = x[:, 2] - y[:, 2]
    carried, moved = rotated(xy[a], turn), rotated(x[:, :2] - y[:, :2], -y[:, 2])
    residual = xy[b] - carried - moved
    C = point_covariance(log.observation, log.observation_covariance)
    T, W = rotations(turn), rotations(-y[:, 2])
    floor = EXACT_VARIANCE * np.square(log.observation[b, :1]) + 1e-12
    sensor = C[b] + T @ C[a] @ T.transpose(0, 2, 1) + floor[:, :, None] * np.eye(2)
    change = y[:, 3:] - x[:, 3:]
    odometry = W @ change[:, :4].reshape(-1, 2, 2) @ W.transpose(0, 2, 1)
    middle = (carried + xy[b]) / 2  # landmark position seen from the middle of the motion
    lever = np.stack([-middle[:, 1], middle[:, 0]], 1)
    odometry += change[:, 4, None, None] * lever[:, :, None] * lever[:, None, :]
    return residual, sensor, odometry


def gains(
    log: Readings, a: IntArray, b: IntArray, noise: FloatArray = FACTORS
) -> tuple[FloatArray, tuple[float, float]]:
    """Log-likelihood ratio (m,) of each pair to a guess, at the most likely noise factor.

    Sensor and odometry are diagonalized together, so that each factor costs only a sum. A gain is
    at least 0, since any pair may be an outlier.

    Returns:
        The gains, and the factors of the standard deviations of sensor and odometry: a common
            factor, or 1 for odometry.
    """
    residual, sensor, odometry = residuals(log, a, b)
    whitening = np.linalg.inv(np.linalg.cholesky(sensor))
    variance, axes = np.linalg.eigh(whitening @ odometry @ whitening.transpose(0, 2, 1))
    axes = axes.transpose(0, 2, 1) @ whitening
    square = np.square((axes @ residual[:, :, None])[:, :, 0])
    constant = np.log(np.abs(np.linalg.det(whitening))) - np.log(2 * np.pi) - _guess(log)
    square, variance = square.T.copy(), variance.T.copy()  # (2, m): sums of two rows are fast
    best, most = (np.zeros(len(a)), (1.0, 1.0)), 0.0
    for k in noise.tolist():
        for factors in ((k, k), (k, 1.0)):
            S = factors[0] ** 2 + factors[1] ** 2 * variance
            gain = np.maximum(constant - (square / S + np.log(S)).sum(0) / 2, 0.0)
            if (mean := gain.mean()) > most:
                best, most = (gain, factors), mean
    return best


def _guess(log: Readings) -> float:
    """Mean log-likelihood of the observations by their own mean and covariance."""
    spread = np.linalg.det(np.cov(to_points(log.observation).T))
    return float(-np.log(2 * np.pi * np.e) - np.log(max(spread, 1e-300)) / 2)
