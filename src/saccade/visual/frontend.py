"""Visual front end: reads frames ahead, detects points in them, and tracks points into them."""

import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Generic, Self, TypeVar, cast

import numpy as np
from threadpoolctl import threadpool_limits

from saccade.errors import ImageError
from saccade.frames import Camera, Drive, Frame
from saccade.keypoints.must import Must
from saccade.keypoints.must_config import MustConfig
from saccade.keypoints.sift import Sift
from saccade.keypoints.sift_config import SiftConfig
from saccade.keypoints.symroid import SymRoid
from saccade.types import Image, Keypoints
from saccade.visual.camera import is_inside
from saccade.visual.config import VisualConfig
from saccade.visual.depth import depth_of, depth_sigma, measure_depth, measures_depth
from saccade.visual.egomotion import Motion, Prior, correspondences_of, estimate_motion
from saccade.visual.optical_flow import (
    ByteArray,
    PreparedFrame,
    match_brightness,
    prepare_frame,
    track_points,
)
from saccade.visual.tables import TrackedPoints

T = TypeVar("T")

MAX_DETECTIONS = 2**20
"""More points than are ever detected in a frame: the ids of points are a multiple of it and on."""
BORDER = 8
"""Pixels at the edge of the image in which no point is tracked."""
MAX_UPSAMPLED = 320_000
"""Pixels of the largest image that SIFT upsamples: larger ones have enough points without it, and
take a third of the time."""
SWITCH_INTERVAL = 5e-4
"""Seconds after which a thread that runs Python code yields to another: a tenth of the default."""


@dataclass(frozen=True, eq=False)
class FrameFeatures:
    """A frame and the points detected in it."""

    frame: PreparedFrame
    detected: TrackedPoints | None
    """None in the frames between those in which points are detected, and in blank ones."""
    remarks: list[str]
    """Why the frame could not be read, if so."""
    seconds: dict[str, float]
    """Computation time by step."""


class FeatureCache(dict[tuple[str, int, int, int], FrameFeatures]):
    """Features of the frames of a drive, shared by runs with different settings.

    Keys are detector, number of points, detection interval, and frame; nothing is ever evicted.
    """


class FeatureExtractor:
    """Reads the frames of a drive, and detects points in every `detect_interval`-th.

    Args:
        drive: the frames.
        config: the settings.
        cache: features of earlier runs over the same frames.
        read: frames that have been read, by number; each is used once, then dropped.
    """

    def __init__(
        self,
        drive: Drive,
        config: VisualConfig,
        cache: FeatureCache | None = None,
        read: Mapping[int, Frame] | None = None,
    ) -> None:
        self._drive, self._config, self._cache = drive, config, cache
        self._read = dict(read or {})
        self._detect_keypoints: Callable[[Image], Keypoints]
        if config.detector == "sift":
            pixels = drive.camera.width * drive.camera.height
            octave = -1 if pixels <= MAX_UPSAMPLED else 0
            self._detect_keypoints = Sift(
                SiftConfig(
                    max_keypoints=config.max_points,
                    ranking="response",  # the ranking with which drives were measured
                    spread=True,
                    first_octave=octave,
                )
            )
        elif config.detector == "must":
            self._detect_keypoints = Must(MustConfig(max_keypoints=config.max_points))
        else:
            symroid = SymRoid()
            self._detect_keypoints = lambda image: symroid(image).keypoints

    def __call__(self, number: int) -> FrameFeatures:
        """A frame and its points; an empty frame where it cannot be read."""
        if self._cache is None:
            return self._extract(number)
        config = self._config
        key = config.detector, config.max_points, config.detect_interval, number
        if key not in self._cache:
            self._cache[key] = self._extract(number)
        return self._cache[key]

    def _extract(self, number: int) -> FrameFeatures:
        start, remarks = perf_counter(), list[str]()
        try:
            frame = self._read.pop(number, None) or self._drive.load(number)
        except ImageError as error:
            frame, remarks = Frame(float(self._drive.time[number])), [str(error)]
        prepared, detected = prepare_frame(frame, self._drive.camera), None
        read = perf_counter()
        if frame.tracks is not None or number % self._config.detect_interval == 0:
            detected = self._detect(prepared, number)
        seconds = {"read": read - start, "detect": perf_counter() - read}
        return FrameFeatures(prepared, detected, remarks, seconds)

    def _detect(self, prepared: PreparedFrame, number: int) -> TrackedPoints | None:
        """The points of a frame, none of them a landmark yet; None where it is blank."""
        tracks, camera = prepared.frame.tracks, self._drive.camera
        if tracks is not None:
            points, track = Keypoints.at(tracks.xy, 1.0), tracks.id
            descriptors = tracks.descriptor
            if descriptors is None:
                descriptors = np.zeros((len(tracks), 128), np.uint8)
            depth = depth_of(camera, tracks.disparity)
        elif prepared.left is not None:
            points = self._detect_keypoints(prepared.left)
            _, first = np.unique(points.xy, axis=0, return_index=True)
            points = points[np.sort(first)]  # one for each position, whatever its orientations
            descriptors, track = cast("ByteArray", points.descriptors), np.full(len(points), -1)
            depth = measure_depth(camera, prepared, points.xy, self._config)
        else:
            return None
        return TrackedPoints.zeros(
            len(points),
            xy=points.xy,
            depth=depth,
            depth_sigma=depth_sigma(camera, depth, self._config),
            landmark=np.full(len(points), -1),
            id=MAX_DETECTIONS * number + np.arange(len(points)),
            track=track,
            first_frame=np.full(len(points), number),
            first_xy=points.xy,
            response=points.response,
            descriptor=descriptors,
        )


