"""Survey of a drive: image statistics and motion of its frames."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np

from saccade.diagnostics.camera_motion import CameraMotion, motion_between
from saccade.diagnostics.frame_points import (
    FramePoints,
    match_points,
    points_of,
    shrink_camera,
    shrink_factor,
    shrink_frame,
)
from saccade.errors import ImageError
from saccade.frames import Drive
from saccade.types import BoolArray, FloatArray, IntArray
from saccade.visual.optical_flow import PreparedFrame

STRETCHES = 4
"""Stretches, evenly spread, that are surveyed of a drive that has too many frames."""
MAX_EQUAL = 0.5
"""Fraction of the tracks of two frames that may be equal to the bit."""
MIN_COMMON_TRACKS = 5
"""Tracks common to two frames from which they may be copies."""


@dataclass(frozen=True, eq=False)
class Survey:
    """Statistics of m frames."""

    frame: IntArray
    """(m,) their numbers, ascending."""
    brightness: FloatArray
    """(m,) mean gray level of 255; NaN without an image."""
    contrast: FloatArray
    """(m,) standard deviation of the gray levels; NaN without an image."""
    sharpness: FloatArray
    """(m,) mean absolute Laplacian over the contrast; NaN without an image."""
    points: IntArray
    """(m,) number of points."""
    copied: BoolArray
    """(m,) whether the frame is an exact copy of the one before."""
    rotation: FloatArray
    """(m, 3) of the `CameraMotion` from the frame before; NaN where unknown."""
    translation: FloatArray
    """(m, 3) of the `CameraMotion`; NaN where unknown."""
    metric: BoolArray
    """(m,) whether the translation is in metres."""
    unreadable: dict[int, str]
    """Error messages by number of the frame."""
    disparity: FloatArray
    """(d,) of all points that have one, in pixels of the full image."""
    row_offset: FloatArray
    """(d,) pixels by which the right image has them lower; NaN where unknown."""

    def __len__(self) -> int:
        return len(self.frame)


class _FrameRow(NamedTuple):
    """Statistics of a frame; those of an unreadable one unless given."""

    frame: int
    brightness: float = np.nan
    contrast: float = np.nan
    sharpness: float = np.nan
    points: int = 0
    copied: bool = False
    rotation: FloatArray = np.full(3, np.nan)
    translation: FloatArray = np.full(3, np.nan)
    metric: bool = False


def survey_drive(
    drive: Drive, max_images: int, progress: Callable[[int, int], None] | None = None
) -> Survey:
    """Survey the frames of a drive.

    Args:
        drive: to be surveyed.
        max_images: images, at most; tracks are surveyed whatever their number.
        progress: called with the number of frames done, and of all.
    """
    numbers = chosen_frames(len(drive), max_images)
    factor = shrink_factor(drive.camera)
    if _has_tracks(drive, numbers):
        numbers, factor = list(range(len(drive))), 1
    camera = shrink_camera(drive.camera, factor)
    rows: list[_FrameRow] = []
    unreadable: dict[int, str] = {}
    points, previous_points = FramePoints(), FramePoints()
    all_points = [points]
    previous: PreparedFrame | None = None
    for done, number in enumerate(numbers, 1):
        if done > 1 and numbers[done - 2] != number - 1:
            previous = None
        try:
            prepared = shrink_frame(drive.load(number), factor)
        except ImageError as error:
            unreadable[number] = str(error)
            previous = None
            rows.append(_FrameRow(number))
        else:
            points = points_of(prepared, camera)
            motion, copied = None, False
            if previous is not None:
                pairs = match_points(previous_points, (previous, prepared), points)
                motion = motion_between(*pairs, camera)
                copied = _is_copy(previous, prepared)
            rows.append(_row(number, prepared, len(points), copied, motion))
            all_points.append(points)
            previous, previous_points = prepared, points
        if progress is not None:
            progress(done, len(numbers))
    every = FramePoints.concatenate(all_points)
    known = np.isfinite(every.disparity)
    columns: list[Any] = [np.array(column) for column in zip(*rows, strict=True)]
    columns += [unreadable, every.disparity[known] * factor, every.row_offset[known] * factor]
    return Survey(*columns)


def chosen_frames(n: int, max_images: int) -> list[int]:
    """All of n frames, or stretches that are `max_images` together."""
    if n <= max_images:
        return list(range(n))
    size = max_images // STRETCHES
    starts = np.linspace(0, n - size, STRETCHES).astype(int).tolist()
    return sorted({i for start in starts for i in range(start, start + size)})


def _has_tracks(drive: Drive, numbers: list[int]) -> bool:
    """Whether the first frame that can be read has tracks."""
    for number in numbers:
        try:
            return drive.load(number).tracks is not None
        except ImageError:
            continue
    return False


def _row(
    number: int, prepared: PreparedFrame, points: int, copied: bool, motion: CameraMotion | None
) -> _FrameRow:
    row = _FrameRow(number, points=points, copied=copied)
    if motion is not None:
        row = row._replace(
            rotation=motion.rotation, translation=motion.translation, metric=motion.metric
        )
    if prepared.left is None:
        return row
    contrast = float(prepared.left.std())
    laplacian = float(np.abs(cv2.Laplacian(prepared.left, cv2.CV_16S)).mean())
    return row._replace(
        brightness=float(prepared.left.mean()),
        contrast=contrast,
        sharpness=laplacian / max(contrast, 1.0),
    )


def _is_copy(previous: PreparedFrame, current: PreparedFrame) -> bool:
    """Whether most tracks, or the images, are equal to the bit."""
    before, now = previous.frame.tracks, current.frame.tracks
    if before is not None and now is not None:
        _, i, j = np.intersect1d(before.id, now.id, return_indices=True)
        equal = (before.xy[i] == now.xy[j]).all(1)
        return len(i) >= MIN_COMMON_TRACKS and bool(equal.mean() > MAX_EQUAL)
    if previous.left is None or current.left is None:
        return False
    return bool(current.left.std() > 0 and np.array_equal(previous.left, current.left))
