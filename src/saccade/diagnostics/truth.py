"""Checks of ground truth against the images and against odometry."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from saccade.diagnostics.findings import Finding
from saccade.diagnostics.motion_series import MIN_STEPS, Fit, Lag, fit, lag_of, series_of
from saccade.diagnostics.odometry import MAX_SCALE_ERROR, MIN_CORRELATION, MIN_TURN_RATE
from saccade.diagnostics.survey import Survey
from saccade.frames import Drive, steps_between
from saccade.types import FloatArray

MAX_LENGTH_ERROR = 0.05
"""Relative difference allowed between the lengths of the images and of the truth."""
SEGMENT_SECONDS = 1.0
"""Seconds over which lengths and turns of odometry are compared with those of the truth."""
MIN_SEGMENT_LENGTH = 0.1
"""Metres of a segment from which its length is compared."""


def check_truth(drive: Drive, survey: Survey, agree: bool) -> Iterator[Finding]:
    """Lengths, turns and clock of the truth, by the images and by odometry.

    Where images and odometry do not `agree`, only the lengths of the images, which tell whose
    fault it is: the rest would follow.
    """
    known = _covered(drive)
    if known is None:
        return
    yield from _check_images(*known, survey, agree)
    if agree:
        yield from _check_odometry(known[0])


def _covered(drive: Drive) -> tuple[Drive, int] | None:
    """The frames within the times of the truth, and the number of the first."""
    if drive.truth is None:
        return None
    period = float(np.median(np.diff(drive.truth.time))) if len(drive.truth.time) > 1 else 0.0
    begin, end = drive.truth.time[0] - period, drive.truth.time[-1] + period
    inside = np.flatnonzero((drive.time >= begin) & (drive.time <= end))
    if len(inside) <= MIN_STEPS:
        return None
    first, last = int(inside[0]), int(inside[-1])
    covered = replace(
        drive,
        time=drive.time[first : last + 1],
        control=drive.control[first:last],
        control_covariance=drive.control_covariance[first:last],
    )
    return covered, first


def _check_images(
    drive: Drive, first: int, survey: Survey, compare_turns: bool
) -> Iterator[Finding]:
    """Turns, clock and lengths of the truth against the images."""
    assert drive.truth is not None
    steps = steps_between(drive.truth.at(drive.time))
    inside = (survey.frame >= first) & (survey.frame < first + len(drive))
    surveyed = replace(survey, **{n: getattr(survey, n)[inside] for n in _PER_FRAME})
    surveyed = replace(surveyed, frame=surveyed.frame - first)
    by_truth = replace(drive, control=steps)
    series, lag = series_of(by_truth, surveyed), lag_of(by_truth, surveyed)
    turning = np.std(series.rotation[:, 2] / series.duration) if len(series) else 0.0
    if len(series) < MIN_STEPS:
        return
    if compare_turns and lag is not None and turning >= MIN_TURN_RATE:
        wrong = list(_check_turns(lag, float(np.median(series.duration))))
        if wrong:
            yield from wrong
            return
    moving = series.moving
    if not series.metric.any() or len(moving) < MIN_STEPS:
        return
    fitted = fit(moving.odometry[:, :1], moving.translation[:, 0])  # sideways, turns move it
    if fitted is not None and fitted.differs(0, 1.0, MAX_LENGTH_ERROR):
        what = f"the images move {_times(fitted)} as far as the truth"
        advice = (
            "Check the baseline or the unit of depth, the focal length, camera.rotation, and the "
            "scale of the truth"
        )
        yield Finding("warning", "truth length", what, advice, float(fitted.value[0]), "times")


_PER_FRAME = (
    *("frame", "brightness", "contrast", "sharpness", "points", "copied"),
    *("rotation", "translation", "metric"),
)
"""Columns of a survey with a row for each frame."""


def _check_turns(lag: Lag, period: float) -> Iterator[Finding]:
    if lag.correlation < MIN_CORRELATION:
        what = f"the turns of the truth and of the images correlate by {lag.correlation:.2f}"
        advice = "Check the axes of the truth, camera.rotation, and whether both are of one drive"
        yield Finding("error", "truth turns", what, advice, lag.correlation, "correlation")
    elif lag.frames != 0 and (1 - lag.correlation_without**2) > 1.2 * (1 - lag.correlation**2):
        seconds = lag.frames * period
        side, advice = ("late", "Subtract") if seconds > 0 else ("early", "Add")
        what = (
            f"the truth's clock is {abs(seconds):.2f} s {side}: shifted, its turns correlate with "
            f"those of the images by {lag.correlation:.3f}, unshifted by "
            f"{lag.correlation_without:.3f}"
        )
        advice += " this from" if seconds > 0 else " this to"
        advice += " the times of the truth"
        yield Finding("warning", "truth clock", what, advice, seconds, "s")


def _check_odometry(drive: Drive) -> Iterator[Finding]:
    """Lengths and turns of odometry against those of the truth, over segments."""
    if not drive.control.any():
        return
    odometry, truth = _segments(drive)
    moving = np.hypot(*truth[:, :2].T) > MIN_SEGMENT_LENGTH
    lengths = fit(np.hypot(*truth[moving, :2].T)[:, None], np.hypot(*odometry[moving, :2].T))
    if lengths is not None and lengths.differs(0, 1.0, MAX_SCALE_ERROR):
        what = f"odometry moves {_times(lengths)} as far as the truth"
        advice = "Check the diameter of the wheels, and the unit and the scale of the truth"
        value = float(lengths.value[0])
        yield Finding("warning", "truth odometry length", what, advice, value, "times")
    turns = fit(np.stack([truth[:, 2], np.ones(len(truth))], 1), odometry[:, 2])
    if np.std(truth[:, 2]) / SEGMENT_SECONDS < MIN_TURN_RATE or turns is None:
        return
    if turns.differs(0, 1.0, MAX_SCALE_ERROR):
        what = f"odometry turns {_times(turns)} as far as the truth"
        advice = "Check the unit and the sign of the turn, the clocks, and the axes of the truth"
        value = float(turns.value[0])
        yield Finding("warning", "truth odometry turn", what, advice, value, "times")


def _times(fitted: Fit) -> str:
    return f"{fitted.value[0]:.2f} times (within {2 * fitted.error[0]:.2f})"


def _segments(drive: Drive) -> tuple[FloatArray, FloatArray]:
    """(m, 3) motions over segments of the drive, by odometry and by the truth."""
    assert drive.truth is not None
    heading = np.append(0.0, np.cumsum(drive.control[:, 2]))
    steps = np.exp(1j * heading[:-1]) * (drive.control[:, 0] + 1j * drive.control[:, 1])
    position = np.append(0.0, np.cumsum(steps))
    pose = np.stack([position.real, position.imag, heading], 1)
    marks = np.arange(drive.time[0], drive.time[-1], SEGMENT_SECONDS)
    index = np.unique(np.searchsorted(drive.time, marks))
    truth = drive.truth.at(drive.time[index])
    return steps_between(pose[index]), steps_between(truth)
