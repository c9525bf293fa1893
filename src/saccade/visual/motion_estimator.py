"""Motion of the robot from frame to frame, from odometry and the camera."""

from typing import TypeAlias

import numpy as np

from saccade.frames import CameraTurn, Drive
from saccade.types import FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Egomotion, MotionEstimate
from saccade.visual.motion_errors import (
    Planarity,
    camera_error_covariance,
    correlation_factor,
)
from saccade.visual.odometry_model import OdometryErrors
from saccade.visual.optical_flow import PreparedFrame
from saccade.visual.points import TrackedPoints
from saccade.visual.robot_motion import camera_motion
from saccade.visual.self_calibration import CalibrationDrift
from saccade.visual.window import SlidingWindow

PointPair: TypeAlias = tuple[TrackedPoints, TrackedPoints]
"""Points of the last frame, and the points tracked from there into the current frame."""
Frames: TypeAlias = tuple[PreparedFrame, PreparedFrame]
"""The last frame that was not blank, and the current frame."""

MIN_SCALE_SIGMA = 0.02
"""Minimum standard deviation of odometry's scale if the camera measures depth."""
MIN_TURN_BIAS_SIGMA = 0.02
"""Minimum initial standard deviation of odometry's turn rate bias, in rad/s."""


class MotionEstimator:
    """Motion by odometry alone; the camera only maps."""

    measures_range = True
    """Whether the camera measures depth. Otherwise odometry and an estimated scale determine the
    length of a step, and ranges of landmarks are triangulated."""
    drift: CalibrationDrift | None = None
    """Effect of calibration errors on the pose; None if they are not estimated."""

    def __init__(self, drive: Drive, config: VisualConfig) -> None:
        self._drive, self._config = drive, config
        _, turn_per_meter, _ = drive.odometry_bias
        seconds = float(drive.time[-1] - drive.time[0])
        distance = float(np.hypot(*drive.control[:, :2].T).sum())
        mean_speed = distance / seconds if seconds > 0 else 0.0
        turn_sigma = float(np.hypot(MIN_TURN_BIAS_SIGMA, turn_per_meter * mean_speed))
        self.errors = OdometryErrors(*self._scale_sigmas(), turn_sigma)
        self.planarity = Planarity(float(np.radians(config.tilt_sigma_deg)))
        self.cameras = drive.camera, drive.camera
        """The camera as it was turned in the last frame and in the current frame."""
        self.turn_sigma = 0.0
        """Standard deviation of the camera's pan and tilt in the current frame, in radians."""
        self.seconds = 0.0
        """Duration of the last step, in seconds."""
        self.declared_odometry: MotionEstimate = np.zeros(3), np.zeros((3, 3))
        """The last step by odometry."""
        self.corrected_odometry = self.declared_odometry
        """The same without its estimated systematic errors."""
        self.velocity: FloatArray | None = None
        """(3,) last step by the camera, per second; None if unknown."""
        self.is_still = False
        """Whether a camera without odometry did not move in the last step."""
        self.unknown_steps = 0
        """Number of steps since then that neither the camera nor odometry measured."""

    def turn_camera(self, turn: CameraTurn | None) -> None:
        """Sets the turn of the camera in the current frame."""
        self.cameras = self.cameras[1], self._drive.camera.turned(turn)
        self.turn_sigma = 0.0 if turn is None else turn.sigma

    def predict(self, number: int) -> MotionEstimate:
        """Control that odometry expects to lead to a frame after the first.

        Estimated systematic errors are corrected; the covariance is declared by the odometry.
        """
        drive, last = self._drive, number - 1
        self.seconds = float(drive.time[number] - drive.time[last])
        control, covariance = drive.control[last], drive.control_covariance[last]
        self.declared_odometry = control, covariance
        if self.turn_sigma:  # of both frames: the camera's turn is compared with odometry's
            covariance = covariance + np.diag([0.0, 0.0, 2 * self.turn_sigma**2])
        self.corrected_odometry = self.errors.corrected(control, self.seconds), covariance
        return self.corrected_odometry

    @property
    def expectation(self) -> MotionEstimate | None:
        """The last step by odometry, or else by the velocity before; None if neither is known.

        The covariance includes all systematic errors.
        """
        if self._drive.has_odometry:
            control, covariance = self.corrected_odometry
            J = self.errors.jacobian(control, self.seconds)
            return control, covariance + J @ self.errors.covariance @ J.T
        if self.velocity is None:
            return None
        speed, turn_rate = self._config.acceleration_sigma
        sigma = np.array([speed, speed, turn_rate]) * self.seconds * (1 + self.unknown_steps)
        return self.velocity * self.seconds, np.diag(np.square(sigma * self.seconds))

    def measured(self, motion: Egomotion | None) -> MotionEstimate:
        """The last step by the camera, or by odometry where there is no egomotion.

        The covariance includes errors of calibration and tilt, or systematic errors of odometry.
        """
        if motion is None:
            control, covariance = self.corrected_odometry
            has_scale = self.measures_range  # else it is an error of the whole trajectory
            systematic = self.errors.step_covariance(control, self.seconds, has_scale)
            return control, covariance + systematic
        covariance = camera_error_covariance(
            motion, self.seconds, self._config, self.planarity.tilt, self.measures_range
        )
        return motion.control, covariance

    def scaled(self, motion: Egomotion, before: TrackedPoints, after: TrackedPoints) -> Egomotion:
        """The egomotion, with a length from triangulated points where nothing measures it."""
        return motion

    def step(self, motion: Egomotion | None, points: PointPair, frames: Frames) -> MotionEstimate:
        """The control of the last step, by odometry and the egomotion, if any.

        The errors of successive steps without either are not independent, and add up: those of a
        velocity that changes at random, by which the k-th step counts with k times its variance;
        and those of a constant acceleration a, of which k steps of t seconds have the variance
        (a t^2 k^2 / 2)^2, k^3 times that of one step more than before.
        """
        control, covariance = self.combine(motion, points, frames)
        if motion is not None or self._drive.has_odometry:
            self.unknown_steps = 0
            self.velocity = control / self.seconds if self.seconds > 0 else self.velocity
            return control, covariance
        self.unknown_steps += 1
        k, (speed, turn_rate) = self.unknown_steps, self._config.acceleration_sigma
        by_acceleration = np.array([speed, speed / 4, turn_rate]) * self.seconds**2
        return control, covariance * k + np.diag(np.square(by_acceleration)) * k**3

    def combine(
        self, motion: Egomotion | None, points: PointPair, frames: Frames
    ) -> MotionEstimate:
        """Combines odometry with the egomotion, if any."""
        return self.declared_odometry

    @property
    def scale_drift(self) -> float:
        """Relative standard deviation of the present scale, where nothing measures lengths."""
        return 0.0

    def with_depth(self, points: TrackedPoints) -> TrackedPoints:
        """The tracked points, with triangulated depths if the camera measures none."""
        return points

    def restart(self) -> None:
        """Discards past motions, which do not predict the motion after a gap."""
        self.velocity = None

    def constant_errors(self, pose: FloatArray) -> FloatArray:
        """Covariance (3, 3) of a pose (3,) by errors that are constant over the drive."""
        return np.zeros((3, 3))

    @property
    def scale(self) -> float:
        """Scale of the motion relative to that at the start."""
        return 1.0 if self.measures_range else self.errors.factor

    @property
    def scale_sigma(self) -> float:
        """Relative standard deviation of the scale of the whole map."""
        return 0.0 if self.measures_range else self.errors.scale_sigma

    def _scale_sigmas(self) -> tuple[float, float]:
        """Relative standard deviations of the scales of odometry and camera."""
        if not self.measures_range:
            return self._drive.odometry_bias[0], self._config.relative_height_sigma
        by_odometry = float(np.hypot(self._drive.odometry_bias[0], MIN_SCALE_SIGMA))
        return by_odometry, self._config.relative_motion_sigma[0]


