"""Visual front end: reads frames ahead, detects points in them, and tracks points into them."""

import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Self, cast

import numpy as np

from saccade.attention.contrast import contrast_saliency
from saccade.errors import ImageError
from saccade.frames import Camera, Drive, EndOfDrive, Frame
from saccade.keypoints.sift import Sift
from saccade.keypoints.sift_config import SiftConfig
from saccade.tags import Tags, TagSightings
from saccade.types import Float32Array, Image, Keypoints
from saccade.visual.camera import is_inside, move_pixels
from saccade.visual.config import VisualConfig
from saccade.visual.contradictions import StepSource, choose_motion
from saccade.visual.depth import depth_of, depth_sigma, measure_depth, measures_depth
from saccade.visual.egomotion import (
    Egomotion,
    MotionEstimate,
    correspondences_of,
)
from saccade.visual.optical_flow import ByteArray, PreparedFrame, prepare_frame, track_frame
from saccade.visual.points import FIRST_ID, TrackedPoints
from saccade.visual.robot_motion import camera_motion

BORDER = 8
"""Width of the image border without tracked points, in pixels."""
MAX_UPSAMPLED = 320_000
"""Maximum size of an image that SIFT upsamples, in pixels. Larger images have enough points, and
detection takes a third of the time."""
SWITCH_INTERVAL = 5e-4
"""Switch interval of Python threads in seconds, a tenth of the default."""


@dataclass(frozen=True, eq=False)
class FrameFeatures:
    """A frame and the points detected in it."""

    frame: PreparedFrame
    detected: TrackedPoints | None = None
    """SIFT points; None in blank frames, and in frames without detection."""
    saliency: Float32Array | None = None
    """(h, w) contrast saliency, if points are detected and a gaze policy is used; else None."""
    remarks: tuple[str, ...] = ()
    """Reasons why the frame could not be read."""
    tags: TagSightings | None = None
    """Tags in the image; None if none are searched, and in blank frames."""


class FeatureExtractor:
    """Reads the frames of a drive, and detects points in every `detect_interval`-th frame.

    `read` are frames that have been read already, by number. With `attends` the saliency of frames
    with detected points is computed. `tags` detects the tags of every frame.
    """

    def __init__(
        self,
        drive: Drive,
        config: VisualConfig,
        read: Mapping[int, Frame] | None = None,
        attends: bool = False,
        tags: Tags | None = None,
    ) -> None:
        self._drive, self._config, self._attends, self._tags = drive, config, attends, tags
        self._read = dict(read or {})
        upsampled = drive.camera.width * drive.camera.height <= MAX_UPSAMPLED
        self._sift = Sift(
            SiftConfig(
                max_keypoints=config.max_points,
                contrast_threshold=0.016,
                ranking="response",  # the ranking with which drives were measured
                spread=True,
                first_octave=-1 if upsampled else 0,
            )
        )

    def __call__(self, number: int) -> FrameFeatures:
        """A frame and its detected points; a blank frame if it cannot be read."""
        try:
            frame = self._read.pop(number, None) or self._drive.load(number)
        except ImageError as error:
            blank = PreparedFrame(Frame(float(self._drive.time[number])))
            return FrameFeatures(blank, remarks=(str(error),))
        features = FrameFeatures(prepare_frame(frame, self._drive.camera))
        if self._tags is not None and features.frame.left is not None:
            found = self._tags(features.frame.left, self._drive.camera.turned(frame.turn))
            features = replace(features, tags=found)
        scheduled = number % self._config.detect_interval == 0
        return self.detect(features, number) if scheduled or frame.tracks is not None else features

    def detect(self, features: FrameFeatures, number: int) -> FrameFeatures:
        """Adds the points detected in a frame."""
        points, image = self._detect(features.frame, number), features.frame.frame.image
        attends = self._attends and points is not None and image is not None
        saliency = contrast_saliency(cast("Image", image)).saliency if attends else None
        return replace(features, detected=points, saliency=saliency)

    def _detect(self, prepared: PreparedFrame, number: int) -> TrackedPoints | None:
        """Points detected in a frame, without landmark ids; None if the frame is blank."""
        tracks, camera = prepared.frame.tracks, self._drive.camera
        if tracks is not None:
            points, track = Keypoints.at(tracks.xy, 1.0), tracks.id
            descriptors = tracks.descriptor
            if descriptors is None:
                descriptors = np.zeros((len(tracks), 128), np.uint8)
            depth = depth_of(camera, tracks.disparity)
            sigma = depth_sigma(camera, depth, self._config)
        elif prepared.left is not None:
            points = self._sift(prepared.left)
            _, first = np.unique(points.xy, axis=0, return_index=True)
            points = points[np.sort(first)]  # one of several orientations
            descriptors, track = cast("ByteArray", points.descriptors), np.full(len(points), -1)
            depth, sigma = measure_depth(camera, prepared, points.xy, self._config)
        else:
            return None
        return TrackedPoints.zeros(
            len(points),
            xy=points.xy,
            depth=depth,
            depth_sigma=sigma,
            landmark=np.full(len(points), -1),
            id=FIRST_ID * number + np.arange(len(points)),
            track=track,
            first_xy=points.xy,
            size=points.size,
            response=points.response,
            descriptor=descriptors,
        )


