"""Odometry against the motion of the images."""

import numpy as np

from saccade.diagnostics.findings import Finding, counted, numbers_of
from saccade.diagnostics.motion_series import Lag, Series
from saccade.diagnostics.robust_line import Fit, fit
from saccade.frames import Drive

TURNING = 0.01
"""Radians per second; a robot whose turns have less than this as their standard deviation goes
straight."""
ALIKE = 0.3
"""Correlation of turns from which two drives may be the same."""
SCALE = 0.1
"""Share by which odometry may be too long."""
DRIFT = np.deg2rad(2.0)
"""Radians per second by which a gyroscope may be off."""
STANDS = 0.1
"""Share of the way of odometry, below which the images stand still."""
SLIPS = 0.25
"""Share of the steps in which they may."""
JUMP = 10.0
"""Times the usual change of speed from step to step, above which it is a jump."""


def check_turns(series: Series, lag: Lag | None) -> list[Finding]:
    """Sign, scale, bias and noise of the turns, and the clock they are told by."""
    if lag is None or len(series) < 20:
        return []
    if np.std(series.rotation[:, 2] / series.duration) < TURNING:
        return []
    if lag.agreement < -ALIKE:
        return [
            Finding(
                "error",
                "turn sign",
                f"odometry turns the other way than the images: their turns agree by "
                f"{lag.agreement:.2f} on a scale from -1 to 1",
                "Turns are positive to the left; change the sign of the turn, or look whether "
                "the images are mirrored",
                lag.agreement,
                "correlation",
            )
        ]
    if lag.agreement < ALIKE:
        return [
            Finding(
                "error",
                "turn",
                f"the turns of odometry and of the images have nothing in common: they agree by "
                f"{lag.agreement:.2f} on a scale from -1 to 1",
                "Look whether both are of the same drive, and at camera.rotation",
                lag.agreement,
                "correlation",
            )
        ]
    return (
        _check_lag(series, lag)
        or _check_turn_scale(series)
        or [*_check_drift(series), *_check_noise(series, 2, "turn", "rad")]
    )


def _check_lag(series: Series, lag: Lag) -> list[Finding]:
    better = (1 - lag.agreement_now**2) > 1.2 * (1 - lag.agreement**2)
    if lag.frames == 0 or not better:
        return []
    seconds = lag.frames * float(np.median(series.duration))
    frames = counted(abs(lag.frames), "frame", "frames")
    early = "later" if seconds > 0 else "earlier"
    mend = "Subtract so much from" if seconds > 0 else "Add so much to"
    return [
        Finding(
            "warning",
            "clock lag",
            f"odometry's clock is {abs(seconds):.2f} s ({frames}) {early} than the images': their "
            f"turns agree by {lag.agreement:.3f} then, by {lag.agreement_now:.3f} as they are",
            f"{mend} the times of odometry",
            seconds,
            "s",
        )
    ]


def _check_turn_scale(series: Series) -> list[Finding]:
    found = _turns_fitted(series)
    if found is None or not found.differs(0, 1.0, SCALE):
        return []
    scale = float(found.value[0])
    advice = "Look at the unit of the turn, the wheel base, and the focal length"
    if abs(np.log(abs(scale) / np.rad2deg(1.0))) < 0.1:
        advice = "It is in degrees: a turn is in radians"
    return [
        Finding(
            "warning",
            "turn scale",
            f"odometry turns {scale:.2f} times as far as the images "
            f"(within {2 * found.error[0]:.2f})",
            advice,
            scale,
            "times",
        )
    ]


def _check_drift(series: Series) -> list[Finding]:
    found = _turns_fitted(series)
    if found is None or abs(found.value[1]) < 4 * found.error[1]:
        return []
    drift = float(np.rad2deg(found.value[1]))
    side = "left" if drift > 0 else "right"
    return [
        Finding(
            "warning" if abs(found.value[1]) > DRIFT else "note",
            "turn drift",
            f"odometry turns {abs(drift):.2f} deg/s to the {side} of what the images say, all "
            "the time",
            "A gyroscope's bias does so; take it out if it is known",
            drift,
            "deg/s",
        )
    ]


