"""Survey of a drive: image statistics and camera motion over time."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import numpy as np

from saccade.errors import ImageError
from saccade.frames import Camera, Drive, Frame, Tracks, directions
from saccade.types import BoolArray, FloatArray, Image, IntArray, Table, column
from saccade.visual.camera import reduced_camera
from saccade.visual.depth import depth_of
from saccade.visual.egomotion import (
    MAX_REPROJECTION_ERROR,
    perspective_n_point,
)
from saccade.visual.optical_flow import (
    ByteArray,
    PreparedFrame,
    gray_bytes,
    reduced_image,
    track_points,
)
from saccade.visual.robot_motion import CameraPose

STRETCHES = 4
"""Number of evenly spaced sequences of successive frames in the survey of a long drive."""
MAX_IMAGE_WIDTH = 800
"""Maximum width in pixels; larger images are reduced first."""
MAX_EQUAL = 0.5
"""Maximum fraction of common tracks with equal positions; a frame with more is a copy."""
MIN_COMMON_TRACKS = 5
"""Minimum number of common tracks of a copy."""
UNKNOWN_MOTION = np.full(3, np.nan)


class FrameSurvey(NamedTuple):
    """Statistics of a frame; `Survey` documents the fields."""

    frame: int
    brightness: float = np.nan
    contrast: float = np.nan
    sharpness: float = np.nan
    points: int = 0
    copied: bool = False
    rotation: FloatArray = UNKNOWN_MOTION
    translation: FloatArray = UNKNOWN_MOTION
    metric: bool = False


@dataclass(frozen=True, eq=False)
class Survey:
    """Statistics of m frames."""

    frame: IntArray
    """(m,) frame numbers, ascending."""
    brightness: FloatArray
    """(m,) mean gray level of 255; NaN without an image."""
    contrast: FloatArray
    """(m,) standard deviation of the gray levels; NaN without an image."""
    sharpness: FloatArray
    """(m,) mean absolute Laplacian over the contrast; NaN without an image."""
    points: IntArray
    """(m,) number of points."""
    copied: BoolArray
    """(m,) True for an exact copy of the previous frame."""
    rotation: FloatArray
    """(m, 3) rotation vector of the camera since the previous frame, in radians about the robot's
    axes ahead, left and up: roll, pitch (nose down) and yaw; NaN if unknown."""
    translation: FloatArray
    """(m, 3) translation ahead, left and up; NaN if unknown."""
    metric: BoolArray
    """(m,) True if the translation is in meters; otherwise it has length 1, or 0 at a
    standstill."""
    unreadable: dict[int, str]
    """Error messages by frame number."""
    disparity: FloatArray
    """(d,) disparities of all stereo points, in pixels of the full image."""
    row_offset: FloatArray
    """(d,) row in the right image minus row in the left image, in pixels; NaN if unknown."""

    def __len__(self) -> int:
        return len(self.frame)


def survey_drive(
    drive: Drive, max_images: int, progress: Callable[[int, int], None] | None = None
) -> Survey:
    """Survey the frames of a drive.

    Args:
        drive: the drive.
        max_images: maximum number of images; all frames with tracks are surveyed.
        progress: function of the number of frames done and the total.
    """
    numbers = chosen_frames(len(drive), max_images)
    factor = -(-drive.camera.width // MAX_IMAGE_WIDTH)
    if _has_tracks(drive, numbers):
        numbers, factor = list(range(len(drive))), 1
    camera = reduced_camera(drive.camera, factor)
    rows, unreadable, all_points = list[FrameSurvey](), dict[int, str](), [FramePoints()]
    previous: PreparedFrame | None = None
    for i, number in enumerate(numbers):
        if i > 0 and numbers[i - 1] != number - 1:
            previous = None
        row = FrameSurvey(number)
        try:
            current = _shrink_frame(drive.load(number), factor)
        except ImageError as error:
            unreadable[number], previous = str(error), None
        else:
            points = points_of(current, camera)
            row = _image_statistics(number, current.left)._replace(points=len(points))
            if previous is not None:
                row = row._replace(copied=_is_copy(previous, current))
                pairs = match_points(all_points[-1], (previous, current), points)
                if (motion := motion_between(*pairs, camera)) is not None:
                    row = row._replace(**motion._asdict())
            all_points.append(points)
            previous = current
        rows.append(row)
        if progress is not None:
            progress(i + 1, len(numbers))
    every = FramePoints.concatenate(all_points)
    every = every[np.isfinite(every.disparity)]
    columns = map(np.array, zip(*rows, strict=True))
    of_frames: dict[str, Any] = dict(zip(FrameSurvey._fields, columns, strict=True))
    return Survey(
        **of_frames,
        unreadable=unreadable,
        disparity=every.disparity * factor,
        row_offset=every.row_offset * factor,
    )


def _image_statistics(number: int, gray: ByteArray | None) -> FrameSurvey:
    """Brightness, contrast and sharpness of a frame."""
    if gray is None:
        return FrameSurvey(number)
    contrast = float(gray.std())
    laplacian = float(np.abs(cv2.Laplacian(gray, cv2.CV_16S)).mean())
    return FrameSurvey(number, float(gray.mean()), contrast, laplacian / max(contrast, 1.0))


def chosen_frames(n: int, max_images: int) -> list[int]:
    """All n frames, or evenly spaced sequences with `max_images` frames in total."""
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
    """Whether most tracks, or the images, are exactly equal."""
    before, now = previous.frame.tracks, current.frame.tracks
    if before is not None and now is not None:
        return repeated_observations(before, now) is not None
    if previous.left is None or current.left is None:
        return False
    return bool(current.left.std() > 0 and np.array_equal(previous.left, current.left))


def repeated_observations(before: Tracks, now: Tracks) -> IntArray | None:
    """Indices in `now` of observations exactly equal to the previous frame.

    None unless most common tracks are equal, which means the frame is not a copy.
    """
    _, i, j = np.intersect1d(before.id, now.id, return_indices=True)
    equal = (before.xy[i] == now.xy[j]).all(1)
    if len(i) < MIN_COMMON_TRACKS or equal.mean() <= MAX_EQUAL:
        return None
    return np.asarray(j[equal], np.int64)


MAX_CORNERS = 300
"""Maximum number of corners per image."""
CORNER_QUALITY = 0.003
"""Minimum response of a corner, as a fraction of the strongest."""
MIN_SPACING = 9
"""Minimum distance between corners in pixels."""
MIN_DISPARITY = 2.0
"""Minimum disparity in pixels for a depth."""
MIN_MOTION_POINTS = 12
"""Minimum number of points for a motion estimate."""
STILL_DISPLACEMENT = 0.2
"""Maximum median displacement of the points of a stationary camera, in pixels."""


@dataclass(frozen=True, eq=False)
class FramePoints(Table):
    """k points of a frame."""

    xy: FloatArray = column(2)
    """(k, 2) pixels."""
    depth: FloatArray = column()
    """(k,) meters along the optical axis, NaN where unknown."""
    disparity: FloatArray = column()
    """(k,) pixels, NaN where unknown."""
    row_offset: FloatArray = column()
    """(k,) row in the right image minus row in the left image, in pixels; NaN if unknown."""
    track: IntArray = column(dtype=np.int64)
    """(k,) track ids of the drive, 0 for corners."""


def points_of(prepared: PreparedFrame, camera: Camera) -> FramePoints:
    """The tracks of a frame, or the corners of its image (Shi & Tomasi, 1994)."""
    if (tracks := prepared.frame.tracks) is not None:
        unknown = np.full(len(tracks), np.nan)
        depth = _depth_of(tracks.disparity, camera)
        return FramePoints(tracks.xy, depth, tracks.disparity, unknown, tracks.id)
    if (gray := prepared.left) is None:
        return FramePoints()
    corners: Any = cv2.goodFeaturesToTrack(gray, MAX_CORNERS, CORNER_QUALITY, MIN_SPACING)
    if corners is None:
        return FramePoints()
    xy = np.asarray(corners, np.float64).reshape(-1, 2)
    depth = disparity = rows = np.full(len(xy), np.nan)
    if prepared.frame.depth is not None:
        column, row = np.rint(xy).astype(np.int64).T
        depth = prepared.frame.depth[row, column]
    elif prepared.right is not None and prepared.right.shape == gray.shape:
        right, tracked = track_points(gray, prepared.right, xy.astype(np.float32))
        disparity = np.where(tracked, xy[:, 0] - right[:, 0], np.nan)
        rows = np.where(tracked, right[:, 1] - xy[:, 1], np.nan)
        depth = _depth_of(disparity, camera)
    return FramePoints(xy, depth, disparity, rows, np.zeros(len(xy), np.int64))


def _depth_of(disparity: FloatArray, camera: Camera) -> FloatArray:
    """(k,) meters; NaN where the disparity is too small, or there is no right camera."""
    usable = (disparity > MIN_DISPARITY) & (camera.baseline > 0)
    return depth_of(camera, np.where(usable, disparity, np.nan))


def match_points(
    first: FramePoints, frames: tuple[PreparedFrame, PreparedFrame], second: FramePoints
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Correspondences of two frames, from tracks or from optical flow.

    Returns:
        (k, 2) pixels in the first and (k, 2) in the second frame, and (k,) depths in the first.
    """
    previous, current = frames
    if previous.frame.tracks is not None and current.frame.tracks is not None:
        _, i, j = np.intersect1d(first.track, second.track, return_indices=True)
        return first.xy[i], second.xy[j], first.depth[i]
    one, other = previous.left, current.left
    if one is None or other is None or one.shape != other.shape:
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    xy, tracked = track_points(one, other, first.xy.astype(np.float32))
    return first.xy[tracked], xy[tracked].astype(np.float64), first.depth[tracked]