class Prefetcher:
    """Computes frames 0 to `count` - 1 in another thread, up to `ahead` frames in advance.

    A context manager that owns the thread.
    """

    def __init__(self, compute: Callable[[int], FrameFeatures], count: int, ahead: int) -> None:
        self._compute, self._count, self._ahead = compute, count, ahead
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="saccade-prefetch")
        self._pending: dict[int, Future[FrameFeatures]] = {}

    def __call__(self, number: int) -> FrameFeatures:
        """Frame by number; raises the exceptions of its computation."""
        for i in range(number, min(number + 1 + self._ahead, self._count)):
            if i not in self._pending:
                self._pending[i] = self._thread.submit(self._compute, i)
        return self._pending.pop(number).result()

    def ahead(self, number: int) -> Iterator[FrameFeatures]:
        """The frames after a number that are computed in advance, up to the end of the drive."""
        for i in range(number + 1, min(number + 1 + self._ahead, self._count)):
            try:
                yield self._pending[i].result()
            except EndOfDrive:
                return

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.shutdown(cancel_futures=True)


@contextmanager
def dedicated_process() -> Iterator[None]:
    """Lets threads of the process switch more often, for mapping together with prefetching.

    For programs that own their process, such as `saccade drive`; `run` itself changes only the
    number of BLAS threads. The setting is restored at the end.
    """
    interval = sys.getswitchinterval()
    sys.setswitchinterval(min(interval, SWITCH_INTERVAL))
    try:
        yield
    finally:
        sys.setswitchinterval(interval)


def track(
    camera: Camera,
    previous: PreparedFrame,
    current: PreparedFrame,
    tracked: TrackedPoints,
    prior: MotionEstimate,
    config: VisualConfig,
    expected: MotionEstimate | None,
    *,
    has_odometry: bool,
    objects_seen: bool,
) -> tuple[TrackedPoints, Egomotion | None, StepSource]:
    """Tracks the points of the last frame that was not blank, and estimates the egomotion.

    Args:
        camera: the camera as mounted.
        previous: the last frame that was not blank.
        current: the frame to track into.
        tracked: points in `previous`.
        prior: control from there by odometry.
        config: the settings.
        expected: control that the motion is compared with, see `choose_motion`.
        has_odometry: whether `expected` is measured.
        objects_seen: see `choose_motion`.

    Returns:
        The points in `current` that agree with the motion, with depths if measured; the motion; and
        its source. Without a motion there are no points, since nothing verifies them.
    """
    none = StepSource.ODOMETRY if has_odometry else StepSource.UNKNOWN
    before, camera = (camera.turned(each.frame.turn) for each in (previous, current))
    if current.frame.tracks is not None:
        tracks = current.frame.tracks
        _, old, new = np.intersect1d(tracked.track, tracks.id, return_indices=True)
        tracked, xy = tracked[old], tracks.xy[new].astype(np.float32)
        depth = depth_of(camera, tracks.disparity[new])
        sigma = depth_sigma(camera, depth, config)
    elif current.left is not None and previous.left is not None:
        guess = None
        if previous.frame.turn != current.frame.turn:
            pose = camera_motion(camera, prior[0], before)
            guess = move_pixels(camera, pose, tracked.xy, tracked.depth)
        xy, ok = track_frame(previous, current, tracked.xy, guess)
        ok &= is_inside(camera, xy, BORDER)
        tracked, xy = tracked[ok], xy[ok]
        depth, sigma = measure_depth(camera, current, xy, config, tracked.depth)
    else:
        return TrackedPoints(), None, none
    has_depth = measures_depth(camera, current.frame)
    previous_depth = tracked.depth if has_depth else np.full(len(tracked), np.nan)
    points = correspondences_of(tracked.xy, xy, previous_depth, tracked.depth_sigma, depth, sigma)
    motion, source = choose_motion(
        *(camera, points, config.pixel_sigma),
        None if has_depth and current.frame.turn is None else prior,
        expected,
        before,
        has_odometry=has_odometry,
        objects_seen=objects_seen,
    )
    if motion is None:
        return TrackedPoints(), None, source
    tracked = replace(tracked, xy=xy, depth=depth, depth_sigma=sigma)
    return tracked[motion.inliers], motion, source


def extend(
    tracked: TrackedPoints,
    detected: TrackedPoints,
    reidentified: TrackedPoints,
    config: VisualConfig,
) -> TrackedPoints:
    """Adds re-identified landmarks and the strongest detected points to the tracked points.

    Re-identified landmarks replace tracked points nearby.
    """
    radius = config.min_spacing / 2
    others = tracked[~tracked.near(reidentified, radius)]
    tracked = TrackedPoints.concatenate([others, reidentified])
    new = detected[~detected.near(tracked, radius)]
    capacity = max(0, config.max_tracks - len(tracked))
    strongest = np.argsort(-new.response, kind="stable")[:capacity]
    return TrackedPoints.concatenate([tracked, new[strongest]])
