"""Checks of the conventions of a landmark log: units, signs, axes, order and clock.

Repeated observations of a landmark within a short time are compared through odometry. If another
unit, sign, axis, order or clock predicts the later observations much better, it is reported. No
filter is run, so that gates and wrong associations have no influence.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from saccade.diagnostics.findings import AXES, Finding, counted
from saccade.diagnostics.observation_pairs import (
    EXACT_VARIANCE,
    FACTORS,
    MIN_LAG_PAIRS,
    Readings,
    gains,
    pairs,
)
from saccade.diagnostics.sensor_mounting import Mounting
from saccade.diagnostics.steps import check_steps
from saccade.diagnostics.truth import check_truth_of_log
from saccade.errors import LogError
from saccade.landmark_names import name_texts
from saccade.plane import (
    in_robot_frame,
    path_of,
    point_covariance,
    relative_poses_of,
    rotated,
    to_points,
)
from saccade.slam.consistency import normalized_squared
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkLog

MAX_BEARING = 2 * np.pi
"""Maximum bearing in radians, reached by the difference of two angles in (-pi, pi]."""
MAX_MEDIAN_RANGE = 1000.0
"""Maximum plausible median range of a robot's sensor, in meters."""
MIN_ALTERNATIVE_GAIN = 0.5
"""Minimum gain of an alternative in nats per pair, unless it has its own minimum."""
MIN_WINS = 0.7
"""Minimum fraction of tenths of the log in which an alternative must be better."""
SIMILAR_GAIN = 0.8
"""Minimum ratio of two gains for an ambiguous cause: motion order or mounting of the sensor."""
TURN_DRIFTS = np.deg2rad([-3.0, -2.0, -1.0, -0.5, 0.5, 1.0, 2.0, 3.0])
"""Errors of the turn of odometry, in radians per meter."""
MIN_DRIFT_GAIN = 0.15
"""Minimum gain of one of them, in nats per pair."""
NOISE_FACTORS = (1 / 12, 1.5)
"""Minimum and maximum factor of the standard deviations without a finding."""
MIN_NOISE_GAIN = 0.15
"""Minimum gain of a factor outside `NOISE_FACTORS`, in nats per pair."""
MIN_REPEATED = 10
"""Minimum number of poses that observe a label twice for the label to count as shared."""
MIN_REPEAT_SEPARATION = 3.0
"""Minimum distance of two observations with the same label, in standard deviations."""
MAX_DURATION_RATIO = 20.0
"""Maximum duration of a step, relative to the 99th percentile of durations."""
DEGREE = np.pi / 180
"""One degree in radians."""
MILLIMETER = 1e-3
"""One millimeter in meters."""


class Rival(NamedTuple):
    """An alternative convention for the numbers of a log."""

    check: str
    what: str
    readings: Readings
    advice: str | None = None
    """Advice in place of the usual one."""
    min_gain: float = MIN_ALTERNATIVE_GAIN


def shared_name_finding(
    log: LandmarkLog, numbers: Sequence[int], distance: float, when: str
) -> Finding:
    """Finding on labels shared by several landmarks; `numbers` in descending order of evidence."""
    names = [str(name) for name in name_texts(np.array(numbers), log.text_names)]
    what = f"several landmarks share the label {names[0]}: it is observed {when} at positions "
    what += f"{distance:.1f} m apart"
    if len(names) > 1:
        others = ", ".join(names[1:7])
        what += f" ({counted(len(names) - 1, 'more is', 'more are')} shared: {others})"
    return Finding.of("shared label", what, distance)


