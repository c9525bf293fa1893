"""What a frame shows: points that are followed, points that are found, and how far they are."""

from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeAlias, cast

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import DriveError, ImageError
from saccade.frames import Camera, Drive, Frame
from saccade.keypoints.must import Must
from saccade.keypoints.must_config import MustConfig
from saccade.keypoints.sift import Sift
from saccade.keypoints.sift_config import SiftConfig
from saccade.keypoints.symroid import SymRoid
from saccade.types import Float32Array, FloatArray, IntArray, Keypoints
from saccade.visual.camera import (
    NEAREST,
    RangeBearings,
    depth_of,
    from_pixels,
    is_inside,
    range_bearing,
)
from saccade.visual.config import VisualConfig
from saccade.visual.depth import depth_at, first_disparities, stereo_depth_sigma
from saccade.visual.egomotion import Motion, Prior, estimate_motion, make_pairs
from saccade.visual.optical_flow import (
    ByteArray,
    TrackFunction,
    disparities,
    gray_bytes,
    track_points,
)

BoolArray: TypeAlias = npt.NDArray[np.bool_]

UNKNOWN = 30.0
"""Standard deviation of a range of which nothing is said, as a share of it."""
BORDER = 8
"""Pixels at the edge of the image in which nothing is followed."""
SMALL = 320_000
"""Pixels of the largest image whose finest points are looked for: larger ones have enough others,
for a third of the time."""
DARK = 4.0
"""Standard deviation of the grey values under which an image shows nothing."""


@dataclass(frozen=True, eq=False)
class PreparedFrame:
    """A frame, as far as it can be used."""

    frame: Frame
    left: ByteArray | None = None
    """(H, W) grey values; None where the camera shows nothing."""
    right: ByteArray | None = None

    @property
    def is_blank(self) -> bool:
        """Whether there is nothing to be seen."""
        return self.left is None and self.frame.tracks is None


