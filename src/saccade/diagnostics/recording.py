"""Checks of the recording: images, repeated frames and timestamps."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache

import numpy as np

from saccade.diagnostics.findings import Finding, counted
from saccade.diagnostics.survey import MIN_MOTION_POINTS, Survey, repeated_observations
from saccade.errors import ImageError
from saccade.frames import Drive, Frame, Tracks
from saccade.types import BoolArray, IntArray
from saccade.visual.optical_flow import MIN_CONTRAST


def drop_repeated(drive: Drive) -> Drive:
    """The drive without repeated images and tracks, while odometry moves.

    Odometry bridges the frames. Repeated observations of tracks are removed, and every track
    restarts, since it may continue at another point; this reads all frames. A repeated image
    raises `ImageError` when read, like an unreadable image; without odometry it is kept.
    """
    first = Frame(float(drive.time[0]))
    with suppress(ImageError):
        first = drive.load(0)
    moves = np.append(False, drive.control.any(1) & drive.has_odometry)
    if first.tracks is None:
        return replace(drive, load=_without_repeated_images(drive, moves))
    moves[1:] |= not drive.has_odometry
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
        f"{counted(len(numbers), 'frame repeats', 'frames repeat')} the points of the previous "
        f"frame, first number {numbers[0]}: the copies are dropped, tracks restart, and odometry "
        "bridges the step"
    )
    return replace(drive, load=load, remarks=(*drive.remarks, remark))


def _without_repeated_images(drive: Drive, moves: BoolArray) -> Callable[[int], Frame]:
    """Loader of frames that raises `ImageError` for a repeated image.

    `moves` (n,) is True for frames with odometry motion since the previous frame.
    """
    read = lru_cache(maxsize=2)(drive.load)  # each image is compared with the previous image

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
                f"frame {i}: an exact copy of the previous image while odometry moves; "
                "odometry bridges it"
            )
        return frame

    return load


MIN_BRIGHTNESS = 8.0
"""Maximum mean gray level (0 to 255) of a black image."""
MIN_SHARPNESS = 0.4
"""Minimum sharpness of a frame, as a fraction of the median."""
MAX_BAD_FRACTION = 0.02
"""Maximum fraction of frames that are blurred or have too few points."""
MIN_KNOWN_FRACTION = 0.5
"""Minimum fraction of steps with a motion estimate."""
MIN_KNOWN_STEPS = 20
"""Minimum number of steps for a check of that fraction."""
GAP_RATIO = 2.5
"""Minimum ratio of a frame period to the median period for missing frames."""
MAX_JITTER = 0.3
"""Maximum standard deviation of the frame period, as a fraction of its median."""


def check_images(drive: Drive, survey: Survey) -> Iterator[Finding]:
    """Checks for frames that are unreadable, black, blurred, without texture, or copies."""
    black = (survey.brightness < MIN_BRIGHTNESS) | (survey.contrast < MIN_CONTRAST)
    sharpness = survey.sharpness[np.isfinite(survey.sharpness) & ~black]
    median = float(np.median(sharpness)) if len(sharpness) else 0.0
    blurred = (survey.sharpness < MIN_SHARPNESS * median) & ~black
    empty = (survey.points < MIN_MOTION_POINTS) & ~black & np.isfinite(survey.brightness)
    if unreadable := survey.unreadable:
        first = next(iter(unreadable.values()))
        what = f"{counted(len(unreadable), 'frame', 'frames')} cannot be read; {first}"
        numbers = np.array(list(unreadable))
        yield Finding.in_frames("unreadable frames", what, numbers)
    if black.any():
        what = f"{counted(int(black.sum()), 'frame is', 'frames are')} black or uniformly gray"
        yield Finding.in_frames("black frames", what, survey.frame[black])
    if blurred.sum() > MAX_BAD_FRACTION * len(survey):
        count = counted(int(blurred.sum()), "frame has", "frames have")
        what = f"{count} less than {MIN_SHARPNESS:g} of the median sharpness"
        yield Finding.in_frames("blurred frames", what, survey.frame[blurred])
    if empty.sum() > MAX_BAD_FRACTION * len(survey):
        count = counted(int(empty.sum()), "frame has", "frames have")
        what = f"{count} fewer than {MIN_MOTION_POINTS} points to track"
        yield Finding.in_frames("empty frames", what, survey.frame[empty])
    step = np.abs(drive.control[np.maximum(survey.frame - 1, 0)]).max(1)
    copied = survey.copied & ((step > 0) | (not drive.has_odometry))
    if copied.any():
        count = counted(int(copied.sum()), "frame repeats", "frames repeat")
        content = "points" if np.isnan(survey.brightness).all() else "image"
        what = f"{count} the {content} of the previous frame exactly"
        yield Finding.in_frames("repeated frames", what, survey.frame[copied])


def check_egomotion(survey: Survey) -> Iterator[Finding]:
    """Checks that the camera's motion can be estimated from the images."""
    successive = np.diff(survey.frame) == 1
    if successive.sum() < MIN_KNOWN_STEPS:
        return
    known = float(np.isfinite(survey.rotation[1:, 0])[successive].mean())
    if known <= MIN_KNOWN_FRACTION:
        what = (
            f"the images determine the camera's motion in only {100 * known:.0f} % of the steps: "
            "there are too few points, or they do not move like a rigid scene"
        )
        yield Finding.of("motion", what, 100 * known)


def check_timestamps(drive: Drive) -> Iterator[Finding]:
    """Checks for gaps, jitter, and repairs made when the files were read."""
    for remark in drive.remarks:
        yield Finding.of("files", remark, 1.0)
    for assumption in drive.assumptions:
        yield Finding.of("assumptions", assumption, 1.0)
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
        yield Finding.of("gaps", what, longest, frames=tuple((gaps + 1).tolist()))
    jitter = 100 * float(period[period <= GAP_RATIO * median].std() / max(median, 1e-9))
    if jitter > 100 * MAX_JITTER:
        what = f"the time between frames varies by {jitter:.0f} % (one standard deviation)"
        yield Finding.of("uneven clock", what, jitter)
