"""Checks of a landmark log: which other reading of its numbers explains it better.

Sightings of a landmark a short while apart are compared through odometry. Where another unit, sign,
axis, order or clock predicts the later ones much better than the numbers as they are, it is named.
No filter is run: gates and wrong associations have no part in it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from saccade.diagnostics.findings import Finding, counted
from saccade.errors import LogError
from saccade.landmark_names import name_texts
from saccade.plane import (
    path_of,
    point_covariance,
    rotated,
    rotations,
    to_points,
    to_relative_poses,
)
from saccade.slam.consistency import normalized_squared
from saccade.types import FloatArray, IntArray, LandmarkLog

MAX_BEARING = 2 * np.pi
"""Largest bearing in radians; a difference of two angles in (-pi, pi] is not larger."""
FAR = 1000.0
"""Median range in meters that is hardly one of a robot's sensor."""
MIN_PAIRS = 30
"""Minimum number of pairs of observations at one lag."""
MAX_PAIRS = 2000
"""Number of pairs at one lag above which some are left out."""
MIN_MOTION = 0.08
"""Smallest relative movement of a landmark between the observations of a pair."""
MAX_MOTION = 0.45
"""Largest median relative movement of the landmarks at a lag."""
MIN_GAIN = 0.5
"""Nats per pair by which another reading must be better, unless it has a minimum of its own."""
MIN_WINS = 0.7
"""Fraction of tenths of the log in which another reading must be better."""
NOISE_FACTORS = (1 / 12, 1.5)
"""Smallest and largest factor on the standard deviations that is accepted."""
MIN_NOISE_GAIN = 0.15
"""Nats per pair by which a factor outside `NOISE_FACTORS` must be better."""
MIN_REPEATED = 10
"""Minimum number of poses with a label twice for the label to be called shared."""
MIN_SEPARATION = 3.0
"""Minimum distance of two observations with the same label, in standard deviations."""
MAX_GAP = 20.0
"""Largest duration of a step, over the duration that 99 % of the steps are within."""
FACTORS: FloatArray = np.exp2(np.arange(-7.0, 8.0))
"""Factors on the standard deviations among which the best is taken."""
SINGULAR = 1e-8
"""Variance added to an observation, over its squared range: exact ones have none."""
DEGREE, MILLIMETER = np.pi / 180, 1e-3
AHEAD = "Bearings are 0 straight ahead and positive to the left: "


@dataclass(frozen=True, eq=False)
class Readings:
    """The numbers of a log, as they are or as another convention reads them."""

    control: FloatArray
    """(t, 3) forward, left, turn."""
    control_covariance: FloatArray
    """(t, 3, 3)."""
    observation: FloatArray
    """(k, 2) range, bearing."""
    observation_covariance: FloatArray
    """(k, 2, 2)."""
    time: FloatArray
    """(t + 1,) of the poses."""
    observed: FloatArray
    """(k,) time of each observation."""

    def scaled(self, control: tuple[float, ...], observation: tuple[float, ...]) -> "Readings":
        """Other units, of the standard deviations too."""
        u, z = np.array(control), np.array(observation)
        return replace(
            self,
            control=self.control * u,
            control_covariance=self.control_covariance * np.outer(u, u),
            observation=self.observation * z,
            observation_covariance=self.observation_covariance * np.outer(z, z),
        )

    def observing(self, distance: FloatArray, bearing: FloatArray) -> "Readings":
        """Other ranges (k,) and bearings (k,), of the same covariances."""
        return replace(self, observation=np.stack([distance, bearing], 1))


class Rival(NamedTuple):
    """Another reading of a log."""

    check: str
    what: str
    advice: str
    readings: Readings
    min_gain: float = MIN_GAIN


def shared_name_finding(
    log: LandmarkLog, numbers: Sequence[int], distance: float, when: str
) -> Finding:
    """Finding of names that several landmarks share, the one with most evidence first."""
    names = [str(name) for name in name_texts(np.array(numbers), log.text_names)]
    what = f"several landmarks share the name {names[0]}: it is observed {when} at places "
    what += f"{distance:.1f} m apart"
    if len(names) > 1:
        others = ", ".join(names[1:7])
        what += f" (so {counted(len(names) - 1, 'is', 'are')}: {others})"
    advice = "Give each landmark a name of its own, or leave the name empty where it is unsure"
    return Finding("error", "shared name", what, advice, distance, "m")


