"""The map of a drive: the filter, its landmarks, and how the camera observes them."""

import numpy as np
from scipy.linalg import block_diag

from saccade.frames import CameraTurn, Drive
from saccade.io.checkpoint import Checkpointed
from saccade.slam.config import EkfConfig
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.models import PredictedObservations
from saccade.slam.models import difference
from saccade.slam.online import Slam
from saccade.slam.scans import NO_SCAN, Scan
from saccade.types import BoolArray, FloatArray, IntArray
from saccade.visual.camera import observe, observe_bearings
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import MotionEstimate
from saccade.visual.motion_prior import Planarity, correlation_factor
from saccade.visual.optical_flow import ByteArray
from saccade.visual.tables import Landmarks, RangeBearings, TrackedPoints

MIN_RESCALE = 1e-3
"""Relative change of scale from which the map is rescaled: a tenth of the scale's uncertainty."""


class VisualMap(Checkpointed):
    """EKF-SLAM over the landmarks of a drive, whose camera measures their ranges.

    Args:
        drive: start, camera and odometry.
        config: standard deviations and budget.
        planarity: tilt of the robot.
    """

    measures_range = True
    """Whether an observation tells the range of a landmark."""

    def __init__(self, drive: Drive, config: VisualConfig, planarity: Planarity) -> None:
        self._drive, self._config, self._planarity = drive, config, planarity
        self.camera = drive.camera
        self._turn_sigma = 0.0
        self._scale = 1.0
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
        self.slam = Slam(settings, start=drive.start, odometry_bias=bias)
        """Steps the filter; the names of its landmarks are their ids."""
        self.landmarks = Landmarks()
        self.next_id = 0
        """Id of the next landmark."""

    def turn_camera(self, turn: CameraTurn | None) -> None:
        """Set how the camera is turned in the frames from now on."""
        self.camera = self._drive.camera.turned(turn)
        self._turn_sigma = 0.0 if turn is None else turn.sigma

    @property
    def ekf(self) -> EkfSlam:
        """The filter, to read."""
        return self.slam.ekf

    def move(self, number: int, control: MotionEstimate) -> None:
        """Predict the pose of a frame by a control (3,) with covariance (3, 3)."""
        self.slam.process(Scan(float(self._drive.time[number]), control, *NO_SCAN))

    def rescale(self, scale: float) -> None:
        """Let the map have a scale, with which it begins as 1."""
        change = scale / self._scale
        if abs(change - 1) > MIN_RESCALE:
            self.ekf.rescale(change, self._drive.start[:2])
            self._scale = scale

    def landmark_covariances(self, scale_sigma: float) -> FloatArray:
        """(n, 2, 2) of the landmarks, with an uncertainty of the map's scale as a fraction."""
        offset = self.ekf.landmarks - self._drive.start[:2]
        by_scale = scale_sigma**2 * offset[:, :, None] * offset[:, None]
        return np.asarray(self.ekf.landmark_covariances + by_scale)

    def observe(
        self, points: TrackedPoints, expected: PredictedObservations | None = None
    ) -> tuple[RangeBearings, BoolArray]:
        """Observations of k points, and (k,) whether each is usable: its range is certain.

        Args:
            points: the points.
            expected: observations of the landmarks that they are, if they are in the map.
        """
        return observe(self.camera, points, self._config, self._planarity.tilt)

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
        innovation = difference(observations.z, expected.z)
        S = expected.covariance + self._covariance(observations, 1)
        innovation[~reidentified], S[~reidentified] = np.nan, np.nan
        rows = self.landmarks.rows(points.landmark)
        if len(rows):
            R = self._covariance(observations, int(reidentified.sum()))
            if number > 0:  # observations of a track share the error of its first one
                seconds = float(self._drive.time[number] - self._drive.time[number - 1])
                R = R * correlation_factor(seconds, self._config)
            self.correct(rows[reidentified], observations.z[reidentified], R[reidentified])
            landmarks = self.landmarks
            landmarks.observations[rows] += 1
            landmarks.last_observed[rows] = number
            higher = observations.height - landmarks.height[rows]
            landmarks.height[rows] += higher / landmarks.observations[rows]
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
        ids = np.arange(self.next_id, self.next_id + k)
        self._observe(ids, observations.z, self._covariance(observations, 1))
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

    def joint_innovation(
        self, rows: IntArray, observations: RangeBearings
    ) -> tuple[FloatArray, FloatArray]:
        """Innovations (k, 2) of landmarks (k,), and their joint covariance (2k, 2k)."""
        z, S = self.ekf.predict_jointly(rows)
        fraction, bearing = self._shared_error_sigma
        shared = np.zeros((2, 2 * len(rows)))
        shared[0, ::2], shared[1, 1::2] = fraction * observations.z[:, 0], bearing
        return difference(observations.z, z), (
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


class BearingMap(VisualMap):
    """EKF-SLAM over the landmarks of a single camera: its ranges follow from the motion itself."""

    measures_range = False

    def observe(
        self, points: TrackedPoints, expected: PredictedObservations | None = None
    ) -> tuple[RangeBearings, BoolArray]:
        """Observations of k points; those of landmarks of the map are bearings alone."""
        if expected is None:
            return super().observe(points)
        bearings = observe_bearings(
            *(self.camera, points, expected.z[:, 0], self._config, self._planarity.tilt)
        )
        return bearings, np.ones(len(points), np.bool_)
