"""The map of a drive: the filter and its landmarks."""

import numpy as np
from scipy.linalg import block_diag

from saccade.frames import CameraTurn, Drive
from saccade.io.checkpoint import Arrays, attribute_arrays, merge, restore_attributes, select
from saccade.slam.config import EkfConfig
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.models import PredictedObservations
from saccade.slam.models import compose
from saccade.slam.online import Slam
from saccade.slam.scans import NO_SCAN, Scan
from saccade.types import BoolArray, FloatArray, IntArray
from saccade.visual.camera import observe, observe_bearings
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Egomotion, MotionEstimate
from saccade.visual.ground_scale import DISTANCE_NOISE
from saccade.visual.motion_prior import (
    Planarity,
    camera_error_covariance,
    correlation_factor,
    fuse,
)
from saccade.visual.odometry_model import OdometryModel
from saccade.visual.optical_flow import ByteArray
from saccade.visual.tables import Landmarks, RangeBearings, TrackedPoints

MIN_RESCALE = 1e-3
"""Relative change of scale from which the map is rescaled: a tenth of the scale's uncertainty."""


class VisualMap:
    """EKF-SLAM over the landmarks of a drive.

    Args:
        drive: start, camera and odometry.
        config: standard deviations and budget.
        has_depth: whether the frames measure depth.
    """

    def __init__(self, drive: Drive, config: VisualConfig, has_depth: bool) -> None:
        self._drive, self._config, self.has_depth = drive, config, has_depth
        self.camera = drive.camera
        self._turn_sigma = 0.0
        relative_sigma = config.relative_motion_sigma[0], config.relative_height_sigma
        self.odometry = OdometryModel(
            drive, has_depth, relative_sigma[0 if has_depth else 1], config.acceleration_sigma
        )
        self._map_scale = self.odometry.errors.factor
        settings = EkfConfig(
            filter="invariant",
            association="known",
            huber=config.huber,
            recover=False,
            submaps="never",
            start_sigma=(0.0, 0.0, 0.0),
        )
        by_wheels = config.egomotion == "wheels"
        bias = drive.odometry_bias if by_wheels else (0.0, 0.0, 0.0)
        self.slam = Slam(settings, start=drive.start, motion=compose, odometry_bias=bias)
        """Steps the filter; the names of its landmarks are their ids."""
        self.landmarks = Landmarks()
        self._next_id = 0
        self.planarity = Planarity(float(np.radians(config.tilt_sigma)))
        self.control: MotionEstimate = np.zeros(3), np.zeros((3, 3))
        """The control that led to the present frame, and its covariance."""

    def to_arrays(self) -> Arrays:
        """The state as named arrays, for a checkpoint."""
        parts = {name: attribute_arrays(part) for name, part in self._parts().items()}
        parts |= {"slam": self.slam.to_arrays(), "landmarks": attribute_arrays(self.landmarks)}
        return attribute_arrays(self) | merge(parts)

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore the state from the arrays of `to_arrays`."""
        restore_attributes(self, arrays)
        self.slam.from_arrays(select(arrays, "slam"))
        self.landmarks = Landmarks(**select(arrays, "landmarks"))
        for name, part in self._parts().items():
            restore_attributes(part, select(arrays, name))

    def _parts(self) -> dict[str, object]:
        return {
            "tilt": self.planarity,
            "odometry": self.odometry,
            "motion_prior": self.odometry.motion_prior,
            "odometry_errors": self.odometry.errors,
        }

    def turn_camera(self, turn: CameraTurn | None) -> None:
        """Set how the camera is turned in the frames from now on."""
        self.camera = self._drive.camera.turned(turn)
        self._turn_sigma = self.odometry.turn_sigma = 0.0 if turn is None else turn.sigma

    @property
    def ekf(self) -> EkfSlam:
        """The filter, to read."""
        return self.slam.ekf

    @property
    def next_id(self) -> int:
        """Id of the next landmark."""
        return self._next_id

    def predict(
        self,
        number: int,
        expected: MotionEstimate,
        motion: Egomotion | None,
        adjusted: MotionEstimate | None = None,
    ) -> None:
        """Predict the pose of a frame after the first.

        Args:
            number: of the frame.
            expected: result of `OdometryModel.predict`, used where there is nothing else.
            motion: egomotion by the camera, if any.
            adjusted: control and covariance by the sliding window, which includes odometry.
        """
        seconds = self._seconds(number)
        if motion is not None:
            self.planarity.update(motion.off_plane, seconds)
            if adjusted is not None:
                motion = motion._replace(control=adjusted[0], covariance=adjusted[1])
        if motion is None and adjusted is not None:
            control = adjusted  # the window knows the errors of odometry
        else:
            control = self.measured(expected, motion, seconds)
        if motion is not None and adjusted is None:
            self.odometry.learn(control)
            if self.has_depth:
                control = fuse(control, self.odometry.last)
        self._move(number, control)

    def measured(
        self, expected: MotionEstimate, motion: Egomotion | None, seconds: float
    ) -> MotionEstimate:
        """The last step by the camera, as expected where it failed.

        Its covariance includes errors of the calibration and tilt, or those of odometry.
        """
        if motion is None:
            return self.odometry.with_systematic_errors(expected)
        tilt = self.planarity.tilt
        return motion.control, camera_error_covariance(motion, seconds, self._config, tilt)

    def predict_by_odometry(self, number: int) -> None:
        """Predict the pose of a frame after the first by odometry; its biases are estimated."""
        drive = self._drive
        self._move(number, (drive.control[number - 1], drive.control_covariance[number - 1]))

    def _move(self, number: int, control: MotionEstimate) -> None:
        """Move the robot to the pose of a frame by a control (3,) with covariance (3, 3)."""
        self.control = control
        self.slam.process(Scan(float(self._drive.time[number]), control, *NO_SCAN))

    def apply_ground_distance(self, motion: Egomotion, distance: float) -> Egomotion:
        """Update the scale of odometry by a distance over the ground in metres.

        Rescales the map, and returns the motion with a length from odometry and the ground.
        """
        factor = self.odometry.errors.factor
        ratio = distance / float(np.linalg.norm(motion.translation))
        self.odometry.errors.update_scale(ratio)
        change = self.odometry.errors.factor / factor
        rescaling = self.odometry.errors.factor / self._map_scale
        if abs(rescaling - 1) > MIN_RESCALE:
            self.ekf.rescale(rescaling, self._drive.start[:2])
            self._map_scale = self.odometry.errors.factor
        length = float(np.hypot(*motion.control[:2]))
        direction = np.append(motion.control[:2] / length, 0.0)
        cross_covariance = motion.covariance @ direction
        variance = float(direction @ cross_covariance) + (DISTANCE_NOISE * length) ** 2
        innovation = (ratio / self.odometry.errors.camera_factor - change) * length
        control = motion.control + cross_covariance * innovation / variance
        covariance = motion.covariance - np.outer(cross_covariance, cross_covariance) / variance
        return motion._replace(
            control=control,
            translation=motion.translation * (float(np.hypot(*control[:2])) / length),
            covariance=(covariance + covariance.T) / 2,
        )

    def _seconds(self, number: int) -> float:
        return float(self._drive.time[number] - self._drive.time[number - 1])

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3) of the pose, with the uncertainty of a single camera's scale."""
        if self.has_depth:
            return self.ekf.pose_covariance
        sigma = self.odometry.errors.scale_sigma
        by_scale = sigma * np.append(self.ekf.pose[:2] - self._drive.start[:2], 0.0)
        return self.ekf.pose_covariance + np.outer(by_scale, by_scale)

    @property
    def landmark_covariances(self) -> FloatArray:
        """(n, 2, 2) of the landmarks, with the uncertainty of a single camera's scale."""
        if self.has_depth:
            return self.ekf.landmark_covariances
        offset = self.ekf.landmarks - self._drive.start[:2]
        by_scale = self.odometry.errors.scale_sigma**2 * offset[:, :, None] * offset[:, None]
        return self.ekf.landmark_covariances + by_scale

    def observe(
        self, points: TrackedPoints, expected: PredictedObservations | None = None
    ) -> tuple[RangeBearings, BoolArray]:
        """Observations of k points, and (k,) whether each is usable: its range is certain.

        A single camera observes landmarks of the map, whose `expected` observations are given, by
        their bearing alone: its ranges follow from the motion itself.
        """
        camera, config, tilt = self.camera, self._config, self.planarity.tilt
        if expected is None or self.has_depth:
            return observe(camera, points, config, tilt)
        bearings = observe_bearings(camera, points, expected.z[:, 0], config, tilt)
        return bearings, np.ones(len(points), np.bool_)

    def predict_observations(self, rows: IntArray) -> PredictedObservations:
        """Predicted observations of landmarks (k,)."""
        z, covariance = self.ekf.predict_observations()
        return PredictedObservations(z[rows], covariance[rows])

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
        innovation = self.ekf.sensor.difference(observations.z, expected.z)
        S = expected.covariance + self._covariance(observations, 1)
        innovation[~reidentified], S[~reidentified] = np.nan, np.nan
        rows = self.landmarks.rows(points.landmark)
        if len(rows):
            R = self._covariance(observations, int(reidentified.sum()))
            if number > 0:  # observations of a track share the error of its first one
                R = R * correlation_factor(self._seconds(number), self._config)
            self.correct(rows[reidentified], observations.z[reidentified], R[reidentified])
            landmarks = self.landmarks
            landmarks.observations[rows] += 1
            landmarks.last_observed[rows] = number
            difference = observations.height - landmarks.height[rows]
            landmarks.height[rows] += difference / landmarks.observations[rows]
        return innovation, S

    def correct(self, rows: IntArray, z: FloatArray, R: FloatArray) -> None:
        """Update the filter by observations z (k, 2), R (k, 2, 2) of landmarks (k,)."""
        self._observe(self.landmarks.id[rows], z, R)

    def _observe(self, ids: IntArray, z: FloatArray, R: FloatArray) -> None:
        """Process observations of landmarks (k,) at the present pose; unknown ones are added."""
        if len(ids) > 0:
            self.slam.process(Scan(0.0, None, np.ascontiguousarray(z), R, ids))

    def initialize(
        self, observations: RangeBearings, descriptors: ByteArray, number: int
    ) -> IntArray:
        """Augment the map by the landmarks of k observations. Returns their ids (k,)."""
        k = len(observations)
        ids = np.arange(self._next_id, self._next_id + k)
        self._observe(ids, observations.z, self._covariance(observations, 1))
        new = Landmarks.zeros(
            k,
            id=ids,
            height=observations.height,
            descriptor=descriptors,
            observations=np.ones(k, np.int64),
            last_observed=np.full(k, number),
        )
        self._next_id += k
        self.landmarks = Landmarks.concatenate([self.landmarks, new])
        return new.id

    def joint_innovation(
        self, rows: IntArray, observations: RangeBearings
    ) -> tuple[FloatArray, FloatArray]:
        """Innovations (k, 2) of landmarks (k,), and their joint covariance (2k, 2k)."""
        z, S = self.ekf.predict_jointly(rows)
        fraction, bearing = self._shared_error_sigma
        shared = np.zeros((2, 2 * len(rows)))
        shared[0, ::2], shared[1, 1::2] = fraction * observations.z[:, 0], bearing
        return self.ekf.sensor.difference(observations.z, z), (
            S + shared.T @ shared + block_diag(*observations.covariance)
        )

    def enforce_budget(self, tracked: IntArray, number: int) -> None:
        """Remove the least useful landmarks beyond `max_landmarks`, but none that is tracked."""
        surplus = len(self.landmarks) - self._config.max_landmarks
        if surplus > 0:
            self.remove(self.landmarks.least_useful(surplus, tracked, number))

    def remove(self, rows: IntArray) -> None:
        """Remove landmarks by their rows, ascending."""
        self.slam.remove(rows)
        self.landmarks = self.landmarks[np.delete(np.arange(len(self.landmarks)), rows)]

    def _covariance(self, observations: RangeBearings, count: int) -> FloatArray:
        """(k, 2, 2) including the error that `count` observations of a frame share.

        Each gets `count` times its variance, so that together they carry the information of one.
        """
        fraction, bearing = self._shared_error_sigma
        shared = np.zeros_like(observations.covariance)
        shared[:, 0, 0] = count * np.square(fraction * observations.z[:, 0])
        shared[:, 1, 1] = count * bearing**2
        return observations.covariance + shared

    @property
    def _shared_error_sigma(self) -> tuple[float, float]:
        """Of the range, as a fraction of it, and of the bearing, in radians."""
        fraction, degrees = self._config.shared_error_sigma
        bearing = float(np.radians(degrees))
        return fraction, float(np.hypot(bearing, self._turn_sigma)) if self._turn_sigma else bearing
