"""What a frame shows: points that are followed, points that are found, and how far they are."""

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import DriveError
from saccade.frames import Camera, Frame
from saccade.keypoints.must import Must
from saccade.keypoints.must_config import MustConfig
from saccade.keypoints.sift import Sift
from saccade.keypoints.sift_config import SiftConfig
from saccade.keypoints.symroid import SymRoid
from saccade.types import Float32Array, FloatArray, IntArray, Keypoints
from saccade.visual.camera import Sightings, depth_of, is_inside, range_bearing
from saccade.visual.config import VisualConfig
from saccade.visual.following import ByteArray, disparities, follow, gray_bytes
from saccade.visual.motion import Motion, motion_between
from saccade.visual.ranging import depth_at, first_disparities, stereo_depth_sigma

BoolArray: TypeAlias = npt.NDArray[np.bool_]

BORDER = 8
"""Pixels at the edge of the image in which nothing is followed."""
DARK = 4.0
"""Standard deviation of the grey values under which an image shows nothing."""


@dataclass(frozen=True, eq=False)
class View:
    """A frame, as far as it can be used."""

    frame: Frame
    left: ByteArray | None = None
    """(H, W) grey values; None where the camera shows nothing."""
    right: ByteArray | None = None

    @property
    def blind(self) -> bool:
        """Whether there is nothing to be seen."""
        return self.left is None and self.frame.tracks is None


@dataclass(frozen=True, eq=False)
class Followed:
    """Points in view that are landmarks."""

    xy: Float32Array = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(k, 2) pixels."""
    depth: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(k,) metres along the optical axis, NaN where not known."""
    landmark: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) numbers."""
    track: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) names that the sequence gives them; -1 where it gives none."""

    def __len__(self) -> int:
        return len(self.xy)

    def __getitem__(self, index: BoolArray | IntArray) -> "Followed":
        return Followed(self.xy[index], self.depth[index], self.landmark[index], self.track[index])

    def joined(self, other: "Followed") -> "Followed":
        """These and those."""
        return Followed(
            np.concatenate([self.xy, other.xy]),
            np.append(self.depth, other.depth),
            np.append(self.landmark, other.landmark),
            np.append(self.track, other.track),
        )


def look(frame: Frame, camera: Camera) -> View:
    """Make ready what following needs.

    Raises:
        DriveError: an image that is not of the size of the calibration.
    """
    if frame.image is None:
        return View(frame)
    gray = gray_bytes(frame.image)
    if gray.shape != (camera.height, camera.width):
        raise DriveError(
            f"frame at {frame.time:.3f} s: expected an image of {camera.width} x {camera.height} "
            f"px as the calibration says, found {gray.shape[1]} x {gray.shape[0]}"
        )
    if gray.std() < DARK:
        return View(frame)
    right = None if frame.right is None else gray_bytes(frame.right)
    return View(frame, gray, right)


def track(
    camera: Camera, before: View, now: View, followed: Followed
) -> tuple[Followed, Motion | None]:
    """Find the followed points again, those that move as the robot does.

    Args:
        camera: the calibration.
        before: the last frame in which there was something to be seen.
        now: this one.
        followed: points of `before`.

    Returns:
        The points of `now`, with their depth there, and the motion that they agree on.
    """
    if now.frame.tracks is not None:
        given = now.frame.tracks
        _, old, new = np.intersect1d(followed.track, given.id, return_indices=True)
        here, xy = followed[old], given.xy[new].astype(np.float32)
        depth = depth_of(camera, given.disparity[new])
    elif now.left is not None and before.left is not None:
        xy, found = follow(before.left, now.left, followed.xy)
        found &= is_inside(camera, xy, BORDER)
        here, xy = followed[found], xy[found]
        depth = _depth_again(camera, now, xy, here.depth)
    else:
        return Followed(), None
    motion = motion_between(camera, here.xy, here.depth, xy)
    moved = Followed(xy, depth, here.landmark, here.track)
    return (moved if motion is None else moved[motion.agrees]), motion


def observe(
    camera: Camera, xy: Float32Array, depth: FloatArray, config: VisualConfig
) -> tuple[Sightings, BoolArray]:
    """Range and bearing of points, and which of them are known well enough.

    Args:
        camera: the calibration.
        xy: (k, 2) pixels.
        depth: (k,) metres along the optical axis; NaN where not known.
        config: what is well enough.

    Returns:
        k sightings, and (k,) whether each is of use.
    """
    far = np.nan_to_num(depth, nan=1.0)
    if camera.baseline > 0:
        sigma = stereo_depth_sigma(camera, far, config.disparity_sigma)
    else:
        sigma = config.depth_share * far
    seen = range_bearing(camera, xy.astype(np.float64), far, config.pixel_sigma, sigma)
    reach, spread = seen.z[:, 0], np.sqrt(seen.covariance[:, 0, 0])
    useful = np.isfinite(depth) & (reach > config.reach[0]) & (reach < config.reach[1])
    return seen, useful & (spread < config.range_share * reach)


class Detector:
    """Finds and describes the points of a frame.

    Args:
        config: which detector, and how many points.
    """

    def __init__(self, config: VisualConfig) -> None:
        self._find: Sift | Must | SymRoid
        if config.detector == "sift":
            self._find = Sift(SiftConfig(max_keypoints=config.points, spread=True))
        elif config.detector == "must":
            self._find = Must(MustConfig(max_keypoints=config.points))
        else:
            self._find = SymRoid()
        self._config = config

    def __call__(self, view: View) -> Keypoints:
        """The points of a view that shows something."""
        if view.left is None:
            given = view.frame.tracks
            xy = np.zeros((0, 2)) if given is None else given.xy
            return _undescribed(xy)
        found = self._find(view.left)
        points = found if isinstance(found, Keypoints) else found.keypoints
        return points[_first_of_each_place(points)]

    def depths(self, camera: Camera, view: View, points: Keypoints) -> FloatArray:
        """(n,) metres along the optical axis of new points; NaN where not known."""
        frame = view.frame
        if frame.tracks is not None:
            return depth_of(camera, frame.tracks.disparity)
        if frame.depth is not None:
            return depth_at(frame.depth, points.xy)
        if view.left is not None and view.right is not None:
            near = self._config.reach[0]
            return depth_of(
                camera, first_disparities(camera, view.left, view.right, points.xy, near)
            )
        return np.full(len(points), np.nan)


def _depth_again(camera: Camera, view: View, xy: Float32Array, before: FloatArray) -> FloatArray:
    if view.frame.depth is not None:
        return depth_at(view.frame.depth, xy)
    if view.left is None or view.right is None:
        return np.full(len(xy), np.nan)
    expected = camera.fx * camera.baseline / before
    return depth_of(camera, disparities(view.left, view.right, xy, expected))


def _undescribed(xy: FloatArray) -> Keypoints:
    points = Keypoints.at(xy, 1.0)
    return Keypoints(
        points.xy,
        points.size,
        points.angle,
        points.response,
        points.octave,
        np.zeros((len(xy), 128), np.uint8),
    )


def _first_of_each_place(points: Keypoints) -> IntArray:
    """A place with several directions comes once, its first."""
    _, first = np.unique(points.xy, axis=0, return_index=True)
    return np.sort(first)
