"""The whole chain: attend, detect, track, observe, associate, update, and manage the map."""

from collections.abc import Callable
from dataclasses import fields, replace
from time import perf_counter

import numpy as np
import numpy.typing as npt

from saccade.frames import Drive, Frame
from saccade.pyramid import FloatMap
from saccade.slam.checkpoint import (
    Arrays,
    Checkpoint,
    Stateful,
    attribute_arrays,
    merge,
    restore_attributes,
    select,
)
from saccade.slam.results import PredictedObservations
from saccade.slam.snapshots import Recorder
from saccade.types import FloatArray, IntArray
from saccade.visual.camera import RangeBearings, is_inside, subset, to_pixels
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Motion, camera_motion
from saccade.visual.frame_features import FeatureCache, FrameAnalyzer
from saccade.visual.frontend import (
    PreparedFrame,
    TrackedPoints,
    observe,
    observe_bearing_only,
    provides_depth,
    track,
)
from saccade.visual.ground_scale import GroundTracker
from saccade.visual.prefetch import Prefetcher, shorter_switch_interval
from saccade.visual.reidentification import (
    ASIDE,
    TOLERANCE,
    consistent_layout,
    consistent_subset,
    count_rematches,
    descriptor_matches,
    enforce_spacing,
    within_gate,
)
from saccade.visual.result import VisualResult
from saccade.visual.run_log import INITIALIZED, REIDENTIFIED, TRACKED, RunLog
from saccade.visual.selection import rank_candidates
from saccade.visual.triangulation import CameraTrajectory
from saccade.visual.visual_map import VisualMap


def run(
    drive: Drive,
    config: VisualConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    recorder: Recorder | None = None,
    cache: FeatureCache | None = None,
    checkpoint: Checkpoint | None = None,
) -> VisualResult:
    """Map a drive.

    Args:
        drive: frames and odometry.
        config: how to look and to map.
        progress: called with the number of frames done and of all frames.
        recorder: takes snapshots of the map while it grows.
        cache: of earlier runs over the same frames.
        checkpoint: where the run saves itself, and goes on if it was interrupted.

    Returns:
        The way, the map, and what was seen of it when.

    Raises:
        DriveError: images that do not fit the calibration.
    """
    config = config or VisualConfig()
    pipeline = Pipeline(drive, config, cache)
    done = 0
    if checkpoint is not None:
        data = [getattr(drive, each.name) for each in fields(drive) if each.name != "load"]
        parts: dict[str, Stateful | None] = {"pipeline": pipeline, "recorder": recorder}
        done = checkpoint.resume((config, data), parts)
    with shorter_switch_interval():
        for number in range(done, len(drive)):
            pipeline.step(number)
            if recorder is not None:
                tracked = pipeline.tracked
                seen = pipeline.map.landmarks.rows(tracked.landmark[tracked.is_landmark])
                recorder.add(number, len(drive), pipeline.map.ekf, seen)
            if checkpoint is not None:
                checkpoint.save(number + 1, parts)
            if progress is not None:
                progress(number + 1, len(drive))
    return pipeline.result()