@dataclass(frozen=True, eq=False)
class TrackedPoints:
    """Points in view: landmarks, and what may become one."""

    xy: Float32Array = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(k, 2) pixels."""
    depth: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(k,) metres along the optical axis, NaN where not known."""
    depth_sigma: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(k,) metres."""
    landmark: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) numbers, -1 for those that are none."""
    track: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) names that the sequence gives them; -1 where it gives none."""
    first_frame: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) frame from which each has been followed."""
    first_xy: Float32Array = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(k, 2) pixels in that frame."""
    response: Float32Array = field(default_factory=lambda: np.zeros(0, np.float32))
    """(k,) how strong each was there."""
    descriptor: ByteArray = field(default_factory=lambda: np.zeros((0, 128), np.uint8))
    """(k, 128) how each looked there."""
    reidentified: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))
    """(k,) whether it was recognized there, after it had been out of sight."""
    rematch_attempts: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) times that it was looked for by its looks alone while it was followed."""
    rematches: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) how many of them found it where it was."""

    def __len__(self) -> int:
        return len(self.xy)

    def __getitem__(self, index: BoolArray | IntArray) -> "TrackedPoints":
        return TrackedPoints(*(column[index] for column in self._columns()))

    def concatenated(self, other: "TrackedPoints") -> "TrackedPoints":
        """These and those."""
        pairs = zip(self._columns(), other._columns(), strict=True)
        return TrackedPoints(*(np.concatenate(pair) for pair in pairs))

    @property
    def is_landmark(self) -> BoolArray:
        """(k,) which are landmarks."""
        return self.landmark >= 0

    @property
    def keypoints(self) -> Keypoints:
        """Where they are, with the looks that they had at first."""
        points = Keypoints.at(self.xy, 1.0)
        return replace(points, response=self.response, descriptors=self.descriptor)

    def _columns(self) -> list[npt.NDArray[Any]]:
        return [getattr(self, each.name) for each in fields(self)]


def prepare_frame(frame: Frame, camera: Camera) -> PreparedFrame:
    """Make ready what following needs.

    Raises:
        DriveError: an image that is not of the size of the calibration.
    """
    if frame.image is None:
        return PreparedFrame(frame)
    gray = gray_bytes(frame.image)
    if gray.shape != (camera.height, camera.width):
        raise DriveError(
            f"frame at {frame.time:.3f} s: expected an image of {camera.width} x {camera.height} "
            f"px as the calibration says, found {gray.shape[1]} x {gray.shape[0]}"
        )
    if cv2.meanStdDev(gray)[1][0, 0] < DARK:
        return PreparedFrame(frame)
    right = None if frame.right is None else gray_bytes(frame.right)
    return PreparedFrame(frame, gray, right)


def track(
    camera: Camera,
    before: PreparedFrame,
    now: PreparedFrame,
    followed: TrackedPoints,
    prior: Prior,
    config: VisualConfig,
    follow: TrackFunction = track_points,
) -> tuple[TrackedPoints, Motion | None]:
    """Find the followed points again, those that move as the robot does.

    Args:
        camera: the calibration.
        before: the last frame in which there was something to be seen.
        now: this one.
        followed: points of `before`.
        prior: the control that is expected.
        config: how far pixels and depths can be trusted.
        follow: what finds points of one image in another.

    Returns:
        The points of `now`, with their depth where it is measured there, and the motion that
        they agree on.
    """
    if now.frame.tracks is not None:
        given = now.frame.tracks
        _, old, new = np.intersect1d(followed.track, given.id, return_indices=True)
        here, xy = followed[old], given.xy[new].astype(np.float32)
        depth = depth_of(camera, given.disparity[new])
    elif now.left is not None and before.left is not None:
        xy, found = follow(before.left, now.left, followed.xy, None)
        found &= is_inside(camera, xy, BORDER)
        here, xy = followed[found], xy[found]
        depth = _depth_again(camera, now, xy, here.depth, follow)
    else:
        return TrackedPoints(), None
    sigma = depth_deviation(camera, depth, config)
    ranged = measures_depth(camera, now.frame)
    was = here.depth if ranged else np.full(len(here), np.nan)
    pairs = make_pairs(here.xy, xy, was, here.depth_sigma, depth, sigma)
    motion = estimate_motion(camera, pairs, config.pixel_sigma, prior, ranged)
    moved = replace(here, xy=xy, depth=depth, depth_sigma=sigma)
    return (moved if motion is None else moved[motion.inliers]), motion


def measures_depth(camera: Camera, frame: Frame) -> bool:
    """Whether a frame tells by itself how far points are."""
    return camera.baseline > 0 or frame.depth is not None


def provides_depth(drive: Drive) -> bool:
    """Whether the frames of a drive do: by the first of them that can be read.

    Raises:
        DriveError: none can be read, as where the calibration is of other images.
    """
    first = None
    for number in range(len(drive)):
        try:
            frame = drive.load(number)
        except ImageError as error:
            first = first or error
            continue
        if frame.image is not None or frame.tracks is not None:
            return measures_depth(drive.camera, frame)
    if first is not None:
        raise DriveError(f"{first}; no frame of the drive can be used")
    return False


def depth_deviation(camera: Camera, depth: FloatArray, config: VisualConfig) -> FloatArray:
    """(k,) standard deviations of depths (k,) that were measured, in metres."""
    if camera.baseline > 0:
        return stereo_depth_sigma(camera, depth, config.disparity_sigma)
    return config.relative_depth_sigma * depth


def observe(
    camera: Camera,
    xy: Float32Array,
    depth: FloatArray,
    depth_sigma: FloatArray,
    config: VisualConfig,
    tilt: float,
) -> tuple[RangeBearings, BoolArray]:
    """Range and bearing of points, and which of them are known well enough.

    Args:
        camera: the calibration.
        xy: (k, 2) pixels.
        depth: (k,) metres along the optical axis; NaN where not known.
        depth_sigma: (k,) metres.
        config: what is well enough.
        tilt: standard deviation of the camera's pitch and roll, in radians: what is far above or
            below it is seen aside, and as much nearer or farther.

    Returns:
        k sightings, and (k,) whether each is of use.
    """
    far = np.nan_to_num(depth, nan=1.0)
    sigma = np.nan_to_num(depth_sigma, nan=1.0)
    seen = range_bearing(camera, xy.astype(np.float64), far, config.pixel_sigma, sigma)
    above = seen.height - camera.position[2]
    seen.covariance[:, 0, 0] += np.square(tilt * above)
    seen.covariance[:, 1, 1] += np.square(tilt * above / seen.z[:, 0])
    reach, spread = seen.z[:, 0], np.sqrt(seen.covariance[:, 0, 0])
    useful = (
        np.isfinite(depth) & (reach > config.range_limits[0]) & (reach < config.range_limits[1])
    )
    return seen, useful & (spread < config.relative_range_sigma * reach)


def observe_bearing_only(
    camera: Camera, xy: Float32Array, reach: FloatArray, config: VisualConfig, tilt: float
) -> RangeBearings:
    """Sightings of points (k, 2) that are at ranges (k,) already: they tell the bearing alone."""
    near, far = (from_pixels(camera, xy.astype(np.float64), np.full(len(xy), s)) for s in (0, 1))
    origin, ahead = near[:, :2], (far - near)[:, :2]
    square, half = np.square(ahead).sum(1), (origin * ahead).sum(1)
    over = np.maximum(half**2 - square * (np.square(origin).sum(1) - reach**2), 0.0)
    depth = np.maximum(np.sqrt(over) - half, NEAREST) / np.maximum(square, 1e-12)
    seen, _ = observe(camera, xy, depth, UNKNOWN * depth, config, tilt)
    return seen


class Detector:
    """Finds and describes the points of a frame.

    Args:
        config: which detector, and how many points.
        camera: the calibration.
    """

    def __init__(self, config: VisualConfig, camera: Camera) -> None:
        self._find: Sift | Must | SymRoid
        if config.detector == "sift":
            octave = -1 if camera.width * camera.height <= SMALL else 0
            points = SiftConfig(max_keypoints=config.max_points, spread=True, first_octave=octave)
            self._find = Sift(points)
        elif config.detector == "must":
            self._find = Must(MustConfig(max_keypoints=config.max_points))
        else:
            self._find = SymRoid()
        self._config, self._camera = config, camera

    def __call__(self, view: PreparedFrame, number: int) -> TrackedPoints:
        """The points of a frame that shows something; none of them is a landmark yet."""
        given, camera = view.frame.tracks, self._camera
        if given is not None:
            points, track = _undescribed(given.xy), given.id
            depth = depth_of(camera, given.disparity)
        elif view.left is not None:
            found = self._find(view.left)
            points = found if isinstance(found, Keypoints) else found.keypoints
            points = points[_first_of_each_place(points)]
            track = np.full(len(points), -1)
            depth = self._depths(camera, view, points)
        else:
            return TrackedPoints()
        assert points.descriptors is not None
        return TrackedPoints(
            points.xy,
            depth,
            depth_deviation(camera, depth, self._config),
            np.full(len(points), -1),
            track,
            np.full(len(points), number),
            points.xy,
            points.response,
            cast("ByteArray", points.descriptors),
            np.zeros(len(points), np.bool_),
            np.zeros(len(points), np.int64),
            np.zeros(len(points), np.int64),
        )

    def _depths(self, camera: Camera, view: PreparedFrame, points: Keypoints) -> FloatArray:
        """(n,) metres along the optical axis of new points; NaN where not known."""
        if view.frame.depth is not None:
            return depth_at(view.frame.depth, points.xy)
        if view.left is not None and view.right is not None:
            near = self._config.range_limits[0]
            return depth_of(
                camera, first_disparities(camera, view.left, view.right, points.xy, near)
            )
        return np.full(len(points), np.nan)


def _depth_again(
    camera: Camera, view: PreparedFrame, xy: Float32Array, before: FloatArray, follow: TrackFunction
) -> FloatArray:
    if view.frame.depth is not None:
        return depth_at(view.frame.depth, xy)
    if view.left is None or view.right is None:
        return np.full(len(xy), np.nan)
    expected = camera.fx * camera.baseline / before
    return depth_of(camera, disparities(view.left, view.right, xy, expected, follow))


def _undescribed(xy: FloatArray) -> Keypoints:
    return replace(Keypoints.at(xy, 1.0), descriptors=np.zeros((len(xy), 128), np.uint8))


def _first_of_each_place(points: Keypoints) -> IntArray:
    """A place with several directions comes once, its first."""
    _, first = np.unique(points.xy, axis=0, return_index=True)
    return np.sort(first)