class CameraMotion(NamedTuple):
    """Motion of a camera along the robot's axes (ahead, left, up) at the first frame."""

    rotation: FloatArray
    """(3,) rotation vector in radians."""
    translation: FloatArray
    """(3,) in meters, or of length 1, or 0 at a standstill."""
    metric: bool
    """Whether the translation is in meters."""


def motion_between(
    first: FloatArray, second: FloatArray, depth: FloatArray, camera: Camera
) -> CameraMotion | None:
    """Estimates the motion of a camera from k correspondences.

    Args:
        first: (k, 2) pixels in the first frame.
        second: (k, 2) pixels in the next frame.
        depth: (k,) meters along the optical axis in the first frame, NaN where unknown.
        camera: the calibration.

    Returns:
        The motion; None if too few points, or less than a third, agree.
    """
    known = np.isfinite(depth)
    metric = bool(known.sum() >= MIN_MOTION_POINTS)
    pose: CameraPose | None = None
    if metric:
        points = directions(camera, first[known]) * depth[known, None]
        solution = perspective_n_point(
            camera, points, second[known], method=cv2.SOLVEPNP_ITERATIVE, confidence=0.99
        )
        if solution is not None and _most_agree(solution[2], len(points)):
            pose = solution[:2]
    else:
        pose = _from_directions(first, second, camera)
    if pose is None:
        return None
    R, t = pose
    C = camera.rotation
    rotation = np.asarray(cv2.Rodrigues(C @ R.T @ C.T)[0], np.float64).ravel()
    return CameraMotion(rotation, -(C @ R.T @ t), metric)