class Pipeline:
    """A drive on its way through the chain, frame by frame.

    Args:
        drive: frames and odometry.
        config: how to look and to map.
        memory: of earlier runs over the same frames.
    """

    def __init__(
        self, drive: Drive, config: VisualConfig, cache: FeatureCache | None = None
    ) -> None:
        self.drive, self.config = drive, config
        self.tracked = TrackedPoints()
        self.log = RunLog(drive)
        self.has_depth = provides_depth(drive)
        self.map = VisualMap(drive, config, self.has_depth)
        self._analyzer = FrameAnalyzer(drive, config, cache)
        self._features = Prefetcher(self._analyzer.features, len(drive), config.detect_interval)
        self._last = PreparedFrame(Frame(float(drive.time[0])))
        self._camera_trajectory = CameraTrajectory()
        self._ground = GroundTracker(drive.camera)

    def to_arrays(self) -> Arrays:
        """Its state as named arrays, for a checkpoint."""
        return merge(
            {
                "map": self.map.to_arrays(),
                "log": self.log.to_arrays(),
                "tracked": attribute_arrays(self.tracked),
                "camera_trajectory": attribute_arrays(self._camera_trajectory),
            }
        )

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        self.map.from_arrays(select(arrays, "map"))
        self.log.from_arrays(select(arrays, "log"))
        self.tracked = TrackedPoints(**select(arrays, "tracked"))
        restore_attributes(self._camera_trajectory, select(arrays, "camera_trajectory"))
        if self.log.last_visible >= 0:
            self._last = self._analyzer.features(self.log.last_visible).frame

    def step(self, number: int) -> None:
        """Go on by one frame."""
        log, visual_map, start = self.log, self.map, perf_counter()
        with log.timed("wait"):
            features = self._features(number)
        frame = log.add_features(features).frame
        before = visual_map.ekf.pose
        if number > 0:
            self._track_and_predict(number, frame)
        else:
            log.add_motion(np.zeros(3), None)
        with log.timed("update"):
            self._update(number, TRACKED, self.tracked[self.tracked.is_landmark])
        if features.detected is not None:
            self._reidentify_and_add(number, frame, features.detected)
        visual_map.update_motion_prior(number, before, len(self.tracked))
        log.add_pose(visual_map.ekf.pose, visual_map.pose_covariance, perf_counter() - start)
        if not frame.is_blank:
            self._last, log.last_visible = frame, number

    def result(self) -> VisualResult:
        """What has come of it so far."""
        return self.log.result(self.map)

    def _track_and_predict(self, number: int, frame: PreparedFrame) -> None:
        """Follow the points to a frame, and the robot with them."""
        log, visual_map, camera, config = self.log, self.map, self.drive.camera, self.config
        expected = visual_map.predict_motion(number)
        with log.timed("track"):
            self.tracked, motion = track(
                camera, self._last, frame, self.tracked, expected, config, self._analyzer.track
            )
            log.add_motion(expected[0], motion)
        with log.timed("road"):
            if motion is not None and not self.has_depth:
                motion = self._apply_ground_motion(frame, motion)
        with log.timed("predict"):
            visual_map.predict(number, expected, motion)
        if motion is None:
            self._camera_trajectory.append(*camera_motion(camera, expected[0]))
            return
        self._camera_trajectory.append(motion.rotation, motion.translation)
        if not self.has_depth:
            with log.timed("range"):
                points = self.tracked
                depth, sigma = self._camera_trajectory.triangulate(
                    camera, points.first_frame, points.first_xy, points.xy, config.pixel_sigma
                )
                self.tracked = replace(points, depth=depth, depth_sigma=sigma)

    def _apply_ground_motion(self, frame: PreparedFrame, motion: Motion) -> Motion:
        """The motion with what the road says of its length."""
        before = self._last.left
        if before is None or frame.left is None:
            return motion
        ground = self._ground.motion(before, frame.left, motion)
        return motion if ground is None else self.map.apply_ground_motion(motion, ground)

    def _reidentify_and_add(self, number: int, frame: PreparedFrame, found: TrackedPoints) -> None:
        """Find what is in view: landmarks that were lost from sight, and new ones."""
        log, visual_map, config = self.log, self.map, self.config
        with log.timed("associate"):
            if config.selection.startswith("rematch-rate") and frame.left is not None:
                self.tracked = count_rematches(self.tracked, found, config.ratio)
            found = found[
                ~_near(found, self.tracked[self.tracked.is_landmark], config.min_spacing / 2)
            ]
            pairs = self._reidentify(found)
            known = replace(
                found[pairs[:, 0]],
                landmark=visual_map.landmarks.id[pairs[:, 1]],
                reidentified=np.ones(len(pairs), np.bool_),
            )
        with log.timed("update"):
            self._update(number, REIDENTIFIED, known)
            others = self.tracked[~_near(self.tracked, known, config.min_spacing / 2)]
            self.tracked = others.concatenated(known)
        with log.timed("attend"):
            new = found[~_near(found, self.tracked, config.min_spacing / 2)]
            places = max(0, config.max_tracks - len(self.tracked))
            strongest = np.argsort(-new.response, kind="stable")[:places]
            self.tracked = self.tracked.concatenated(new[strongest])
            chosen = self._select(number, self._analyzer.saliency(frame, number))
        with log.timed("manage"):
            self._initialize(number, chosen)

    def _select(self, number: int, saliency: FloatMap | None) -> IntArray:
        """(m,) which of the followed points become landmarks."""
        config, camera, points = self.config, self.drive.camera, self.tracked
        seen, useful = self._observe(points)
        free = np.flatnonzero(useful & ~points.is_landmark)
        relative_sigma = np.sqrt(seen.covariance[free, 0, 0]) / seen.z[free, 0]
        shape = (camera.height, camera.width)
        taken = points.xy[points.is_landmark]
        order = free[
            rank_candidates(points[free], relative_sigma, saliency, shape, taken, config, number)
        ]
        places = max(0, config.max_tracked - int(points.is_landmark.sum()))
        count = min(config.new_per_frame * config.detect_interval, places)
        return enforce_spacing(points.xy, order, taken, config.min_spacing, count)

    def _initialize(self, number: int, chosen: IntArray) -> None:
        """Make landmarks of some of the followed points, and keep to the budget."""
        visual_map, points = self.map, self.tracked
        new = points[chosen]
        seen, _ = self._observe(new)
        landmark = points.landmark.copy()
        landmark[chosen] = visual_map.initialize(seen, new.descriptor, number)
        self.log.add_observations(number, INITIALIZED, landmark[chosen], new.xy, seen)
        self.tracked = replace(points, landmark=landmark)
        visual_map.enforce_budget(landmark[landmark >= 0], number)
        gone = (landmark >= 0) & (visual_map.landmarks.rows(landmark) < 0)
        self.tracked = self.tracked[~gone]

    def _reidentify(self, points: TrackedPoints) -> IntArray:
        """(m, 2) points and rows of the landmarks that they are."""
        visual_map, config = self.map, self.config
        rows = self._expected_in_view()
        if len(rows) == 0 or len(points) == 0:
            return np.zeros((0, 2), np.int64)
        known = visual_map.landmarks.descriptor[rows]
        pairs = descriptor_matches(points.keypoints, known, config.ratio)
        pairs[:, 1] = rows[pairs[:, 1]]
        expected = visual_map.predict_observations(pairs[:, 1])
        seen, useful = self._observe_expected(points[pairs[:, 0]], expected.z[:, 0])
        height = visual_map.landmarks.height[pairs[:, 1]]
        fits = useful & within_gate(seen, expected, height, config.gate)
        pairs, seen = pairs[fits], subset(seen, fits)
        tolerance = TOLERANCE if self.has_depth else ASIDE
        alike = consistent_layout(seen.z, visual_map.ekf.landmarks[pairs[:, 1]], tolerance)
        pairs, seen = pairs[alike], subset(seen, alike)
        pairs = pairs[
            consistent_subset(*visual_map.joint_innovation(pairs[:, 1], seen), config.gate)
        ]
        missed = rows[~np.isin(rows, pairs[:, 1])]
        visual_map.landmarks.missed[missed] += 1
        self.log.missed += len(missed)
        return pairs

    def _observe_expected(
        self, points: TrackedPoints, reach: FloatArray
    ) -> tuple[RangeBearings, npt.NDArray[np.bool_]]:
        """What is seen of landmarks that are expected at ranges (k,), and whether it is of use."""
        if self.has_depth:
            return self._observe(points)
        tilt = self.map.planarity.tilt
        seen = observe_bearing_only(self.drive.camera, points.xy, reach, self.config, tilt)
        return seen, np.ones(len(points), np.bool_)

    def _observe(self, points: TrackedPoints) -> tuple[RangeBearings, npt.NDArray[np.bool_]]:
        """Range and bearing of points, and whether each is of use."""
        tilt = self.map.planarity.tilt
        known = points.xy, points.depth, points.depth_sigma
        return observe(self.drive.camera, *known, self.config, tilt)

    def _expected_in_view(self) -> IntArray:
        """(m,) rows of landmarks that are not followed and should be in view."""
        visual_map, camera = self.map, self.drive.camera
        if len(visual_map.landmarks) == 0:
            return np.zeros(0, np.int64)
        z, S = visual_map.ekf.predict_observations()
        slack = 3 * np.sqrt(S[:, 1, 1])
        xyz = np.stack(
            [z[:, 0] * np.cos(z[:, 1]), z[:, 0] * np.sin(z[:, 1]), visual_map.landmarks.height], 1
        )
        xy, _ = to_pixels(camera, xyz)
        border = -camera.fx * np.tan(slack.clip(0, 1.5))
        inside = is_inside(camera, xy, np.maximum(border, -camera.width))
        inside &= z[:, 0] < self.config.range_limits[1] + 3 * np.sqrt(S[:, 0, 0])
        inside[visual_map.landmarks.rows(self.tracked.landmark)] = False
        return np.flatnonzero(inside)

    def _update(self, number: int, kind: int, points: TrackedPoints) -> None:
        expected = self.map.predict_observations(self.map.landmarks.rows(points.landmark))
        seen, useful = self._observe_expected(points, expected.z[:, 0])
        points, seen = points[useful], subset(seen, useful)
        expected = PredictedObservations(expected.z[useful], expected.covariance[useful])
        innovation = self.map.innovation(seen, expected, points.reidentified)
        self.map.observe(points.landmark, seen, points.reidentified, number)
        self.log.add_observations(number, kind, points.landmark, points.xy, seen, innovation)


def _near(points: TrackedPoints, others: TrackedPoints, radius: float) -> npt.NDArray[np.bool_]:
    """(n,) whether points are within some pixels of one of others."""
    if len(points) == 0 or len(others) == 0:
        return np.zeros(len(points), np.bool_)
    square = np.square(points.xy[:, None] - others.xy).sum(2)
    return np.asarray((square < radius**2).any(1))
