"""Which part of an image moves with the world, where images and odometry contradict each other.

A vehicle ahead or an object that passes may have most of the points of an image. Their motion is
then the one with most inliers, but it contradicts odometry, and explains only a part of the image.
"""

from enum import IntEnum

import numpy as np

from saccade.frames import Camera
from saccade.slam.consistency import normalized_squared
from saccade.types import BoolArray, FloatArray
from saccade.visual.egomotion import Correspondences, Egomotion, MotionEstimate, estimate_motion

MAX_MOTION_NIS = 25.0
"""Maximum normalized squared difference of a motion and its expectation (3 degrees of freedom)."""
RELATIVE_SIGMA = 0.02
"""Relative standard deviation of motions by calibration, which their covariances lack."""
LEAST_SIGMA = 0.002
"""Least standard deviation of motions by calibration, in meters and radians."""
GRID = (8, 6)
"""Columns and rows of the cells by which a part of an image is measured."""
MIN_EXPLAINED = 0.7
"""Minimum fraction of the cells with points that a motion explains if it contradicts odometry."""
MIN_PART = 0.15
"""Minimum fraction of the points, and of the cells with points, in the part of an image that agrees
with odometry."""
MIN_PART_POINTS = 12
"""Minimum number of points in this part."""
MIN_EXCLUSIVE = 8
"""Minimum number of points in this part that contradict the other motion."""
OBJECT_MEMORY = 20
"""Number of frames after a contradiction by a part of the image in which images alone do not
overrule odometry."""
PART_KERNEL = (4.0, 2.0)
"""Widths of the robust kernel in this part, in standard deviations: points that disagree with
odometry have no influence from the first iteration on."""


class StepSource(IntEnum):
    """What determines the step to a frame."""

    CAMERA = 0
    """The images."""
    CONTRADICTED = 1
    """The images, although odometry contradicts them: wheels may slip."""
    PART = 2
    """The part of the image that agrees with odometry or with the last steps."""
    REJECTED = 3
    """Odometry: the motion in the images contradicts it, and explains a part of the image only."""
    ODOMETRY = 4
    """Odometry: the images determine no motion."""
    UNKNOWN = 5
    """The steps before: the images determine no motion, and there is no odometry."""
    STILL = 7
    """Images that do not move, of a camera without odometry."""
    DROPPED = 6
    """As `ODOMETRY` or `UNKNOWN`: the image contradicts both of its neighbors, and is dropped."""
    DIVIDED = 8
    """The images, of which a part moves otherwise; no odometry tells which part is the world."""


def choose_motion(
    camera: Camera,
    points: Correspondences,
    pixel_sigma: float,
    prior: MotionEstimate | None,
    expected: MotionEstimate | None,
    before: Camera | None = None,
    *,
    has_odometry: bool = True,
    objects_seen: bool = False,
) -> tuple[Egomotion | None, StepSource]:
    """Motion of the camera in the world, and its source.

    Args:
        camera: the camera in the second frame.
        points: k correspondences.
        pixel_sigma: standard deviation of a pixel.
        prior: see `estimate_motion`.
        expected: the motion by odometry, or else by the last steps, with its whole covariance.
        before: the camera in the first frame, if it was turned.
        has_odometry: whether `expected` is measured.
        objects_seen: whether parts of the last images contradicted odometry.
    """
    none = StepSource.ODOMETRY if has_odometry else StepSource.UNKNOWN
    motion = estimate_motion(camera, points, pixel_sigma, prior, before)
    alone = none if motion is None else StepSource.CAMERA
    if motion is not None and not has_odometry:
        is_whole = explained(camera, points, motion.inliers) >= MIN_EXPLAINED
        alone = StepSource.CAMERA if is_whole else StepSource.DIVIDED
    if expected is None or (motion is not None and agrees(motion, expected)):
        return motion, alone
    part = estimate_motion(camera, points, pixel_sigma, expected, before, PART_KERNEL)
    if part is not None and agrees(part, expected):
        others = np.zeros(len(part.inliers), np.bool_) if motion is None else motion.inliers
        if is_large(camera, points, part.inliers, part.inliers & ~others):
            return part, StepSource.PART
    if motion is None or not has_odometry:
        return motion, alone
    if objects_seen or explained(camera, points, motion.inliers) < MIN_EXPLAINED:
        return None, StepSource.REJECTED
    return motion, StepSource.CONTRADICTED


def agrees(motion: Egomotion, expected: MotionEstimate) -> bool:
    """Whether a motion agrees with its expectation."""
    control, covariance = expected
    calibration = RELATIVE_SIGMA * np.abs(motion.control) + LEAST_SIGMA
    total = motion.covariance + covariance + np.diag(np.square(calibration))
    return bool(normalized_squared(motion.control - control, total) < MAX_MOTION_NIS)


def is_large(
    camera: Camera, points: Correspondences, inliers: BoolArray, exclusive: BoolArray
) -> bool:
    """Whether inliers (k,) are a part of the image that may determine the motion.

    Some of them, `exclusive` (k,), must contradict the motion of the others: far points agree with
    any translation.
    """
    enough = np.count_nonzero(inliers) >= max(MIN_PART_POINTS, MIN_PART * len(inliers))
    enough = enough and np.count_nonzero(exclusive) >= MIN_EXCLUSIVE
    return bool(enough and explained(camera, points, inliers) >= MIN_PART)


def explained(camera: Camera, points: Correspondences, inliers: BoolArray) -> float:
    """Fraction of the cells with points (k,) in which at least half of the points are inliers."""
    cell = np.floor(points.current / (camera.width, camera.height) * GRID)
    column, row = np.clip(cell, 0, np.array(GRID) - 1).astype(np.int64).T
    number = column + GRID[0] * row
    count: FloatArray = np.bincount(number, minlength=GRID[0] * GRID[1]).astype(np.float64)
    agreeing = np.bincount(number, weights=inliers, minlength=len(count))
    occupied = count > 0
    return float(np.mean(agreeing[occupied] >= count[occupied] / 2)) if occupied.any() else 0.0