def _from_directions(first: FloatArray, second: FloatArray, camera: Camera) -> CameraPose | None:
    if len(first) < MIN_MOTION_POINTS:
        return None
    if np.median(np.hypot(*(second - first).T)) < STILL_DISPLACEMENT:
        return np.eye(3), np.zeros(3)
    K = camera.matrix
    E, inliers = cv2.findEssentialMat(first, second, K, cv2.RANSAC, 0.999, MAX_REPROJECTION_ERROR)
    if E is None or E.shape != (3, 3):
        return None
    count, R, t, _ = cv2.recoverPose(E, first, second, K, mask=inliers)
    if not _most_agree(int(count), len(first)):
        return None
    return np.asarray(R, np.float64), np.asarray(t, np.float64).ravel()


def _most_agree(inliers: int, count: int) -> bool:
    return inliers >= MIN_MOTION_POINTS and inliers > count / 3


MIN_STEPS = 20
"""Minimum number of steps for a comparison of odometry with images."""
MAX_LAG = 1.0
"""Maximum offset between the two clocks, in seconds."""
MAX_REGRESSION_ITERATIONS = 10
"""Maximum number of iterations of the robust regression."""
INLIER_SIGMAS = 3.0
"""Maximum residual of an inlier, in standard deviations."""
TRUNCATED_SIGMA = 0.987
"""Standard deviation of a standard normal variable truncated at `INLIER_SIGMAS`."""
SIGNIFICANT_SIGMAS = 4.0
"""Minimum number of standard errors of a significant difference."""


@dataclass(frozen=True, eq=False)
class MotionSeries(Table):
    """k steps between successive frames with known camera motion and odometry, in order."""

    duration: FloatArray = column()
    """(k,) seconds."""
    rotation: FloatArray = column(3)
    """(k, 3) rotation from the images, as `Survey.rotation`."""
    translation: FloatArray = column(3)
    """(k, 3) translation from the images, in meters; scaled by odometry if the images do not
    measure the length."""
    metric: BoolArray = column(dtype=np.bool_)
    """(k,) True if the images measure the length; equal in all steps."""
    odometry: FloatArray = column(3)
    """(k, 3) odometry: meters ahead and left, and radians."""
    covariance: FloatArray = column(3, 3)
    """(k, 3, 3) covariances of odometry."""

    @property
    def moving(self) -> "MotionSeries":
        """The steps in which the robot translates."""
        length = np.hypot(self.odometry[:, 0], self.odometry[:, 1])
        return self[length > 0.3 * (np.quantile(length, 0.9) if len(length) else 0.0)]