def check_log(log: LandmarkLog) -> tuple[Finding, ...]:
    """Checks the units, signs, axes, order, clock and noise of a log before mapping.

    Args:
        log: the log.

    Returns:
        Findings, the most likely cause first; empty if the log has no observations to compare.

    Raises:
        LogError: the bearings are not in radians.
    """
    bearing = np.abs(log.observation[:, 1])
    if (bearing > MAX_BEARING).any():
        raise LogError(
            f"{log.name}: expected bearings in radians, found {np.nanmax(bearing):.4g}, which is "
            "over 2 pi: they are in degrees; multiply bearings, turns and headings by pi / 180, "
            "and their variances by its square"
        )
    sensor, whole = log.sensor, ~np.isnan(log.observation).any(1)
    log = in_robot_frame(_observations_of(log, np.asarray(whole)))
    control, covariance = relative_poses_of(log)
    readings = Readings(
        *(control, covariance, log.observation, log.observation_covariance),
        *(log.time, log.time[log.observation_pose]),
    )
    findings = [*_check_readings(log, readings, sensor), *_check_gap(log)]
    findings += _check_repeated_names(log, control)
    path = path_of(control)
    findings += [*check_steps(log.time, path), *check_truth_of_log(log, path)]
    median = float(np.median(log.observation[:, 0])) if whole.any() else 0.0
    if median > MAX_MEDIAN_RANGE and not any(
        "millimeters" in finding.check for finding in findings
    ):
        what = f"half of the ranges exceed {median:.0f} m, which is far for a sensor"
        findings.append(Finding.of("far ranges", what, median))
    return (*findings, *_not_compared(log, np.asarray(whole), len(pairs(log)[0])))


def _not_compared(log: LandmarkLog, whole: BoolArray, compared: int) -> Iterator[Finding]:
    """Lists the comparisons that the log does not allow.

    `whole` is True for observations with range and bearing, `compared` the number of pairs of
    observations of one landmark.
    """
    reasons = []
    if len(whole) and not whole.any():
        reasons.append("no observation has both range and bearing")
    elif compared < MIN_LAG_PAIRS:
        reasons.append(
            f"only {compared} pairs of observations show the same landmark from different positions"
        )
    if reasons:
        reasons[0] += (
            ": units, signs, axes, order of motion, clock, mounting of the sensor and noise were "
            "not compared"
        )
    if len(log.landmark) and not (log.landmark >= 0).any():
        reasons.append("no observation has a label: labels were not compared")
    if reasons:
        yield Finding.of("not compared", "; ".join(reasons), len(reasons))


def _observations_of(log: LandmarkLog, kept: BoolArray) -> LandmarkLog:
    """The log restricted to the observations `kept` (k,)."""
    names = ("observation_pose", "observation", "observation_covariance", "landmark")
    columns: dict[str, Any] = {name: getattr(log, name)[kept] for name in names}
    return log if kept.all() else replace(log, **columns)


def _check_gap(log: LandmarkLog) -> Iterator[Finding]:
    """Checks for a long step, in which odometry was lost."""
    duration = np.diff(log.time)
    if len(duration) < MIN_LAG_PAIRS:
        return
    longest, usual = int(duration.argmax()), float(np.quantile(duration, 0.99))
    if duration[longest] > MAX_DURATION_RATIO * usual:
        start, end = log.time[longest : longest + 2] - log.time[0]
        what = (
            f"steps are lost: there is no pose from {start:.1f} to {end:.1f} s after the first, "
            "and only one step of odometry covers this time"
        )
        yield Finding.of("odometry gap", what, float(duration[longest]))


def _check_repeated_names(log: LandmarkLog, control: FloatArray) -> Iterator[Finding]:
    """Labels that a pose observes twice, farther apart than noise and motion explain."""
    order = np.lexsort((log.observation_pose, log.landmark))
    a, b = order[:-1], order[1:]
    twice = (log.landmark[a] >= 0) & (log.landmark[a] == log.landmark[b])
    twice &= log.observation_pose[a] == log.observation_pose[b]
    a, b = a[twice], b[twice]
    if len(a) == 0 or len(control) == 0:
        return
    xy = to_points(log.observation)
    C = point_covariance(log.observation, log.observation_covariance)
    floor = EXACT_VARIANCE * np.square(log.observation[b, :1, None]) + 1e-12
    square = normalized_squared(xy[b] - xy[a], C[a] + C[b] + floor * np.eye(2))
    distance = np.hypot(*(xy[b] - xy[a]).T)
    step = np.hypot(*control[:, :2].T) + np.abs(control[:, 2]) * np.median(log.observation[:, 0])
    apart = (square > MIN_REPEAT_SEPARATION**2) & (distance > np.quantile(step, 0.99))
    names, count = np.unique(log.landmark[a[apart]], return_counts=True)
    names = names[np.argsort(-count, kind="stable")][: int((count >= MIN_REPEATED).sum())]
    if len(names):
        of = apart & (log.landmark[a] == names[0])
        yield shared_name_finding(log, names.tolist(), float(np.median(distance[of])), "at once")


