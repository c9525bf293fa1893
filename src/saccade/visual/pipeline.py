"""Visual SLAM, frame by frame: detect, track, predict, update, associate, attend, initialize."""

from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from time import perf_counter
from typing import Self

import numpy as np

from saccade.errors import require
from saccade.frames import Drive, EndOfDrive, Frame
from saccade.slam import Recorder
from saccade.slam.consistency import normalized_squared
from saccade.slam.filter.predictions import PredictedObservations
from saccade.slam.filter.robot_models import compose
from saccade.tags import TagConfig, Tags, TagSightings
from saccade.threads import SERIAL_BLAS
from saccade.types import BoolArray, FloatArray, IntArray
from saccade.visual.config import VisualConfig
from saccade.visual.contradictions import StepSource
from saccade.visual.depth import first_frame, measures_depth
from saccade.visual.egomotion import Egomotion, MotionEstimate
from saccade.visual.frontend import FeatureExtractor, FrameFeatures, Prefetcher, extend, track
from saccade.visual.gaze_control import GazeControl
from saccade.visual.motion_errors import TOTAL_RELATIVE_SIGMA
from saccade.visual.motion_estimator import MotionEstimator, StereoMotionEstimator
from saccade.visual.optical_flow import PreparedFrame, is_unrelated
from saccade.visual.points import RangeBearings, TrackedPoints
from saccade.visual.reidentification import count_rematches, reidentify
from saccade.visual.relocalization import Relocalization
from saccade.visual.result import ObservationKind, RunLog, VisualResult
from saccade.visual.robot_motion import camera_motion, robot_motion
from saccade.visual.selection import saliency_at, select_landmarks
from saccade.visual.single_camera import SingleCameraMotionEstimator
from saccade.visual.tag_landmarks import TagLandmarks, require_tags, with_labels
from saccade.visual.unscaled_camera import UnscaledCameraMotionEstimator
from saccade.visual.visual_map import VisualMap

MIN_TRACKED_FRACTION = 0.4
"""Minimum number of tracked points of a turning camera, as a fraction of `max_tracks`; with fewer,
new points are detected ahead of time."""
MIN_TURN = 0.05
"""Minimum turn of a camera between two frames for an early detection, in radians."""

MAX_HELD = 3
"""Maximum number of successive frames that are left out while points are held."""
MIN_HELD_POINTS = 20
"""Minimum number of points that are held."""
SLIP_GATE = 20.0
"""Largest normalized innovation squared of a tracked landmark; others slipped off theirs."""


@SERIAL_BLAS
def run(
    drive: Drive,
    config: VisualConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    recorder: Recorder | None = None,
    gaze: GazeControl | None = None,
    tags: TagConfig | None = None,
) -> VisualResult:
    """Run visual SLAM on a drive.

    Args:
        drive: frames and odometry.
        config: the settings.
        progress: called with the number of frames done and of all frames.
        recorder: takes snapshots of the map while it grows.
        gaze: turns the camera after each frame.
        tags: family and size of tags that are landmarks, too.

    Returns:
        Trajectory, map and observations.

    Raises:
        DriveError: no frame can be used, or images have another size than the calibration.
    """
    config = config or VisualConfig()
    with Pipeline(drive, config, gaze, tags) as pipeline:
        for number in range(len(drive)):
            try:
                pipeline.step(number)
            except EndOfDrive:
                break
            if recorder is not None:
                tracked = pipeline.tracked.landmarks.landmark
                recorder.add(
                    *(number, len(drive), pipeline.map.slam, tracked),
                    hypotheses=pipeline.relocalization.hypotheses,
                    covariance=pipeline.pose_covariance,
                )
            if progress is not None:
                progress(number + 1, len(drive))
        return pipeline.result()


