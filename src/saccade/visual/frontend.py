"""Visual front end: detects points in a frame, and tracks points into it."""

from dataclasses import replace
from typing import cast

import numpy as np

from saccade.frames import Camera
from saccade.keypoints.must import Must
from saccade.keypoints.must_config import MustConfig
from saccade.keypoints.sift import Sift
from saccade.keypoints.sift_config import SiftConfig
from saccade.keypoints.symroid import SymRoid
from saccade.types import IntArray, Keypoints
from saccade.visual.camera import is_inside
from saccade.visual.config import VisualConfig
from saccade.visual.depth import depth_of, depth_sigma, measure_depth, measures_depth
from saccade.visual.egomotion import Motion, Prior, correspondences_of, estimate_motion
from saccade.visual.optical_flow import ByteArray, track_points
from saccade.visual.prepared_frame import PreparedFrame
from saccade.visual.tables import TrackedPoints

BORDER = 8
"""Pixels at the edge of the image in which no point is tracked."""
MAX_UPSAMPLED = 320_000
"""Pixels of the largest image that SIFT doubles: larger ones have enough points, and take a third
of the time."""


class Detector:
    """Detects and describes points.

    Args:
        config: which detector, and how many points.
        camera: the calibration.
    """

    def __init__(self, config: VisualConfig, camera: Camera) -> None:
        self._detect: Sift | Must | SymRoid
        if config.detector == "sift":
            octave = -1 if camera.width * camera.height <= MAX_UPSAMPLED else 0
            points = SiftConfig(max_keypoints=config.max_points, spread=True, first_octave=octave)
            self._detect = Sift(points)
        elif config.detector == "must":
            self._detect = Must(MustConfig(max_keypoints=config.max_points))
        else:
            self._detect = SymRoid()
        self._config, self._camera = config, camera

    def __call__(self, prepared: PreparedFrame, number: int) -> TrackedPoints:
        """The points of a frame, none of which is a landmark."""
        tracks, camera = prepared.frame.tracks, self._camera
        if tracks is not None:
            points, track = Keypoints.at(tracks.xy, 1.0), tracks.id
            descriptors = np.zeros((len(tracks), 128), np.uint8)
            depth = depth_of(camera, tracks.disparity)
        elif prepared.left is not None:
            detected = self._detect(prepared.left)
            points = detected if isinstance(detected, Keypoints) else detected.keypoints
            points = points[_first_of_each_position(points)]
            descriptors, track = cast("ByteArray", points.descriptors), np.full(len(points), -1)
            depth = measure_depth(camera, prepared, points.xy, self._config)
        else:
            return TrackedPoints()
        return TrackedPoints.zeros(
            len(points),
            xy=points.xy,
            depth=depth,
            depth_sigma=depth_sigma(camera, depth, self._config),
            landmark=np.full(len(points), -1),
            track=track,
            first_frame=np.full(len(points), number),
            first_xy=points.xy,
            response=points.response,
            descriptor=descriptors,
        )


def track(
    camera: Camera,
    previous: PreparedFrame,
    current: PreparedFrame,
    tracked: TrackedPoints,
    prior: Prior,
    config: VisualConfig,
) -> tuple[TrackedPoints, Motion | None]:
    """Track points into a frame, and estimate the motion that they agree on.

    Args:
        camera: the calibration.
        previous: the last frame that was not blank.
        current: the frame.
        tracked: points of `previous`.
        prior: the expected control.
        config: standard deviations of pixels and depths.

    Returns:
        The inliers of the motion in `current`, with their depths where it measures them; and
        the motion, None (and all points) where they agree on none.
    """
    if current.frame.tracks is not None:
        tracks = current.frame.tracks
        _, old, new = np.intersect1d(tracked.track, tracks.id, return_indices=True)
        tracked, xy = tracked[old], tracks.xy[new].astype(np.float32)
        depth = depth_of(camera, tracks.disparity[new])
    elif current.left is not None and previous.left is not None:
        xy, ok = track_points(previous.left, current.left, tracked.xy)
        ok &= is_inside(camera, xy, BORDER)
        tracked, xy = tracked[ok], xy[ok]
        depth = measure_depth(camera, current, xy, config, tracked.depth)
    else:
        return TrackedPoints(), None
    sigma = depth_sigma(camera, depth, config)
    has_depth = measures_depth(camera, current.frame)
    previous_depth = tracked.depth if has_depth else np.full(len(tracked), np.nan)
    points = correspondences_of(tracked.xy, xy, previous_depth, tracked.depth_sigma, depth, sigma)
    motion = estimate_motion(camera, points, config.pixel_sigma, None if has_depth else prior)
    moved = replace(tracked, xy=xy, depth=depth, depth_sigma=sigma)
    return (moved if motion is None else moved[motion.inliers]), motion


def _first_of_each_position(points: Keypoints) -> IntArray:
    """Indices of the keypoints, a position with several orientations once."""
    _, first = np.unique(points.xy, axis=0, return_index=True)
    return np.sort(first)
