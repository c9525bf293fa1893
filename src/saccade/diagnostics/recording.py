"""Checks of the recording: images, repeated frames and timestamps."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache

import numpy as np

from saccade.diagnostics.findings import Finding, counted
from saccade.diagnostics.survey import MIN_POINTS, Survey, repeated_observations
from saccade.errors import ImageError
from saccade.frames import Drive, Frame, Tracks
from saccade.types import BoolArray, IntArray
from saccade.visual.optical_flow import MIN_CONTRAST


def drop_repeated(drive: Drive) -> Drive:
    """The drive without images and tracks that repeat the frame before while odometry moves.

    Odometry bridges the frames. Of tracks the repeated observations are removed, and every track
    begins anew, since it may continue at another point; this reads all frames. A repeated image
    raises `ImageError` when it is read, as an unreadable one does; without odometry it is kept.
    """
    first = Frame(float(drive.time[0]))
    with suppress(ImageError):
        first = drive.load(0)
    moves = np.append(False, drive.control.any(1) & (drive.scale == "metric"))
    if first.tracks is None:
        return replace(drive, load=_without_repeated_images(drive, moves))
    moves[1:] |= not drive.control.any()
    copies, last, stride = dict[int, IntArray](), Tracks(), 1
    for i in range(len(drive)):
        tracks = drive.load(i).tracks or Tracks()
        repeated = repeated_observations(last, tracks) if moves[i] else None
        if repeated is not None:
            copies[i] = repeated
        last, stride = tracks, max(stride, 1 + int(tracks.id.max(initial=0)))
    if not copies:
        return drive
    numbers = np.array(list(copies))

    def load(i: int) -> Frame:
        frame = drive.load(i)
        if frame.tracks is None:
            return frame
        rows = np.arange(len(frame.tracks))
        tracks = frame.tracks[np.delete(rows, copies[i]) if i in copies else rows]
        epoch = int(np.searchsorted(numbers, i, side="right"))
        return replace(frame, tracks=replace(tracks, id=tracks.id + epoch * stride))

    remark = (
        f"{counted(len(numbers), 'frame repeats', 'frames repeat')} the points of the frame "
        f"before, first number {numbers[0]}: the copies are dropped, tracks begin anew, and "
        "odometry bridges the step"
    )
    return replace(drive, load=load, remarks=(*drive.remarks, remark))


def _without_repeated_images(drive: Drive, moves: BoolArray) -> Callable[[int], Frame]:
    """Frames as `drive` loads them; raises `ImageError` for a repeated image.

    `moves` (n,) tells whether odometry moves since the frame before.
    """
    read = lru_cache(maxsize=2)(drive.load)  # with each image the one before is compared

    def load(i: int) -> Frame:
        before = None
        with suppress(ImageError):
            before = read(i - 1).image if moves[i] else None
        frame = read(i)
        image = frame.image
        if before is None or image is None or image.min() == image.max():
            return frame
        if np.array_equal(before, image):
            raise ImageError(
                f"frame {i}: its image repeats that of the frame before to the bit while odometry "
                "moves; odometry bridges it"
            )
        return frame

    return load


MIN_BRIGHTNESS = 8.0
"""Mean gray level (0 to 255) below which an image is black."""
MIN_SHARPNESS = 0.4
"""Fraction of the median sharpness below which a frame is blurred."""
MAX_BAD_FRACTION = 0.02
"""Fraction of the frames that may be blurred or have too few points."""
MIN_KNOWN_FRACTION, MIN_KNOWN_STEPS = 0.5, 20
"""Fraction of the steps whose motion must be found, and the steps from which it is judged."""
GAP_RATIO = 2.5
"""Frame period over the median one from which frames are missing."""
MAX_JITTER = 0.3
"""Standard deviation of the frame period, as a fraction of its median."""


def check_images(drive: Drive, survey: Survey) -> Iterator[Finding]:
    """Frames that are unreadable, black, blurred, without texture, or copies of others."""
    black = (survey.brightness < MIN_BRIGHTNESS) | (survey.contrast < MIN_CONTRAST)
    sharpness = survey.sharpness[np.isfinite(survey.sharpness) & ~black]
    median = float(np.median(sharpness)) if len(sharpness) else 0.0
    blurred = (survey.sharpness < MIN_SHARPNESS * median) & ~black
    empty = (survey.points < MIN_POINTS) & ~black & np.isfinite(survey.brightness)
    if unreadable := survey.unreadable:
        first = next(iter(unreadable.values()))
        what = f"{counted(len(unreadable), 'frame', 'frames')} cannot be read; {first}"
        advice = "Replace the files or the calibration, or leave the frames out"
        numbers = np.array(list(unreadable))
        yield Finding.in_frames("error", "unreadable frames", what, advice, numbers)
    if black.any():
        what = f"{counted(int(black.sum()), 'frame is', 'frames are')} black or uniformly gray"
        advice = "Look for a covered lens or a camera that dropped out; odometry alone bridges them"
        yield Finding.in_frames("warning", "black frames", what, advice, survey.frame[black])
    if blurred.sum() > MAX_BAD_FRACTION * len(survey):
        count = counted(int(blurred.sum()), "frame has", "frames have")
        what = f"{count} less than {MIN_SHARPNESS:g} of the median sharpness"
        advice = "Expose for a shorter time, or drive more slowly"
        yield Finding.in_frames("warning", "blurred frames", what, advice, survey.frame[blurred])
    if empty.sum() > MAX_BAD_FRACTION * len(survey):
        count = counted(int(empty.sum()), "frame has", "frames have")
        what = f"{count} fewer than {MIN_POINTS} points to track"
        advice = "Nothing is observed there; odometry alone bridges them"
        yield Finding.in_frames("warning", "empty frames", what, advice, survey.frame[empty])
    step = np.abs(drive.control[np.maximum(survey.frame - 1, 0)]).max(1)
    copied = survey.copied & ((step > 0) | (not drive.control.any()))
    if copied.any():
        count = counted(int(copied.sum()), "frame repeats", "frames repeat")
        content = "points" if np.isnan(survey.brightness).all() else "image"
        what = f"{count} the {content} of the frame before to the bit"
        advice = (
            "A step is lost in each, and tracks may continue at other points: remove the copies, "
            "start new tracks after them, and let odometry bridge the step"
        )
        yield Finding.in_frames("error", "repeated frames", what, advice, survey.frame[copied])


def check_egomotion(survey: Survey) -> Iterator[Finding]:
    """Whether the camera's motion can be estimated from the images."""
    successive = np.diff(survey.frame) == 1
    if successive.sum() < MIN_KNOWN_STEPS:
        return
    known = float(np.isfinite(survey.rotation[1:, 0])[successive].mean())
    if known <= MIN_KNOWN_FRACTION:
        what = (
            f"the images show the camera's motion in only {100 * known:.0f} % of the steps: "
            "there are too few points, or they do not move like a rigid scene"
        )
        advice = (
            "Check that the frames are of one drive and in order; check their rate, exposure and "
            "blur, and the focal length"
        )
        yield Finding("warning", "motion", what, advice, 100 * known, "%")