class Pipeline:
    """Visual SLAM over the frames of a drive, whose camera a gaze may turn after each.

    A context manager: the thread that reads the next frames and detects their points ends with it.
    """

    def __init__(
        self,
        drive: Drive,
        config: VisualConfig,
        gaze: GazeControl | None = None,
        tags: TagConfig | None = None,
    ) -> None:
        if tags is not None:
            require_tags(drive, tags)
        first = first_frame(drive)
        self.drive, self.config = drive, config
        has_depth = any(measures_depth(drive.camera, frame) for frame in first.values())
        by_camera, found = config.egomotion == "camera", config.egomotion
        require(has_depth or by_camera, "egomotion", "camera where depth is not measured", found)
        self.motion = motion_estimator(drive, has_depth, by_camera)(drive, config)
        self.map = VisualMap(drive, config, self.motion)
        self.relocalization = Relocalization(self.map, config)
        self.tracked = TrackedPoints()
        self.features = FrameFeatures(PreparedFrame(Frame(float(drive.time[0]))))
        """The last frame, and the points detected in it."""
        self.control: MotionEstimate = np.zeros(3), np.zeros((3, 3))
        """The control that led to the last frame, and its covariance."""
        self.log = RunLog(drive)
        detector = None if tags is None else Tags(tags)
        self._extract = FeatureExtractor(drive, config, first, gaze is not None, detector)
        self.tags = TagLandmarks(self.map)
        """Tags in the map."""
        ahead = config.detect_interval if gaze is None else 0
        self._features = Prefetcher(self._extract, len(drive), ahead)
        self._gaze = gaze
        self._previous = self.features.frame  # the last one that was not blank
        self._skipped = list[MotionEstimate]()  # controls since then, while its points are held

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._features.__exit__()

    def step(self, number: int) -> None:
        """Process a frame: detect, track, predict, update, associate, attend, initialize."""
        start, previous_pose, was_lost = perf_counter(), self.map.ekf.pose, self.relocalization.lost
        features = self._features(number)
        self.log.remarks.extend(features.remarks)
        frame = features.frame
        self.motion.turn_camera(frame.frame.turn)
        if number > 0:
            points, motion = len(self.tracked), self._move(number, frame)
            if self._skipped and not frame.is_blank:  # the image is dropped
                features = FrameFeatures(PreparedFrame(replace(frame.frame, image=None)))
                frame = features.frame
            if self.relocalization.add_motion(frame, motion, points, previous_pose):
                self.tracked = self.tracked.without_landmarks()
            features = self._detect_if_few(number, features)
        self.features, detected = features, features.detected
        if not self._skipped:
            self._update(number, ObservationKind.TRACKED, self.tracked.landmarks)
        if features.tags is not None:
            self._observe_tags(number, features.tags)
        scheduled = number % self.config.detect_interval == 0 and not self._skipped
        if detected is not None:
            has_descriptor = np.asarray(detected.descriptor.any(1))
            reidentified, described = TrackedPoints(), detected[has_descriptor]
            if len(described) and self.relocalization.lost:
                known = np.isfinite(described.depth).any()
                self.relocalization.search(described if known else self.tracked)
            elif len(described):
                reidentified = self._associate(described, frame)
                self._update(number, ObservationKind.REIDENTIFIED, reidentified)
            self.tracked = extend(self.tracked, detected, reidentified, self.config)
        if scheduled and not self.relocalization.lost:
            self._initialize(number, self._attend(number, frame))
        if self.relocalization.lost != was_lost:
            self.motion.restart()
        pose, seconds, lost = self.map.ekf.pose, perf_counter() - start, self.relocalization.lost
        others = self.motion.constant_errors(pose), self.relocalization.extra_covariance
        self.log.poses.append((pose, self.map.ekf.pose_covariance, *others, seconds, lost))
        self._previous = self._previous if frame.is_blank else frame
        if self._gaze is not None:
            time = float(self.drive.time[number])
            self._gaze.decide(time, features, self.map, self.tracked, self.config.egomotion)

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3) covariance of the pose with errors of calibration and kidnapping."""
        pose, covariance = self.map.ekf.pose, self.map.ekf.pose_covariance
        others = self.relocalization.extra_covariance + self.motion.constant_errors(pose)
        return covariance + others

    def result(self) -> VisualResult:
        """The result of the frames so far, smoothed by `VisualConfig.smooth`."""
        result = self.log.result(self.map)
        if self.config.smooth:
            result = self.log.smoothed(result, self.map)
        return with_labels(result, self.tags.labels)

    def _detect_if_few(self, number: int, features: FrameFeatures) -> FrameFeatures:
        """Detect points ahead of time if a turning camera has lost most of its points."""
        is_unscaled = self.drive.scale != "metric"  # each lost point makes its scale drift
        if features.detected is not None or (features.frame.frame.turn is None and not is_unscaled):
            return features
        before, now = (camera.rotation[:, 2] for camera in self.motion.cameras)
        turned = np.linalg.norm(now - before) > MIN_TURN
        many = len(self.tracked) > MIN_TRACKED_FRACTION * self.config.max_tracks
        leaves = self._gaze is not None and self._gaze.is_leaving
        if many and not turned and not leaves:
            return features
        return self._extract.detect(features, number)

    def _move(self, number: int, frame: PreparedFrame) -> Egomotion | None:
        """Track points into a frame, and predict its pose; returns the egomotion.

        The points are held over a few frames that are blank or contradict their neighbors, and
        tracked into the next frame.
        """
        odometry, before, model = self.motion.predict(number), self.tracked, self.motion
        self.tracked, motion, source = track(
            *(self.drive.camera, self._previous, frame, before),
            self._since_previous(odometry),
            self.config,
            None if model.expectation is None else self._since_previous(model.expectation),
            has_odometry=self.drive.has_odometry,
            objects_seen=self.log.objects_seen,
        )
        last = before if not self._skipped else TrackedPoints()  # recorded when they were tracked
        if motion is not None:
            motion = self._since_last(model.scaled(motion, before, self.tracked))
        measured, is_bridged = model.measured(motion), motion is None and model.drift is not None
        self.control = model.step(motion, (last, self.tracked), (self.features.frame, frame))
        self.log.add_motion(self.control if is_bridged else measured, model.drift)
        if motion is None and self._holds(number, frame, before):
            source = source if frame.is_blank else StepSource.DROPPED
            self._skipped.append(self.control)
            self.tracked = before
        else:
            self._skipped.clear()
            self.tracked = model.with_depth(self.tracked)
        is_still = motion is not None and model.is_still
        self.log.sources.append(StepSource.STILL if is_still else source)
        self.log.scale_drift.append(model.scale_drift)
        self.map.rescale()
        self.map.predict(number, self.control)
        self.tags.predict(self.control)
        return motion

    def _since_previous(self, step: MotionEstimate) -> MotionEstimate:
        """The control from the frame of the held points, given the last step."""
        total, covariance = np.zeros(3), np.zeros((3, 3))
        for control, noise in (*self._skipped, step):
            total, Fx, Fu = compose(total, control)
            covariance = Fx @ covariance @ Fx.T + Fu @ noise @ Fu.T
        return total, covariance

    def _since_last(self, motion: Egomotion) -> Egomotion:
        """The egomotion from the last frame, given that from the frame of the held points."""
        if not self._skipped:
            return motion
        between = self._since_previous((np.zeros(3), np.zeros((3, 3))))[0]
        start = self.drive.camera.turned(self._previous.frame.turn)
        last, now = self.motion.cameras
        R, t = camera_motion(last, between, start)
        rotation = motion.rotation @ R.T
        translation = motion.translation - rotation @ t
        control, off_plane, _ = robot_motion(now, rotation, translation, last)
        return motion._replace(
            control=control, off_plane=off_plane, rotation=rotation, translation=translation
        )

    def _holds(self, number: int, frame: PreparedFrame, points: TrackedPoints) -> bool:
        """Whether the points of the last frame are tracked into the next frame instead.

        An image is left out if it contradicts the images before and after, which are related.
        """
        left = MAX_HELD - len(self._skipped)
        if left <= 0 or len(points) < MIN_HELD_POINTS:
            return False
        if frame.is_blank or not is_unrelated(self._previous, frame):
            return frame.is_blank
        return any(
            not each.frame.is_blank and not is_unrelated(self._previous, each.frame)
            for each in islice(self._features.ahead(number), left)
        )

    def _update(self, number: int, kind: ObservationKind, points: TrackedPoints) -> None:
        """Observe landmarks, and update the filter."""
        rows = self.map.landmarks.rows(points.landmark)
        expected = self.map.predict_observations(rows)
        observations, usable = self.map.observe(points, expected)
        if kind == ObservationKind.TRACKED:
            usable &= ~self._release(points, observations, expected)
        points, observations = points[usable], observations[usable]
        expected = PredictedObservations(expected.z[usable], expected.covariance[usable])
        innovation = self.map.update(points, observations, expected, number)
        self.log.add_observations(number, kind, points, observations, innovation)

    def _observe_tags(self, number: int, seen: TagSightings) -> None:
        """Observe the tags in a frame, or search a lost robot by them."""
        self.relocalization.by_tags = len(self.tags.labels) > 1
        if not self.relocalization.lost:
            if self.tags.observe(number, seen, self.log):
                self.relocalization.contradict()
                self.tracked = self.tracked.without_landmarks()
            elif self.tags.agree:
                self.relocalization.confirm()
        elif (found := self.tags.locate(seen)) is not None:
            self.relocalization.locate(*found)
            self.tags.end_search()

    def _release(
        self, points: TrackedPoints, observations: RangeBearings, expected: PredictedObservations
    ) -> BoolArray:
        """Release tracked points (k,) that slipped off their landmarks; returns which they are."""
        slipped = normalized_squared(*self.map.innovations(observations, expected)) > SLIP_GATE
        slipped &= points.reidentified  # others do not correct the pose
        gone = np.isin(self.tracked.landmark, points.landmark[slipped])
        self.tracked.landmark[gone], self.tracked.reidentified[gone] = -1, False
        return slipped

    def _associate(self, detected: TrackedPoints, frame: PreparedFrame) -> TrackedPoints:
        """Re-identify lost landmarks; returns the points that are."""
        config, landmarks = self.config, self.map.landmarks
        if config.selection == "rematch-rate-range":
            self.tracked = count_rematches(self.tracked, detected, config.ratio)
        detected = detected[~detected.near(self.tracked.landmarks, config.min_spacing / 2)]
        found = reidentify(detected, self.map, self.tracked, frame, config)
        count, landmark = len(found.rows), landmarks.id[found.rows]
        if self.relocalization.add_landmarks(len(found.missed) + count, count, found.elsewhere):
            self.tracked = self.tracked.without_landmarks()
            return TrackedPoints()
        landmarks.missed[found.missed] += 1
        self.log.missed += len(found.missed)
        reidentified = np.ones(count, np.bool_)
        return replace(found.points, landmark=landmark, reidentified=reidentified)

    def _attend(self, number: int, frame: PreparedFrame) -> IntArray:
        """(m,) indices of the tracked points that become landmarks."""
        tracked, config = self.tracked, self.config
        saliency = saliency_at(frame.frame.image, tracked, config)
        observations, usable = self.map.observe(tracked)
        return select_landmarks(tracked, observations, usable, saliency, config, number)

    def _initialize(self, number: int, chosen: IntArray) -> None:
        """Initialize landmarks from tracked points (m,), within the budget of the map."""
        points = self.tracked[chosen]
        observations, _ = self.map.observe(points)
        landmark = self.tracked.landmark.copy()
        landmark[chosen] = self.map.initialize(observations, points.descriptor, number)
        points = replace(points, landmark=landmark[chosen])
        self.tracked.reidentified[chosen] = self.config.egomotion != "camera"
        self.map.enforce_budget(landmark[landmark >= 0])
        removed = (landmark >= 0) & (self.map.landmarks.rows(landmark) < 0)
        self.tracked = replace(self.tracked, landmark=landmark)[~removed]
        self.log.add_observations(number, ObservationKind.INITIALIZED, points, observations)


def motion_estimator(drive: Drive, has_depth: bool, by_camera: bool) -> type[MotionEstimator]:
    """The kind of motion estimator for a drive, whose camera measures depth or does not."""
    if not by_camera:
        return MotionEstimator
    if has_depth:
        return StereoMotionEstimator
    is_scaled = drive.scale == "metric"
    return SingleCameraMotionEstimator if is_scaled else UnscaledCameraMotionEstimator


@SERIAL_BLAS
def measure_odometry(drive: Drive, second: Drive, config: VisualConfig | None = None) -> Drive:
    """A drive whose odometry is measured by a second camera, with the odometry of that camera's.

    Args:
        drive: of the camera that turns.
        second: the same drive by the second camera, with frames at the same times.
        config: settings of the egomotion of the second camera; it maps no landmarks.

    Returns:
        The drive, to be mapped with `VisualConfig(egomotion="second-camera")`.
    """
    settings = replace(
        config or VisualConfig(),
        egomotion="camera",
        new_per_frame=0,
        relative_motion_sigma=TOTAL_RELATIVE_SIGMA,
    )
    steps = []
    with Pipeline(second, settings) as pipeline:
        for number in range(len(second)):
            pipeline.step(number)
            steps.append(pipeline.control)
    control, covariance = (np.array(each) for each in zip(*steps[1:], strict=True))
    unbiased = (0.0, 0.0, 0.0)  # the covariances include calibration errors
    return replace(drive, control=control, control_covariance=covariance, odometry_bias=unbiased)