def check_log(log: LandmarkLog) -> tuple[Finding, ...]:
    """Check the units, signs, axes, order, clock and noise of a log, before it is mapped.

    Args:
        log: the log.

    Returns:
        What is wrong, the likeliest cause first; empty for a log without controls or observations
        that can be compared.

    Raises:
        LogError: bearings that are no angles in radians.
    """
    bearing = np.abs(log.observation[:, 1])
    if (bearing > MAX_BEARING).any():
        raise LogError(
            f"{log.name}: expected bearings in radians, found {bearing.max():.4g}, which is over "
            "2 pi: they are in degrees; multiply bearings, turns and headings by pi / 180, and "
            "their variances by its square"
        )
    control, covariance = to_relative_poses(log)
    readings = Readings(
        *(control, covariance, log.observation, log.observation_covariance),
        *(log.time, log.time[log.observation_pose]),
    )
    findings = [*_check_readings(log, readings), *_check_gap(log)]
    findings += _check_repeated_names(log, control)
    median = float(np.median(log.observation[:, 0])) if len(bearing) else 0.0
    if median > FAR and not any("millimetres" in finding.check for finding in findings):
        what = f"half of the ranges are over {median:.0f} m, which is far for a sensor"
        advice = "If ranges and odometry are in millimetres, divide both by 1000"
        findings.append(Finding("warning", "millimetres", what, advice, median, "m"))
    return tuple(findings)


def _check_gap(log: LandmarkLog) -> Iterator[Finding]:
    """A long step, in which odometry was lost."""
    duration = np.diff(log.time)
    if len(duration) < MIN_PAIRS:
        return
    longest, usual = int(duration.argmax()), float(np.quantile(duration, 0.99))
    if duration[longest] > MAX_GAP * usual:
        start, end = log.time[longest : longest + 2] - log.time[0]
        what = (
            f"steps are lost: there is no pose from {start:.1f} to {end:.1f} s after the first, "
            "and odometry of one step at its end"
        )
        advice = "Record odometry without gaps, or map the parts one by one"
        yield Finding("warning", "lost steps", what, advice, float(duration[longest]), "s")


def _check_repeated_names(log: LandmarkLog, control: FloatArray) -> Iterator[Finding]:
    """Names that a pose has twice, at places farther apart than noise and its step explain."""
    order = np.lexsort((log.observation_pose, log.landmark))
    a, b = order[:-1], order[1:]
    twice = (log.landmark[a] >= 0) & (log.landmark[a] == log.landmark[b])
    twice &= log.observation_pose[a] == log.observation_pose[b]
    a, b = a[twice], b[twice]
    if len(a) == 0 or len(control) == 0:
        return
    xy = to_points(log.observation)
    C = point_covariance(log.observation, log.observation_covariance)
    floor = SINGULAR * np.square(log.observation[b, :1, None]) + 1e-12
    square = normalized_squared(xy[b] - xy[a], C[a] + C[b] + floor * np.eye(2))
    distance = np.hypot(*(xy[b] - xy[a]).T)
    step = np.hypot(*control[:, :2].T) + np.abs(control[:, 2]) * np.median(log.observation[:, 0])
    apart = (square > MIN_SEPARATION**2) & (distance > np.quantile(step, 0.99))
    names, count = np.unique(log.landmark[a[apart]], return_counts=True)
    names = names[np.argsort(-count, kind="stable")][: int((count >= MIN_REPEATED).sum())]
    if len(names):
        of = apart & (log.landmark[a] == names[0])
        yield shared_name_finding(log, names.tolist(), float(np.median(distance[of])), "at once")


