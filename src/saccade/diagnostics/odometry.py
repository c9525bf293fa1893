"""Odometry, against the motion of the camera."""

from collections.abc import Iterator

import numpy as np

from saccade.diagnostics.findings import Finding, counted
from saccade.diagnostics.motion_series import MIN_STEPS, Lag, MotionSeries
from saccade.diagnostics.robust_regression import Fit, fit
from saccade.frames import Drive
from saccade.types import FloatArray

MIN_TURN_RATE = 0.01
"""Standard deviation of the turn rate in rad/s, from which turns can be compared."""
MIN_CORRELATION = 0.3
"""Correlation of turns from which both are of the same drive."""
MAX_SCALE_ERROR = 0.1
"""Fraction by which odometry may be too long."""
MAX_TURN_BIAS = np.deg2rad(2.0)
"""Radians per second by which a gyroscope may be off."""
STANDSTILL = 0.1
"""Translation of the camera over that of odometry, below which the camera stands still."""
MAX_SLIP = 0.25
"""Fraction of the steps in which it may."""
MAX_NOISE_RATIO = 2.0
"""Standard deviation of the errors over that of the covariance."""
JUMP_RATIO = 10.0
"""Change of speed over its standard deviation, from which it is a jump."""


def check_turns(series: MotionSeries, lag: Lag | None) -> Iterator[Finding]:
    """Sign, clock, scale, bias and noise of the turns; not what follows from an earlier one."""
    if lag is None or len(series) < MIN_STEPS:
        return
    if np.std(series.rotation[:, 2] / series.duration) < MIN_TURN_RATE:
        return
    if lag.correlation < MIN_CORRELATION:
        yield _turn_finding(lag)
        return
    if lag.frames != 0 and (1 - lag.present_correlation**2) > 1.2 * (1 - lag.correlation**2):
        yield _lag_finding(series, lag)
        return
    turns = fit(np.stack([series.rotation[:, 2], series.duration], 1), series.odometry[:, 2])
    if turns is not None and turns.differs(0, 1.0, MAX_SCALE_ERROR):
        advice = "Check the unit of the turn, the wheel base, and the focal length"
        if abs(np.log(abs(float(turns.value[0])) / np.rad2deg(1.0))) < 0.1:
            advice = "It is in degrees: a turn is in radians"
        yield _scale_finding("turn", "turns", turns, advice)
        return
    if turns is not None and abs(turns.value[1]) >= 4 * turns.error[1]:
        yield _bias_finding(float(turns.value[1]))
    yield from _check_noise(series, series.rotation[:, 2], 2, "turn", "rad")


def _turn_finding(lag: Lag) -> Finding:
    opposite = lag.correlation < -MIN_CORRELATION
    return Finding(
        "error",
        "turn sign" if opposite else "turn",
        f"the turns of odometry and of the images are {'opposite' if opposite else 'unrelated'}: "
        f"their correlation is {lag.correlation:.2f}",
        "Turns are positive to the left; change the sign of the turn, or check whether the images "
        "are mirrored"
        if opposite
        else "Check whether both are of the same drive, and camera.rotation",
        lag.correlation,
        "correlation",
    )


def _lag_finding(series: MotionSeries, lag: Lag) -> Finding:
    seconds = lag.frames * float(np.median(series.duration))
    late, frames = seconds > 0, counted(abs(lag.frames), "frame", "frames")
    return Finding(
        "warning",
        "clock lag",
        f"odometry's clock is {abs(seconds):.2f} s ({frames}) {'late' if late else 'early'}: "
        f"shifted, its turns correlate by {lag.correlation:.3f}, unshifted by "
        f"{lag.present_correlation:.3f}",
        f"{'Subtract this from' if late else 'Add this to'} the times of odometry",
        seconds,
        "s",
    )