class Prefetcher(Generic[T]):
    """Computes items 0 to `count` - 1 in another thread, at most `ahead` of them in advance.

    A context manager: its thread ends with it.
    """

    def __init__(self, compute: Callable[[int], T], count: int, ahead: int) -> None:
        self._compute, self._count, self._ahead = compute, count, ahead
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="saccade-prefetch")
        self._pending: dict[int, Future[T]] = {}

    def __call__(self, number: int) -> T:
        """The item of a number; raises what its computation raised."""
        for i in range(number, min(number + 1 + self._ahead, self._count)):
            if i not in self._pending:
                self._pending[i] = self._thread.submit(self._compute, i)
        return self._pending.pop(number).result()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.shutdown(cancel_futures=True)


@contextmanager
def dedicated_process() -> Iterator[None]:
    """Process-wide settings under which mapping and prefetching run fastest together.

    For programs that have the process to themselves, such as `saccade drive`; `run` changes no
    setting. Threads switch more often, and linear algebra runs in one thread, since more would
    compete with the prefetching. Both settings are restored at the end.
    """
    interval = sys.getswitchinterval()
    sys.setswitchinterval(min(interval, SWITCH_INTERVAL))
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        sys.setswitchinterval(interval)


def track(
    camera: Camera,
    previous: PreparedFrame,
    current: PreparedFrame,
    tracked: TrackedPoints,
    prior: Prior,
    config: VisualConfig,
) -> tuple[TrackedPoints, Motion | None]:
    """Track points into a frame, and estimate the egomotion from them.

    Args:
        camera: the calibration.
        previous: the last frame that was not blank.
        current: the frame.
        tracked: points of `previous`.
        prior: the expected control.
        config: standard deviations of pixels and depths.

    Returns:
        The inliers of the motion in `current`, with their depths where it measures them, and
        the motion. Where no motion is found: no points, since nothing verifies them, and None.
    """
    if current.frame.tracks is not None:
        tracks = current.frame.tracks
        _, old, new = np.intersect1d(tracked.track, tracks.id, return_indices=True)
        tracked, xy = tracked[old], tracks.xy[new].astype(np.float32)
        depth = depth_of(camera, tracks.disparity[new])
    elif current.left is not None and previous.left is not None:
        image = match_brightness(current, previous)
        xy, ok = track_points(previous.left, image, tracked.xy)
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
    if motion is None:
        return TrackedPoints(), None
    moved = replace(tracked, xy=xy, depth=depth, depth_sigma=sigma)
    return moved[motion.inliers], motion
