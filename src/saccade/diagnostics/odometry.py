"""Checks of odometry and ground truth against the camera's motion."""

from collections.abc import Iterator

import numpy as np

from saccade.diagnostics.findings import Finding, Severity, counted
from saccade.diagnostics.survey import (
    MIN_STEPS,
    Fit,
    Lag,
    MotionSeries,
    Survey,
    fit,
    lag_of,
    series_of,
)
from saccade.frames import Drive
from saccade.plane import steps_between

MIN_TURN_RATE = 0.01
"""Minimum standard deviation of the turn rate, in rad/s, for a comparison of turns."""
MIN_CORRELATION = 0.3
"""Minimum correlation of turns for images and odometry of the same drive."""
MAX_SCALE_ERROR = 0.1
"""Maximum relative error of the scale of odometry."""
MAX_TURN_BIAS = 2.0
"""Maximum usual bias of a gyroscope, in degrees per second."""
STANDSTILL = 0.1
"""Maximum translation of a stationary camera, relative to odometry."""
MAX_SLIP_FRACTION = 0.25
"""Maximum fraction of steps with a stationary camera while odometry moves."""
MAX_NOISE_RATIO = 2.0
"""Maximum ratio of the observed to the stated standard deviation of odometry errors."""
TURNING = 0.1
"""Minimum turn rate of a step in a turn, in rad/s."""
JUMP_RATIO = 10.0
"""Minimum change of speed of a jump, in standard deviations."""


def check_turns(series: MotionSeries, lag: Lag | None) -> Iterator[Finding]:
    """Checks sign, clock, scale, bias and noise of the turns; stops at the first root cause."""
    if lag is None or not _turns(series):
        return
    if wrong := [*_check_correlation(series, lag, "odometry", ("turn", "turn sign", "clock lag"))]:
        yield from wrong
        return
    turns = fit(np.stack([series.rotation[:, 2], series.duration], 1), series.odometry[:, 2])
    if turns is not None and turns.differs(0, 1.0, MAX_SCALE_ERROR):
        advice = None
        if abs(np.log(abs(float(turns.value[0])) / np.rad2deg(1.0))) < 0.1:
            advice = "It is in degrees: turns are in radians"
        yield _scale_finding("turn scale", "odometry turns", turns, "images", advice)
        return
    if turns is not None and abs(turns.value[1]) >= 4 * turns.error[1]:
        bias = float(np.rad2deg(turns.value[1]))
        severity: Severity = "warning" if abs(bias) > MAX_TURN_BIAS else "note"
        side = "left" if bias > 0 else "right"
        what = f"odometry constantly turns {abs(bias):.2f} deg/s to the {side} of the images"
        yield Finding.of("turn bias", what, bias, severity=severity)
    yield from _check_noise(series, turns, 2, "turn", "rad")


def _turns(series: MotionSeries) -> bool:
    """Whether there are enough steps with turns."""
    return len(series) >= MIN_STEPS and bool(
        np.std(series.rotation[:, 2] / series.duration) >= MIN_TURN_RATE
    )


def _check_correlation(
    series: MotionSeries, lag: Lag, source: str, names: tuple[str, str, str]
) -> Iterator[Finding]:
    """Checks that turns of odometry, or of ground truth, match the images in sign and time.

    `names` are the names of the findings for unrelated turns, opposite turns and a clock offset.
    """
    if lag.correlation < MIN_CORRELATION:
        name, relation = names[0], "unrelated"
        if lag.correlation < -MIN_CORRELATION:
            name, relation = names[1], "opposite"
        what = f"the turns of {source} and of the images are {relation}: "
        what += f"their correlation is {lag.correlation:.2f}"
        yield Finding.of(name, what, lag.correlation)
    elif lag.frames != 0 and (1 - lag.correlation_without**2) > 1.2 * (1 - lag.correlation**2):
        seconds = lag.frames * float(np.median(series.duration))
        late, frames = seconds > 0, counted(abs(lag.frames), "frame", "frames")
        what = (
            f"the clock of {source} is {abs(seconds):.2f} s ({frames}) "
            f"{'late' if late else 'early'}: shifted, its turns correlate with those of the images "
            f"by {lag.correlation:.3f}, unshifted by {lag.correlation_without:.3f}"
        )
        advice = f"{'Subtract this from' if late else 'Add this to'} the times of {source}"
        yield Finding.of(names[2], what, seconds, advice=advice)


def _scale_finding(
    name: str, moves: str, fitted: Fit, other: str, advice: str | None = None
) -> Finding:
    scale, error = float(fitted.value[0]), 2 * fitted.error[0]
    what = f"{moves} {scale:.2f} times (within {error:.2f}) as far as the {other}"
    return Finding.of(name, what, scale, advice=advice)