class StereoMotionEstimator(MotionEstimator):
    """Motion by odometry and a camera that measures depth, adjusted over a sliding window."""

    def __init__(self, drive: Drive, config: VisualConfig) -> None:
        super().__init__(drive, config)
        self._window = SlidingWindow(drive.camera, config, self.errors)
        self.drift = self._window.drift

    def combine(
        self, motion: Egomotion | None, points: PointPair, frames: Frames
    ) -> MotionEstimate:
        """Adjusts the sliding window; returns its last step."""
        before, current = points
        earlier, now = self.cameras
        if motion is None:
            control = self.corrected_odometry[0]
            pose, current = camera_motion(now, control, earlier), TrackedPoints()
        else:
            pose = motion.rotation, motion.translation
            self.planarity.update(motion.off_plane, self.seconds)
        slip = np.diag([1.0, correlation_factor(self.seconds, self._config) ** 0.5, 1.0])
        odometry = (
            self.corrected_odometry[0],
            slip @ self.corrected_odometry[1] @ slip,
        )  # side-slip lasts several frames
        control, covariance = self._window.add(
            *(before, current, pose, odometry, self.seconds, self.cameras)
        )
        if motion is None:
            return control, covariance
        return self.measured(motion._replace(control=control, covariance=covariance))

    def restart(self) -> None:
        """Discards all frames but the last."""
        super().restart()
        self._window.restart()

    def constant_errors(self, pose: FloatArray) -> FloatArray:
        """Covariance (3, 3) of a pose (3,) by calibration errors."""
        return self._window.drift.covariance(float(pose[2]))