def _scale_finding(name: str, verb: str, fitted: Fit, advice: str) -> Finding:
    scale = float(fitted.value[0])
    return Finding(
        "warning",
        f"{name} scale",
        f"odometry {verb} {scale:.2f} times as far as the images "
        f"(within {2 * fitted.error[0]:.2f})",
        advice,
        scale,
        "times",
    )


def _bias_finding(bias: float) -> Finding:
    degrees = float(np.rad2deg(bias))
    side = "left" if bias > 0 else "right"
    return Finding(
        "warning" if abs(bias) > MAX_TURN_BIAS else "note",
        "turn bias",
        f"odometry constantly turns {abs(degrees):.2f} deg/s to the {side} of the images",
        "It is the bias of a gyroscope; subtract it if it is known",
        degrees,
        "deg/s",
    )


def _check_noise(
    series: MotionSeries, measured: FloatArray, column: int, name: str, unit: str
) -> Iterator[Finding]:
    """Whether a column of odometry has the errors that its covariance gives."""
    fitted = fit(np.stack([measured, series.duration], 1), series.odometry[:, column])
    sigma = np.sqrt(np.median(series.covariance[:, column, column]))
    if fitted is not None and fitted.sigma > MAX_NOISE_RATIO * sigma:
        yield Finding(
            "warning",
            f"{name} noise",
            f"odometry's {name} is off by {fitted.sigma:.2g} {unit} in a step (one standard "
            f"deviation against the images), its covariance gives {sigma:.2g} {unit}",
            f"Make the standard deviations {fitted.sigma / max(sigma, 1e-12):.1f} times as large",
            float(fitted.sigma),
            unit,
        )


def check_direction(series: MotionSeries) -> Iterator[Finding]:
    """Whether the camera moves when odometry does, and the same way."""
    moving = series.moving
    if len(series) < MIN_STEPS or moving.sum() < MIN_STEPS:
        return
    camera, odometry = series.translation[moving], series.odometry[moving, 0]
    still = 100 * float(np.mean(np.linalg.norm(camera, axis=1) < STANDSTILL * np.abs(odometry)))
    same_sign = float(np.mean(np.sign(camera[:, 0]) == np.sign(odometry)))
    if still > 100 * MAX_SLIP:
        yield Finding(
            "warning",
            "standstill",
            f"the images stand still in {still:.0f} % of the steps in which odometry moves",
            "Check whether the camera is frozen, the wheels slip, or the frames are of another "
            "time",
            still,
            "%",
        )
    elif same_sign < 0.25:
        yield Finding(
            "error",
            "translation sign",
            f"the images move opposite to odometry in {100 * (1 - same_sign):.0f} % of the steps",
            "Check whether the camera looks back (camera.rotation), whether the frames are in "
            "reverse, and the sign of the translation",
            same_sign,
            "fraction",
        )


def check_translations(series: MotionSeries) -> Iterator[Finding]:
    """Noise and scale of the translation ahead, where the images measure it."""
    moving = series.moving
    if len(series) < MIN_STEPS or moving.sum() < MIN_STEPS or not series.metric:
        return
    yield from _check_noise(series, series.translation[:, 0], 0, "translation", "m")
    fitted = fit(series.translation[moving, :1], series.odometry[moving, 0])
    if fitted is not None and fitted.differs(0, 1.0, MAX_SCALE_ERROR):
        advice = (
            "Check the baseline or the unit of depth, the focal length, and the diameter of the "
            "wheels"
        )
        yield _scale_finding("translation", "moves", fitted, advice)


def check_jumps(drive: Drive) -> Iterator[Finding]:
    """Steps in which odometry is much faster than just before and after."""
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
        yield Finding.in_frames(
            "error",
            "odometry jump",
            f"odometry jumps in {counted(int(jumps.sum()), 'step', 'steps')}, the longest of "
            f"{longest:.2f} m",
            "Leave these steps out, or give them large covariances",
            np.flatnonzero(jumps) + 1,
            "steps",
        )
