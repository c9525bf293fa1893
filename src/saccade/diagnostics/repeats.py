"""Repair of drives with repeated frames."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from saccade.diagnostics.findings import counted
from saccade.diagnostics.survey import repeated_observations
from saccade.errors import ImageError
from saccade.frames import Drive, Frame, Tracks
from saccade.types import BoolArray, Image, IntArray


def drop_repeated(drive: Drive) -> Drive:
    """The drive without images and tracks that repeat the frame before while odometry moves.

    Odometry bridges the frames. Of tracks the repeated observations are removed, and every track
    begins anew, since it may continue at another point; this reads all frames. A repeated image
    raises `ImageError` when it is read, as an unreadable one does; without odometry it is kept.
    """
    try:
        first = drive.load(0)
    except ImageError:
        first = Frame(float(drive.time[0]))
    moves = drive.control.any(1) & (drive.scale == "metric")
    if first.tracks is None:
        return replace(drive, load=_without_repeated_images(drive, np.append(False, moves), first))
    moves = np.asarray(moves | (not drive.control.any()))
    numbers, last = list[int](), _tracks(drive, 0)
    for i in range(1, len(drive)):
        tracks = _tracks(drive, i)
        if moves[i - 1] and repeated_observations(last, tracks) is not None:
            numbers.append(i)
        last = tracks
    if not numbers:
        return drive
    remark = (
        f"{counted(len(numbers), 'frame repeats', 'frames repeat')} the points of the frame "
        f"before, first number {numbers[0]}: the copies are dropped, tracks begin anew, and "
        "odometry bridges the step"
    )
    load = _restarted_tracks(drive, np.array(numbers))
    return replace(drive, load=load, remarks=(*drive.remarks, remark))


def _restarted_tracks(drive: Drive, numbers: IntArray) -> Callable[[int], Frame]:
    """Frames without repeated observations, whose tracks have other ids after each repetition."""
    stride = 1 + max(int(_tracks(drive, i).id.max(initial=0)) for i in range(len(drive)))

    def load(i: int) -> Frame:
        frame = drive.load(i)
        if frame.tracks is None:
            return frame
        tracks, keep = frame.tracks, np.ones(len(frame.tracks), np.bool_)
        if i in numbers:
            repeated = repeated_observations(_tracks(drive, i - 1), tracks)
            if repeated is not None:
                keep[repeated] = False
        epoch = int(np.searchsorted(numbers, i, side="right"))
        tracks = tracks[keep]
        return replace(frame, tracks=replace(tracks, id=tracks.id + epoch * stride))

    return load


def _tracks(drive: Drive, number: int) -> Tracks:
    """The tracks of a frame; none where it has none."""
    tracks = drive.load(number).tracks
    return (
        Tracks(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0)) if tracks is None else tracks
    )


def _without_repeated_images(
    drive: Drive, moves: BoolArray, first: Frame
) -> Callable[[int], Frame]:
    """Frames as `Drive.load`, of which the last is kept; raises `ImageError` for a repeated image.

    `moves` (n,) tells whether odometry moves since the frame before.
    """
    kept = (0, first)

    def read(i: int) -> Frame:
        nonlocal kept
        number, frame = kept
        if number != i or frame.image is None:
            frame = drive.load(i)
            kept = i, frame
        return frame

    def previous_image(i: int) -> Image | None:
        try:
            return read(i - 1).image
        except ImageError:
            return None

    def load(i: int) -> Frame:
        before = previous_image(i) if moves[i] else None
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