def _check_readings(
    log: LandmarkLog, readings: Readings, sensor: tuple[float, float, float]
) -> Iterator[Finding]:
    """Yields the best alternative convention, if any, and a wrong scale of the noise."""
    a, b = pairs(log)
    if len(a) < MIN_LAG_PAIRS:
        return
    found = [*_compare(log, readings, sensor, a, b)]
    if found and (straight := _without_drift(readings, a, b)) is not readings:
        found = [*_compare(log, straight, sensor, a, b)]
    yield from found


def _compare(
    log: LandmarkLog,
    readings: Readings,
    sensor: tuple[float, float, float],
    a: IntArray,
    b: IntArray,
) -> Iterator[Finding]:
    """Yields what explains the pairs of observations a and b better than the log does."""
    recorded, (factor, of_odometry) = gains(readings, a, b)
    least, most = NOISE_FACTORS
    accepted = FACTORS[(least <= FACTORS) & (most >= FACTORS)]
    stated, _ = gains(readings, a, b, accepted)
    mounting = Mounting.fit(readings, a, b, log.odometry_bias)
    mounted = float((gains(mounting.apply(readings), a, b)[0] - recorded).mean())
    found: dict[str, tuple[float, Rival]] = {}
    order = np.argsort(readings.observed[a], kind="stable")
    for rival in (*_mounting_rival(readings, mounting, sensor), *_rivals(readings)):
        gain = gains(rival.readings, a, b)[0] - recorded
        wins = np.mean([tenth.mean() > 0 for tenth in np.array_split(gain[order], 10)])
        if wins >= MIN_WINS and gain.mean() > found.get(rival.check, (rival.min_gain,))[0]:
            found[rival.check] = float(gain.mean()), rival
    if found:
        yield _likeliest(found, mounted, _mounted_at(mounting, sensor))
    elif recorded.mean() - stated.mean() > MIN_NOISE_GAIN:
        word, verb, times = (
            ("large", "Divide", 1 / factor) if factor < 1 else ("small", "Multiply", factor)
        )
        noun = "log" if of_odometry == factor else "observations"
        what = f"the standard deviations of the {noun} are about {times:.0f} times too {word}"
        yield Finding.of("noise", what, factor, advice=f"{verb} them by {times:.0f}")


def _without_drift(log: Readings, a: IntArray, b: IntArray) -> Readings:
    """The log with odometry that turns otherwise for each meter, if that explains it better.

    The filter estimates such an error. Left in, it resembles a wrong order of motion, or noise.
    """
    x, y, turn = log.control.T
    path = np.hypot(x, y)
    turned = [
        replace(log, control=np.column_stack([x, y, turn + drift * path])) for drift in TURN_DRIFTS
    ]
    gain = [gains(each, a, b)[0].mean() for each in (log, *turned)]
    best = int(np.argmax(gain))
    return (log, *turned)[best] if gain[best] > gain[0] + MIN_DRIFT_GAIN else log


def _likeliest(found: dict[str, tuple[float, Rival]], mounted: float, where: str) -> Finding:
    """The finding for the alternative with the greatest gain.

    A wrong order of turn and translation resembles a sensor displaced along the heading by the
    length of a step. It is an error only if no mounting of the sensor explains the log as well.

    Args:
        found: gain in nats and alternative, by name of the check.
        mounted: gain of the most likely sensor mounting.
        where: description of that mounting.
    """
    size, best = max(found.values(), key=lambda each: each[0])
    if best.check == "sensor mounting" and "motion order" in found:
        by_order, order = found["motion order"]
        size, best = (by_order, order) if by_order > SIMILAR_GAIN * size else (size, best)
    if best.check == "motion order" and mounted > SIMILAR_GAIN * size:
        what = f"{best.what}, or {where}"
        return Finding.of(best.check, what, size, advice=best.advice, severity="warning")
    return Finding.of(best.check, best.what, size, advice=best.advice)