def _check_noise(
    series: MotionSeries, fitted: Fit | None, column: int, name: str, unit: str
) -> Iterator[Finding]:
    """Checks the errors of a column of odometry against its covariance."""
    sigma = np.sqrt(np.median(series.covariance[:, column, column]))
    if fitted is not None and fitted.sigma > MAX_NOISE_RATIO * sigma:
        what = (
            f"odometry's {name} is wrong by {fitted.sigma:.2g} {unit} in a step (one standard "
            f"deviation, compared with the images); by its covariance by {sigma:.2g} {unit}"
        )
        advice = (
            f"Make the standard deviations {fitted.sigma / max(sigma, 1e-12):.1f} times as large"
        )
        yield Finding.of(f"{name} noise", what, float(fitted.sigma), advice=advice)


def check_direction(moving: MotionSeries) -> Iterator[Finding]:
    """Checks that the camera moves with odometry, and in the same direction."""
    camera, odometry = moving.translation, moving.odometry[:, 0]
    still = 100 * float(np.mean(np.linalg.norm(camera, axis=1) < STANDSTILL * np.abs(odometry)))
    same_sign = float(np.mean(np.sign(camera[:, 0]) == np.sign(odometry)))
    if still > 100 * MAX_SLIP_FRACTION:
        what = f"the images stand still in {still:.0f} % of the steps in which odometry moves"
        yield Finding.of("standstill", what, still)
    elif same_sign < 0.25:
        what = f"the images move opposite to odometry in {100 * (1 - same_sign):.0f} % of the steps"
        yield Finding.of("translation sign", what, same_sign)


def check_translations(series: MotionSeries) -> Iterator[Finding]:
    """Checks noise and scale of the forward translation, if the images measure it."""
    if not series.metric.any():
        return
    with_bias = np.stack([series.translation[:, 0], series.duration], 1)
    fitted = fit(with_bias, series.odometry[:, 0])
    yield from _check_noise(series, fitted, 0, "translation", "m")
    moving = series.moving
    fitted = fit(moving.translation[:, :1], moving.odometry[:, 0])
    if fitted is not None and fitted.differs(0, 1.0, MAX_SCALE_ERROR):
        yield _scale_finding("translation scale", "odometry moves", fitted, "images")


def check_jumps(drive: Drive) -> Iterator[Finding]:
    """Checks for steps in which odometry is much faster than just before and after."""
    duration = np.diff(drive.time)
    if len(duration) < MIN_STEPS:
        return
    speed = np.hypot(*drive.control[:, :2].T) / np.maximum(duration, 1e-6)
    turn_rate = np.abs(drive.control[:, 2]) / np.maximum(duration, 1e-6)
    jumps = np.zeros(len(duration), bool)
    for values, least in ((speed, 2.0), (turn_rate, 1.0)):
        padded = np.pad(values, 2, mode="reflect")
        neighbors = np.stack([padded[k : k + len(values)] for k in (0, 1, 3, 4)])
        excess = values - np.median(neighbors, 0)
        sigma = 1.4826 * np.median(np.abs(excess))
        jumps |= excess > np.maximum(JUMP_RATIO * sigma, least)
    if jumps.any():
        longest = float(np.hypot(*drive.control[jumps, :2].T).max())
        steps = np.flatnonzero(jumps) + 1
        what = f"odometry jumps in {counted(len(steps), 'step', 'steps')}, the longest of "
        what += f"{longest:.2f} m"
        count = float(len(steps))
        yield Finding.of("odometry jump", what, count, frames=tuple(steps.tolist()))


MAX_LENGTH_ERROR = 0.05
"""Maximum relative difference between the lengths from the images and from ground truth."""


def check_truth(drive: Drive, survey: Survey, agree: bool) -> Iterator[Finding]:
    """Checks turns, clock and lengths of the ground truth against the images.

    If images and odometry disagree, only lengths are checked; turns would repeat the finding.
    """
    if drive.truth is None:
        return
    steps = steps_between(drive.truth.at(drive.time))
    series, lag = series_of(drive, survey, steps), lag_of(drive, survey, steps)
    if len(series) < MIN_STEPS:
        return
    if agree and lag is not None and _turns(series):
        names = "truth turns", "truth turns", "truth clock"
        if wrong := [*_check_correlation(series, lag, "the truth", names)]:
            yield from wrong
            return
    moving = series.moving
    if not series.metric.any() or len(moving) < MIN_STEPS:
        return
    fitted = fit(moving.odometry[:, :1], moving.translation[:, 0])  # turns move it sideways
    if fitted is not None and fitted.differs(0, 1.0, MAX_LENGTH_ERROR):
        yield _scale_finding("truth length", "the images move", fitted, "truth")