def _check_readings(log: LandmarkLog, readings: Readings) -> Iterator[Finding]:
    """The rival reading that explains the log best, if any, and the factor of its noise."""
    pairs = _pairs(log)
    if len(pairs[0]) < MIN_PAIRS:
        return
    recorded, (factor, of_odometry) = _gains(readings, *pairs)
    least, most = NOISE_FACTORS
    accepted = FACTORS[(least <= FACTORS) & (most >= FACTORS)]
    stated, _ = _gains(readings, *pairs, accepted)
    best, size = None, 0.0
    order = np.argsort(readings.observed[pairs[0]], kind="stable")
    for rival in _rivals(readings):
        gain = _gains(rival.readings, *pairs)[0] - recorded
        wins = np.mean([tenth.mean() > 0 for tenth in np.array_split(gain[order], 10)])
        if gain.mean() > max(size, rival.min_gain) and wins >= MIN_WINS:
            best, size = rival, float(gain.mean())
    if best is not None:
        yield Finding("error", best.check, best.what, best.advice, size, "nats")
    elif recorded.mean() - stated.mean() > MIN_NOISE_GAIN:
        word, verb, times = (
            ("large", "Divide", 1 / factor) if factor < 1 else ("small", "Multiply", factor)
        )
        noun = "log" if of_odometry == factor else "observations"
        what = f"the standard deviations of the {noun} are about {times:.0f} times too {word}"
        yield Finding("error", "noise", what, f"{verb} them by {times:.0f}", factor, "times")


def _rivals(log: Readings) -> Iterator[Rival]:
    """Other readings, each with its meaning."""
    mm, (distance, bearing) = MILLIMETER, log.observation.T
    what, advice = "turns of odometry are in degrees", "Multiply them by pi / 180"
    yield Rival("degrees", what, advice, log.scaled((1, 1, DEGREE), (1, 1)))
    for readings in (log.scaled((1, 1, 1), (mm, 1)), log.observing(mm * distance, bearing)):
        yield Rival("millimetres", "ranges are in millimetres", "Divide them by 1000", readings)
    what, readings = (
        "odometry is in millimetres and ranges are not",
        log.scaled((mm, mm, 1), (1, 1)),
    )
    yield Rival("odometry in millimetres", what, "Divide its distances by 1000", readings)
    what, readings = "bearings and turns have opposite signs", log.scaled((1, 1, 1), (1, -1))
    advice = "Both are positive to the left (counter-clockwise): change the sign of the bearings"
    yield Rival("mirrored bearings", what, advice, readings)
    what = "the axes of the observations are swapped: bearings are clockwise from the left"
    readings = log.observing(distance, np.pi / 2 - bearing)
    yield Rival("swapped axes", what, f"{AHEAD}pi / 2 minus these", readings)
    for degrees in (90, -90, 180):
        what = f"the frame of the observations is turned by {degrees} degrees"
        advice = f"{AHEAD}{'subtract' if degrees > 0 else 'add'} {abs(degrees)} degrees"
        readings = log.observing(distance, bearing - np.deg2rad(degrees))
        yield Rival("turned sensor", what, advice, readings)
    what = "turn and translation of a step are in the wrong order"
    advice = (
        "The columns distance, turn turn first and then drive; forward, left are in the frame "
        "of the last pose, before the turn"
    )
    for turns in (-1.0, 1.0):
        xy = rotated(log.control[:, :2], turns * log.control[:, 2])
        readings = replace(log, control=np.column_stack([xy, log.control[:, 2]]))
        yield Rival("motion order", what, advice, readings, min_gain=0.16)
    what = "bearings are relative to the map, not to the heading of the robot"
    heading = np.interp(log.observed, log.time, path_of(log.control)[:, 2])
    readings = log.observing(distance, bearing - heading)
    advice = "Subtract the heading of the robot"
    yield Rival("absolute bearings", what, advice, readings, min_gain=1.0)
    what = (
        "steps are lost with their odometry: where the time has gaps the robot moves farther than "
        "odometry does"
    )
    advice = "Keep every step of odometry, or sum those between two poses"
    yield Rival("lost steps", what, advice, _filled(log), min_gain=0.08)
    spacing = max(0.5, float(np.median(np.diff(log.time))))
    for delay in np.outer(spacing * np.arange(1, 11), (1, -1)).ravel():
        late, cure = ("late", "Subtract") if delay > 0 else ("early", "Add")
        what = f"the clock of the observations is {abs(delay):g} s {late} against that of odometry"
        advice = f"{cure} {abs(delay):g} s {'from' if delay > 0 else 'to'} the times of the "
        readings = replace(log, observed=log.observed - delay)
        yield Rival("clock offset", what, f"{advice}observations", readings, min_gain=0.3)