def _turns_fitted(series: Series) -> Fit | None:
    """Turns of odometry as so many times those of the images, and so much in a second."""
    A = np.stack([series.rotation[:, 2], series.duration], 1)
    return fit(A, series.odometry[:, 2])


def check_translations(series: Series) -> list[Finding]:
    """Sign, scale and noise of the way ahead."""
    moving = series.moving
    if len(series) < 20 or moving.sum() < 20:
        return []
    seen, told = series.translation[moving, 0], series.odometry[moving, 0]
    still = float(
        np.mean(np.linalg.norm(series.translation[moving], axis=1) < STANDS * np.abs(told))
    )
    if still > SLIPS:
        return [
            Finding(
                "warning",
                "standing",
                f"the images stand still in {100 * still:.0f} % of the steps in which odometry "
                "goes on",
                "Look whether the camera is frozen, the wheels slip, or the frames are of another "
                "time",
                100 * still,
                "%",
            )
        ]
    same = float(np.mean(np.sign(seen) == np.sign(told)))
    if same < 0.25:
        return [
            Finding(
                "error",
                "way sign",
                f"the images move backwards in {100 * (1 - same):.0f} % of the steps in which "
                "odometry says ahead, or the other way round",
                "Look whether the camera looks back (camera.rotation), whether the frames are in "
                "reverse, and at the sign of the way",
                same,
                "share",
            )
        ]
    if not series.metric:
        return []
    found = fit(seen[:, None], told)
    findings = _check_noise(series, 0, "way ahead", "m")
    if found is not None and found.differs(0, 1.0, SCALE):
        findings.append(
            Finding(
                "warning",
                "way scale",
                f"odometry goes {found.value[0]:.2f} times as far as the images "
                f"(within {2 * found.error[0]:.2f})",
                "Look at the baseline or the unit of depth, at the focal length, and at the "
                "diameter of the wheels",
                float(found.value[0]),
                "times",
            )
        )
    return findings


def _check_noise(series: Series, column: int, name: str, unit: str) -> list[Finding]:
    """Whether the covariances of odometry are those of its errors."""
    seen = series.rotation[:, 2] if column == 2 else series.translation[:, 0]
    found = fit(np.stack([seen, series.duration], 1), series.odometry[:, column])
    told = np.sqrt(np.median(series.covariance[:, column, column]))
    if found is None or not found.sigma > 2 * told:
        return []
    return [
        Finding(
            "warning",
            f"{name} noise",
            f"odometry's {name} is off by {found.sigma:.2g} {unit} in a step (one standard "
            f"deviation against the images), its covariance says {told:.2g} {unit}",
            f"Make the standard deviations {found.sigma / max(told, 1e-12):.1f} times as large",
            float(found.sigma),
            unit,
        )
    ]


def check_jumps(drive: Drive) -> list[Finding]:
    """Steps in which odometry goes much faster than just before and after."""
    duration = np.diff(drive.time)
    if len(duration) < 20:
        return []
    speed = np.hypot(*drive.control[:, :2].T) / np.maximum(duration, 1e-6)
    rate = np.abs(drive.control[:, 2]) / np.maximum(duration, 1e-6)
    jumps = np.zeros(len(duration), bool)
    for values, least in ((speed, 2.0), (rate, 1.0)):
        padded = np.pad(values, 2, mode="reflect")
        around = np.stack([padded[k : k + len(values)] for k in (0, 1, 3, 4)])
        excess = values - np.median(around, 0)
        usual = 1.4826 * np.median(np.abs(excess))
        jumps |= excess > np.maximum(JUMP * usual, least)
    frames = np.flatnonzero(jumps) + 1
    if len(frames) == 0:
        return []
    longest = float(np.hypot(*drive.control[jumps, :2].T).max())
    return [
        Finding(
            "error",
            "odometry jump",
            f"odometry jumps in {counted(len(frames), 'step', 'steps')}, the longest of "
            f"{longest:.2f} m",
            "Leave these steps out, or give them large covariances",
            float(len(frames)),
            "steps",
            numbers_of(frames),
        )
    ]
