"""The map of a drive: the filter, its landmarks, and how the camera observes them."""

import numpy as np

from saccade.frames import Camera, Drive
from saccade.slam.config import EkfConfig
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.predictions import PredictedObservations
from saccade.slam.filter.robot_models import as_relative_pose, difference
from saccade.slam.online import Slam
from saccade.slam.scans import NO_SCAN, Scan
from saccade.types import BoolArray, FloatArray, IntArray
from saccade.visual.camera import observe, observe_bearings
from saccade.visual.config import VisualConfig
from saccade.visual.depth import depth_sigma
from saccade.visual.egomotion import MotionEstimate
from saccade.visual.motion_errors import correlation_factor
from saccade.visual.motion_estimator import MotionEstimator
from saccade.visual.optical_flow import ByteArray
from saccade.visual.points import Landmarks, RangeBearings, TrackedPoints
from saccade.visual.smoothing import MapLog

MIN_RESCALE = 1e-3
"""Minimum relative change of scale for the map to be rescaled: a tenth of its uncertainty."""


class VisualMap:
    """EKF-SLAM over the landmarks of a drive; the motion estimator has the turned camera."""

    def __init__(self, drive: Drive, config: VisualConfig, motion: MotionEstimator) -> None:
        self._drive, self._config, self.motion = drive, config, motion
        self._scale = 1.0
        settings = EkfConfig(
            errors="invariant",
            association="known",
            huber=config.huber,
            recover=False,
            odometry_bias=(0.0, 0.0, 0.0),
            range_errors=(0.0, 0.0),  # the depths of a calibrated camera
            submaps="never",
            start_sigma=(0.0, 0.0, 0.0),
        )
        by_wheels = config.egomotion == "wheels"
        bias = drive.odometry_bias if by_wheels else (0.0, 0.0, 0.0)
        self.slam = Slam(settings, start=drive.start, odometry_bias=bias)
        """Steps the filter; the labels of its landmarks are their ids."""
        self.log = MapLog(settings, drive.start, bias)
        self.landmarks = Landmarks()
        self.next_id = 0
        """Id of the next landmark."""

    @property
    def camera(self) -> Camera:
        """The camera as it is turned in this frame."""
        return self.motion.cameras[1]

    @property
    def ekf(self) -> EkfSlam:
        """The filter, to read."""
        return self.slam.filter

    def predict(self, number: int, control: MotionEstimate) -> None:
        """Predict the pose of a frame by a control (3,) with covariance (3, 3)."""
        step = as_relative_pose(*control)
        self.slam.process(Scan(float(self._drive.time[number]), step, *NO_SCAN))
        self.log.motions.append(control)

    def rescale(self) -> None:
        """Let the map have the scale of the motion, with which it begins as 1."""
        change = self.motion.scale / self._scale
        if abs(change - 1) > MIN_RESCALE:
            self.ekf.rescale(change, self._drive.start[:2])
            self.log.rescale(change)
            self._scale = self.motion.scale

    @property
    def landmark_covariances(self) -> FloatArray:
        """(n, 2, 2) of the landmarks, with the uncertainty of the map's scale."""
        return self.ekf.landmark_covariances + self.scale_covariances(self.ekf.landmarks)

    def scale_covariances(self, xy: FloatArray) -> FloatArray:
        """(n, 2, 2) covariances of points (n, 2) by the uncertainty of the map's scale."""
        offset = xy - self._drive.start[:2]
        return np.asarray(self.motion.scale_sigma**2 * offset[:, :, None] * offset[:, None])

    def observe(
        self, points: TrackedPoints, expected: PredictedObservations | None = None
    ) -> tuple[RangeBearings, BoolArray]:
        """Observations of k points, and (k,) whether each is usable.

        `expected` are the predicted ones of the landmarks that they are, if they are in the map:
        points without a certain range then observe their bearing alone.
        """
        tilt = self.motion.planarity.tilt
        if expected is None:
            return observe(self.camera, points, self._config, tilt)
        bearings = observe_bearings(self.camera, points, expected.z[:, 0], self._config, tilt)
        if self.motion.measures_range:
            measured, usable = observe(self.camera, points, self._config, tilt)
            for name, values in vars(measured).items():
                getattr(bearings, name)[usable] = values[usable]
        return bearings, np.ones(len(points), np.bool_)

    def predict_observations(self, rows: IntArray) -> PredictedObservations:
        """Predicted observations of landmarks (k,)."""
        z, covariance = self.ekf.predict_observations()
        return PredictedObservations(z[rows], covariance[rows])

    def predict_jointly(self, rows: IntArray) -> PredictedObservations:
        """Predicted observations of landmarks (k,) in one frame.

        Their joint covariance (k, 2, k, 2) includes the error that all observations of a frame
        share.
        """
        z, S = self.ekf.predict_jointly(self.landmarks.id[rows])
        r = z[:, 0]
        S = S.reshape(len(z), 2, len(z), 2)
        S[:, 0, :, 0] += np.square(self._config.shared_range_sigma) * np.outer(r, r)
        S[:, 1, :, 1] += self._shared_bearing_sigma**2
        return PredictedObservations(z, S)

    @property
    def max_range(self) -> float:
        """Largest range of a landmark in meters that is certain enough to initialize it."""
        config, (_, far) = self._config, self._config.range_limits
        by_meter = float(depth_sigma(self.camera, np.ones(1), config)[0])  # a fraction at 1 m
        is_stereo = self.camera.baseline > 0
        return min(far, config.relative_range_sigma / by_meter) if is_stereo else far

    def innovations(
        self, observations: RangeBearings, expected: PredictedObservations
    ) -> tuple[FloatArray, FloatArray]:
        """Innovations (k, 2) of observations of landmarks, and their covariances (k, 2, 2)."""
        S = expected.covariance + self._covariance(observations, 1)
        return difference(observations.z, expected.z), S

    def sensor_sigma(self, ranges: FloatArray) -> FloatArray:
        """Standard deviations (k, 2) of ranges and bearings that are measured at ranges (k,)."""
        config, camera = self._config, self.camera
        by_range = depth_sigma(camera, ranges, config)
        bearing = np.hypot(
            config.pixel_sigma / camera.fx, np.radians(config.shared_bearing_sigma_deg)
        )
        return np.stack([by_range, np.full(len(ranges), bearing)], 1)

    def update(
        self,
        points: TrackedPoints,
        observations: RangeBearings,
        expected: PredictedObservations,
        number: int,
    ) -> tuple[FloatArray, FloatArray]:
        """Update the filter by k observations of landmarks.

        Only re-identified landmarks correct the filter: the pixels of those tracked ever since
        they were initialized have already been used by the egomotion.

        Returns:
            Innovations (k, 2) and their covariances (k, 2, 2), NaN where nothing was corrected.
        """
        reidentified = points.reidentified
        innovation, S = self.innovations(observations, expected)
        innovation[~reidentified], S[~reidentified] = np.nan, np.nan
        rows = self.landmarks.rows(points.landmark)
        if len(rows):
            # observations of a track share the error of its first one
            R = self._covariance(observations, int(reidentified.sum()))
            R *= correlation_factor(self.motion.seconds, self._config)
            ids, z = points.landmark[reidentified], observations.z[reidentified]
            self._observe(number, ids, z, R[reidentified])
            self.landmarks.count(rows, observations.height, number)
        return innovation, S

    def _observe(self, number: int, ids: IntArray, z: FloatArray, R: FloatArray) -> None:
        """Process observations of landmarks (k,) in a frame; unknown ones are added."""
        if len(ids) > 0:
            self.slam.process(Scan(0.0, None, np.ascontiguousarray(z), R, ids.tolist()))
            self.log.observations.append((number, ids, z, R))

    def initialize(
        self, observations: RangeBearings, descriptors: ByteArray, number: int
    ) -> IntArray:
        """Augment the map by the landmarks of k observations. Returns their ids (k,)."""
        k = len(observations)
        ids = np.arange(self.next_id, self.next_id + k)
        self._observe(number, ids, observations.z, self._covariance(observations, 1))
        new = Landmarks.zeros(
            k,
            id=ids,
            height=observations.height,
            descriptor=descriptors,
            observations=np.ones(k, np.int64),
            last_observed=np.full(k, number),
        )
        self.next_id += k
        self.landmarks = Landmarks.concatenate([self.landmarks, new])
        return new.id

    def enforce_budget(self, tracked: IntArray) -> None:
        """Remove the least useful landmarks beyond `max_landmarks`, but none that is tracked."""
        surplus = len(self.landmarks) - self._config.max_landmarks
        if surplus > 0:
            self.remove(self.landmarks.least_useful(surplus, tracked))

    def remove(self, rows: IntArray) -> None:
        """Remove landmarks by their rows, ascending."""
        self.slam.remove(self.landmarks.id[rows])
        self.landmarks = self.landmarks[np.delete(np.arange(len(self.landmarks)), rows)]

    def _covariance(self, observations: RangeBearings, count: int) -> FloatArray:
        """(k, 2, 2) including the error that `count` observations of a frame share.

        Each gets `count` times its variance, so that together they carry the information of one.
        """
        sigma = self._config.shared_range_sigma
        shared = np.zeros_like(observations.covariance)
        shared[:, 0, 0] = count * np.square(sigma * observations.z[:, 0])
        shared[:, 1, 1] = count * self._shared_bearing_sigma**2
        return observations.covariance + shared

    @property
    def _shared_bearing_sigma(self) -> float:
        """Standard deviation of the bearing error that the observations of a frame share."""
        calibration = np.radians(self._config.shared_bearing_sigma_deg)
        return float(np.hypot(calibration, self.motion.turn_sigma))