def check_timestamps(drive: Drive) -> Iterator[Finding]:
    """Gaps, jitter, and repairs made when the files were read."""
    for remark in drive.remarks:
        advice = "It was repaired on reading; check the recording for other errors"
        yield Finding("warning", "files", remark, advice, 1.0, "remark")
    for assumption in drive.assumptions:
        advice = "Give what is assumed, if it is known"
        yield Finding("note", "assumptions", assumption, advice, 1.0, "remark")
    period = np.diff(drive.time)
    if len(period) < 5:
        return
    median = float(np.median(period))
    gaps = np.flatnonzero(period > GAP_RATIO * median)
    if len(gaps):
        longest = float(period.max())
        what = (
            f"frames are missing: {counted(len(gaps), 'gap', 'gaps')}, the longest of "
            f"{longest:.2f} s, the median period is {median:.3f} s"
        )
        advice = "Odometry alone bridges them; look for a camera that dropped out"
        yield Finding("warning", "gaps", what, advice, longest, "s", tuple((gaps + 1).tolist()))
    jitter = 100 * float(period[period <= GAP_RATIO * median].std() / max(median, 1e-9))
    if jitter > 100 * MAX_JITTER:
        what = f"the time between frames varies by {jitter:.0f} % (one standard deviation)"
        advice = "Use the times of exposure rather than of arrival"
        yield Finding("warning", "uneven clock", what, advice, jitter, "%")
