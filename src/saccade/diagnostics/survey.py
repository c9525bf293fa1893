"""Survey of a drive: image statistics and camera motion of its frames."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np

from saccade.diagnostics.camera_motion import FramePoints, match_points, motion_between, points_of
from saccade.errors import ImageError
from saccade.frames import Drive, Frame, Tracks
from saccade.types import BoolArray, FloatArray, Image, IntArray
from saccade.visual.camera import reduced_camera
from saccade.visual.optical_flow import ByteArray, PreparedFrame, gray_bytes, reduced_image

STRETCHES = 4
"""Sequences of successive frames, evenly spread, that are surveyed of a longer drive."""
MAX_WIDTH = 800
"""Pixels; wider images are shrunk first."""
MAX_EQUAL, MIN_COMMON_TRACKS = 0.5, 5
"""Fraction of the tracks common to two frames that may be equal to the bit, and the number of
common tracks from which the frame is a copy otherwise."""


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
    """(m, 3) rotation vector of the camera since the frame before, in radians about the robot's
    axes ahead, left and up: roll, pitch (nose down) and yaw; NaN where unknown."""
    translation: FloatArray
    """(m, 3) ahead, left and up; NaN where unknown."""
    metric: BoolArray
    """(m,) whether the translation is in metres; else it has length 1, or 0 at a standstill."""
    unreadable: dict[int, str]
    """Error messages by number of the frame."""
    disparity: FloatArray
    """(d,) of all points that have one, in pixels of the full image."""
    row_offset: FloatArray
    """(d,) row in the right image less that in the left one in pixels; NaN where unknown."""

    def __len__(self) -> int:
        return len(self.frame)


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
    factor = -(-drive.camera.width // MAX_WIDTH)
    if _has_tracks(drive, numbers):
        numbers, factor = list(range(len(drive))), 1
    camera = reduced_camera(drive.camera, factor)
    m, unreadable = len(numbers), dict[int, str]()
    brightness, contrast, sharpness = np.full((3, m), np.nan)
    rotation, translation = np.full((2, m, 3), np.nan)
    counts, copied, metric = np.zeros(m, np.int64), np.zeros(m, np.bool_), np.zeros(m, np.bool_)
    all_points = [FramePoints()]
    previous: PreparedFrame | None = None
    for i, number in enumerate(numbers):
        if i > 0 and numbers[i - 1] != number - 1:
            previous = None
        try:
            current = _shrink_frame(drive.load(number), factor)
        except ImageError as error:
            unreadable[number], previous = str(error), None
        else:
            points = points_of(current, camera)
            counts[i] = len(points)
            if (gray := current.left) is not None:
                brightness[i], contrast[i] = gray.mean(), gray.std()
                laplacian = float(np.abs(cv2.Laplacian(gray, cv2.CV_16S)).mean())
                sharpness[i] = laplacian / max(contrast[i], 1.0)
            if previous is not None:
                copied[i] = _is_copy(previous, current)
                pairs = match_points(all_points[-1], (previous, current), points)
                motion = motion_between(*pairs, camera)
                if motion is not None:
                    rotation[i], translation[i], metric[i] = motion
            all_points.append(points)
            previous = current
        if progress is not None:
            progress(i + 1, m)
    every = FramePoints.concatenate(all_points)
    every = every[np.isfinite(every.disparity)]
    return Survey(
        *(np.array(numbers), brightness, contrast, sharpness, counts, copied),
        *(rotation, translation, metric, unreadable),
        *(every.disparity * factor, every.row_offset * factor),
    )


def chosen_frames(n: int, max_images: int) -> list[int]:
    """All of n frames, or evenly spread sequences of `max_images` frames together."""
    if n <= max_images:
        return list(range(n))
    size = max_images // STRETCHES
    starts = np.linspace(0, n - size, STRETCHES).astype(int).tolist()
    return sorted({i for start in starts for i in range(start, start + size)})


def _has_tracks(drive: Drive, numbers: list[int]) -> bool:
    """Whether the first frame that can be read has tracks."""
    for number in numbers:
        with suppress(ImageError):
            return drive.load(number).tracks is not None
    return False


def _shrink_frame(frame: Frame, factor: int) -> PreparedFrame:
    left, right = (_shrink_image(image, factor) for image in (frame.image, frame.right))
    depth = None if frame.depth is None else frame.depth[::factor, ::factor]
    return PreparedFrame(replace(frame, depth=depth), left, right)


def _shrink_image(image: Image | None, factor: int) -> ByteArray | None:
    if image is None:
        return None
    gray = gray_bytes(image)
    return gray if factor == 1 else np.asarray(reduced_image(gray, factor), np.uint8)


def _is_copy(previous: PreparedFrame, current: PreparedFrame) -> bool:
    """Whether most tracks, or the images, are equal to the bit."""
    before, now = previous.frame.tracks, current.frame.tracks
    if before is not None and now is not None:
        return repeated_observations(before, now) is not None
    if previous.left is None or current.left is None:
        return False
    return bool(current.left.std() > 0 and np.array_equal(previous.left, current.left))


def repeated_observations(before: Tracks, now: Tracks) -> IntArray | None:
    """Indices in `now` of observations equal to those of the frame before to the bit.

    None unless most common tracks are equal: the frame is no copy.
    """
    _, i, j = np.intersect1d(before.id, now.id, return_indices=True)
    equal = (before.xy[i] == now.xy[j]).all(1)
    if len(i) < MIN_COMMON_TRACKS or equal.mean() <= MAX_EQUAL:
        return None
    return np.asarray(j[equal], np.int64)