def _mounting_rival(
    log: Readings, mounting: Mounting, sensor: tuple[float, float, float]
) -> Iterator[Rival]:
    """Yields a different mounting of the sensor, if significant."""
    if mounting.is_significant:
        x, y, yaw = mounting.after(sensor)
        advice = f"Give its pose, --sensor {x:.2f},{y:.2f},{yaw:.3f} or `LandmarkLog.sensor`"
        what = _mounted_at(mounting, sensor)
        yield Rival("sensor mounting", what, mounting.apply(log), advice, min_gain=0.05)


def _mounted_at(mounting: Mounting, sensor: tuple[float, float, float]) -> str:
    """Describes a mounting of the sensor."""
    x, y, yaw = mounting.after(sensor)
    sigma = mounting.sigma
    return (
        f"the sensor is mounted {x:.2f} ± {sigma[0]:.2f} m ahead and {y:.2f} ± {sigma[1]:.2f} m "
        f"to the left of the robot's origin and turned by {np.rad2deg(yaw):.1f} ± "
        f"{np.rad2deg(sigma[2]):.1f} degrees, not as the log has it"
    )


def _rivals(log: Readings) -> Iterator[Rival]:
    """Yields alternative conventions with their descriptions."""
    mm, (distance, bearing) = MILLIMETER, log.observation.T
    what = "turns of odometry are in degrees"
    yield Rival("degrees", what, log.scaled((1, 1, DEGREE), (1, 1)))
    for readings in (log.scaled((1, 1, 1), (mm, 1)), log.observing(mm * distance, bearing)):
        yield Rival("millimeters", "ranges are in millimeters", readings)
    what, readings = (
        "odometry is in millimeters and ranges are not",
        log.scaled((mm, mm, 1), (1, 1)),
    )
    yield Rival("odometry in millimeters", what, readings)
    what, readings = "bearings and turns have opposite signs", log.scaled((1, 1, 1), (1, -1))
    yield Rival("mirrored bearings", what, readings)
    what = "the axes of the observations are swapped: bearings are clockwise from the left"
    readings = log.observing(distance, np.pi / 2 - bearing)
    yield Rival("swapped axes", what, readings)
    for degrees in (90, -90, 180):
        what = f"the frame of the observations is turned by {degrees} degrees"
        advice = f"{AXES}: {'subtract' if degrees > 0 else 'add'} {abs(degrees)} degrees"
        readings = log.observing(distance, bearing - np.deg2rad(degrees))
        yield Rival("turned sensor", what, readings, advice)
    what = "turn and translation of a step are in the wrong order"
    for turns in (-1.0, 1.0):
        xy = rotated(log.control[:, :2], turns * log.control[:, 2])
        readings = replace(log, control=np.column_stack([xy, log.control[:, 2]]))
        yield Rival("motion order", what, readings, min_gain=0.16)
    what = "bearings are relative to the map, not to the heading of the robot"
    heading = np.interp(log.observed, log.time, path_of(log.control)[:, 2])
    readings = log.observing(distance, bearing - heading)
    yield Rival("absolute bearings", what, readings, min_gain=1.0)
    what = (
        "steps are lost with their odometry: across gaps in time the robot moves farther than "
        "odometry indicates"
    )
    yield Rival("lost steps", what, _filled(log), min_gain=0.08)
    spacing = max(0.5, float(np.median(np.diff(log.time))))
    for delay in np.outer(spacing * np.arange(1, 11), (1, -1)).ravel():
        late, cure = ("late", "Subtract") if delay > 0 else ("early", "Add")
        what = f"the clock of the observations is {abs(delay):g} s {late} against that of odometry"
        advice = f"{cure} {abs(delay):g} s {'from' if delay > 0 else 'to'} the times of the "
        readings = replace(log, observed=log.observed - delay)
        yield Rival("clock offset", what, readings, f"{advice}observations", min_gain=0.3)


def _filled(log: Readings) -> Readings:
    """Log with short controls extended to the neighboring speed times the step's duration."""
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