def series_of(drive: Drive, survey: Survey, control: FloatArray) -> MotionSeries:
    """The surveyed steps with finite controls (n - 1, 3); empty if all controls are zero."""
    known = (survey.frame > 0) & np.isfinite(control[survey.frame - 1, 0])
    known &= np.isfinite(survey.rotation).all(1) & np.isfinite(survey.translation).all(1)
    metric = bool(survey.metric[known].mean() > 0.5) if known.any() else False
    known &= (survey.metric == metric) & bool(control.any())
    step = survey.frame[known] - 1
    odometry, translation = control[step], survey.translation[known]
    if not metric:
        translation = translation * np.hypot(odometry[:, 0], odometry[:, 1])[:, None]
    return MotionSeries(
        *(np.diff(drive.time)[step], survey.rotation[known], translation, survey.metric[known]),
        *(odometry, drive.control_covariance[step]),
    )


class Lag(NamedTuple):
    """Offset between two clocks."""

    frames: int
    """Delay of odometry relative to the images, in frames."""
    correlation: float
    """Correlation of the turns at this lag, -1 to 1."""
    correlation_without: float
    """Correlation at lag 0."""


def lag_of(drive: Drive, survey: Survey, control: FloatArray) -> Lag | None:
    """The lag with the highest correlation between turns of controls (n - 1, 3) and images.

    None if the robot does not turn.
    """
    turn = np.full(len(drive) - 1, np.nan)
    turn[survey.frame[survey.frame > 0] - 1] = survey.rotation[survey.frame > 0, 2]
    duration = np.diff(drive.time)
    period = float(np.median(duration)) if len(duration) else 0.0
    if period <= 0:
        return None
    duration = np.maximum(duration, period / 2)
    rates = turn / duration, control[:, 2] / duration
    longest = int(np.clip(round(MAX_LAG / period), 2, max(len(turn) // 5, 2)))
    lags = range(-longest, longest + 1)
    correlations = [_correlation(*rates, lag) for lag in lags]
    if not np.isfinite(correlations).all():
        return None
    best = int(np.argmax(np.abs(correlations)))
    return Lag(lags[best], correlations[best], correlations[longest])


def _correlation(turn: FloatArray, odometry: FloatArray, lag: int) -> float:
    """Robust correlation of turn rates with the turn rates of odometry `lag` steps later."""
    n = len(turn)
    first, second = turn[max(0, -lag) : n - max(0, lag)], odometry[max(0, lag) : n + min(0, lag)]
    known = np.isfinite(first) & np.isfinite(second)
    if known.sum() < MIN_STEPS:
        return float("nan")
    a, b = (np.clip(x, *np.quantile(x, [0.005, 0.995])) for x in (first[known], second[known]))
    if a.std() == 0 or b.std() == 0:
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients of y = A @ value."""

    value: FloatArray
    """(c,) coefficients."""
    error: FloatArray
    """(c,) standard errors."""
    sigma: float
    """Standard deviation of the residuals of the inliers."""

    def differs(self, index: int, expected: float, tolerance: float) -> bool:
        """Whether a coefficient deviates significantly, and by more than a tolerance."""
        difference = abs(self.value[index] - expected)
        return bool(difference > max(tolerance, SIGNIFICANT_SIGMAS * self.error[index]))


def fit(A: FloatArray, y: FloatArray) -> Fit | None:
    """Least squares with iterated outlier rejection: y (n,) = A (n, c) @ value (c,).

    None if there are too few samples or inliers, or A is singular.
    """
    c = A.shape[1]
    if len(y) < 5 * c:
        return None
    inlier = np.ones(len(y), bool)
    for _ in range(MAX_REGRESSION_ITERATIONS):
        value, *_ = np.linalg.lstsq(A[inlier], y[inlier], rcond=None)
        residual = np.abs(y - A @ value)
        sigma = 1.4826 * float(np.median(residual)) + 1e-12
        inlier = residual < INLIER_SIGMAS * sigma
        if inlier.sum() < 3 * c:
            return None
    information = A[inlier].T @ A[inlier]
    if np.linalg.cond(information) > 1e12:
        return None
    dof = int(inlier.sum()) - c
    sigma = float(np.sqrt(np.square(residual[inlier]).sum() / dof)) / TRUNCATED_SIGMA
    error = sigma * np.sqrt(np.diagonal(np.linalg.inv(information)))
    return Fit(np.asarray(value), np.asarray(error), sigma)