def _filled(log: Readings) -> Readings:
    """Controls that are short of the speed around them, made as long as the step takes."""
    duration = np.diff(log.time)
    rate = log.control / np.maximum(duration, 1e-9)[:, None]
    around = np.pad(rate, ((3, 3), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(around, 7, axis=0)
    expected = np.median(windows, -1) * duration[:, None]
    short = np.abs(log.control[:, 0]) < 0.8 * np.abs(expected[:, 0])
    short &= duration > 1.2 * np.median(duration)
    factor = np.where(short, duration / np.median(duration), 1.0)
    return replace(
        log,
        control=np.where(short[:, None], expected, log.control),
        control_covariance=log.control_covariance * factor[:, None, None],
    )


def _pairs(log: LandmarkLog) -> tuple[IntArray, IntArray]:
    """Earlier (m,) and later (m,) observations of a landmark, a short while apart.

    Lags double, from the shortest in which landmarks move noticeably; at most three are used.
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
        first = first[:: 1 + len(first) // MAX_PAIRS]
        a, b = order[first], order[later[first]]
        lag *= 2
        if len(a) < MIN_PAIRS:
            continue
        ranges = np.maximum(log.observation[a, 0] + log.observation[b, 0], 1e-12)
        movement = np.hypot(*(xy[a] - xy[b]).T) / ranges
        if np.median(movement) > MAX_MOTION and found:
            break
        if np.median(movement) < MIN_MOTION:
            found.clear()  # a longer lag says more
        moved = movement > MIN_MOTION  # the others fit every reading
        found.append((a[moved], b[moved]))
    if not found:
        return none, none
    return np.concatenate([a for a, _ in found]), np.concatenate([b for _, b in found])


def _tracks(log: LandmarkLog, xy: FloatArray) -> IntArray:
    """(k,) the same number for observations of the same landmark: its name.

    Without names, mutual nearest neighbors in consecutive scans, where no other is near.
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


def _residuals(
    log: Readings, a: IntArray, b: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Later observations (m, 2) minus those predicted; covariances of sensor and odometry."""
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
    floor = SINGULAR * np.square(log.observation[b, :1]) + 1e-12
    sensor = C[b] + T @ C[a] @ T.transpose(0, 2, 1) + floor[:, :, None] * np.eye(2)
    change = y[:, 3:] - x[:, 3:]
    odometry = W @ change[:, :4].reshape(-1, 2, 2) @ W.transpose(0, 2, 1)
    middle = (carried + xy[b]) / 2  # where a turn in the middle of the way sees the landmark
    lever = np.stack([-middle[:, 1], middle[:, 0]], 1)
    odometry += change[:, 4, None, None] * lever[:, :, None] * lever[:, None, :]
    return residual, sensor, odometry


def _gains(
    log: Readings, a: IntArray, b: IntArray, noise: FloatArray = FACTORS
) -> tuple[FloatArray, tuple[float, float]]:
    """Log-likelihood (m,) of each pair over that of a guess, at the likeliest factor of its noise.

    Sensor and odometry are diagonalized together, so that each factor costs a sum. A gain is at
    least 0, since any pair may be an outlier.

    Returns:
        The gains, and the factors on the standard deviations of sensor and odometry: equal, or
        that of odometry 1.
    """
    residual, sensor, odometry = _residuals(log, a, b)
    whitening = np.linalg.inv(np.linalg.cholesky(sensor))
    variance, axes = np.linalg.eigh(whitening @ odometry @ whitening.transpose(0, 2, 1))
    axes = axes.transpose(0, 2, 1) @ whitening
    square = np.square((axes @ residual[:, :, None])[:, :, 0])
    constant = np.log(np.abs(np.linalg.det(whitening))) - np.log(2 * np.pi) - _guess(log)
    best = np.zeros(len(a)), (1.0, 1.0)
    for k in noise.tolist():
        for factors in ((k, k), (k, 1.0)):
            S = factors[0] ** 2 + factors[1] ** 2 * variance
            gain = np.maximum(constant - (square / S + np.log(S)).sum(1) / 2, 0.0)
            if gain.mean() > best[0].mean():
                best = gain, factors
    return best


def _guess(log: Readings) -> float:
    """Mean log-likelihood of the observations by their own mean and covariance."""
    spread = np.linalg.det(np.cov(to_points(log.observation).T))
    return float(-np.log(2 * np.pi * np.e) - np.log(max(spread, 1e-300)) / 2)
