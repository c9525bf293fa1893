"""The motion of the robot from frame to frame: what odometry and the camera say of it, joined."""

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
from saccade.visual.robot_motion import camera_motion
from saccade.visual.self_calibration import CalibrationDrift
from saccade.visual.tables import TrackedPoints
from saccade.visual.window import SlidingWindow

PointPair: TypeAlias = tuple[TrackedPoints, TrackedPoints]
"""Points of the last frame, and those of them that were tracked into this one."""
Frames: TypeAlias = tuple[PreparedFrame, PreparedFrame]
"""The last frame that was not blank, and this one."""

MIN_SCALE_SIGMA = 0.02
"""Least standard deviation of odometry's scale where the camera measures distances."""
MIN_TURN_BIAS_SIGMA = 0.02
"""Least standard deviation of odometry's turn rate bias at the start, in rad/s."""


class MotionEstimator:
    """The steps of a drive by odometry alone; a camera that measures depth only maps."""

    measures_range = True
    """Whether the camera measures depth; else the length of a step is odometry's, times a scale,
    and the ranges of landmarks follow from the motion itself."""
    drift: CalibrationDrift | None = None
    """Effect of the errors of the calibration on the pose; None where they are not known."""

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
        """The camera as it was turned in the last frame and in this one."""
        self.turn_sigma = 0.0
        """Standard deviation of the camera's pan and tilt in this frame, in radians."""
        self.seconds = 0.0
        """Duration of the last step."""
        self._declared: MotionEstimate = np.zeros(3), np.zeros((3, 3))
        self._step = self._declared  # without its systematic errors

    def turn_camera(self, turn: CameraTurn | None) -> None:
        """Set how the camera is turned in this frame."""
        self.cameras = self.cameras[1], self._drive.camera.turned(turn)
        self.turn_sigma = 0.0 if turn is None else turn.sigma

    def predict(self, number: int) -> MotionEstimate:
        """Control that odometry expects to lead to a frame after the first.

        The estimated systematic errors are corrected; the covariance is that of the odometry.
        """
        drive, last = self._drive, number - 1
        self.seconds = float(drive.time[number] - drive.time[last])
        control, covariance = drive.control[last], drive.control_covariance[last]
        self._declared = control, covariance
        if self.turn_sigma:  # of both frames: the camera's turn is compared with odometry's
            covariance = covariance + np.diag([0.0, 0.0, 2 * self.turn_sigma**2])
        self._step = self.errors.corrected(control, self.seconds), covariance
        return self._step

    def measured(self, motion: Egomotion | None) -> MotionEstimate:
        """The last step by the camera, or by odometry where there is no egomotion.

        The covariance includes errors of calibration and tilt, or systematic errors of odometry.
        """
        if motion is None:
            control, covariance = self._step
            has_scale = self.measures_range  # else it is an error of the whole trajectory
            systematic = self.errors.step_covariance(control, self.seconds, has_scale)
            return control, covariance + systematic
        covariance = camera_error_covariance(
            motion, self.seconds, self._config, self.planarity.tilt, self.measures_range
        )
        return motion.control, covariance

    def refine(self, motion: Egomotion, before: TrackedPoints, after: TrackedPoints) -> Egomotion:
        """Egomotion by what the points (k,) of two frames tell of its length."""
        return motion

    def join(self, motion: Egomotion | None, points: PointPair, frames: Frames) -> MotionEstimate:
        """Combines odometry and egomotion, if any: the control from the last pose to this one."""
        return self._declared

    def with_depth(self, points: TrackedPoints) -> TrackedPoints:
        """The tracked points (k,) with the depths that the motion so far tells of."""
        return points

    def restart(self) -> None:
        """Forget the motions so far: after a gap they tell nothing of the next one."""

    def constant_errors(self, pose: FloatArray) -> FloatArray:
        """(3, 3) covariance of a pose (3,) by errors that are constant over the drive."""
        return np.zeros((3, 3))

    @property
    def scale(self) -> float:
        """True distances over those of the first steps."""
        return 1.0 if self.measures_range else self.errors.factor

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of the scale of the whole map, as a fraction of it."""
        return 0.0 if self.measures_range else self.errors.scale_sigma

    def _scale_sigmas(self) -> tuple[float, float]:
        """Sigmas of the fractions: true distances over odometry's, and the camera's over true."""
        if not self.measures_range:
            return self._drive.odometry_bias[0], self._config.relative_height_sigma
        by_odometry = float(np.hypot(self._drive.odometry_bias[0], MIN_SCALE_SIGMA))
        return by_odometry, self._config.relative_motion_sigma[0]


class StereoMotionEstimator(MotionEstimator):
    """The motion by odometry and a camera that measures depth, adjusted over a sliding window."""

    def __init__(self, drive: Drive, config: VisualConfig) -> None:
        super().__init__(drive, config)
        self._window = SlidingWindow(drive.camera, config, self.errors)
        self.drift = self._window.drift

    def join(self, motion: Egomotion | None, points: PointPair, frames: Frames) -> MotionEstimate:
        """Adjusts the sliding window; returns its last step."""
        before, current = points
        earlier, now = self.cameras
        if motion is None:
            pose, current = camera_motion(now, self._step[0], earlier), TrackedPoints()
        else:
            pose = motion.rotation, motion.translation
            self.planarity.update(motion.off_plane, self.seconds)
        slip = np.diag([1.0, correlation_factor(self.seconds, self._config) ** 0.5, 1.0])
        odometry = self._step[0], slip @ self._step[1] @ slip  # side-slip lasts several frames
        control, covariance = self._window.add(
            *(before, current, pose, odometry, self.seconds, self.cameras)
        )
        if motion is None:
            return control, covariance
        return self.measured(motion._replace(control=control, covariance=covariance))

    def restart(self) -> None:
        """Forget all frames but the last."""
        self._window.restart()

    def constant_errors(self, pose: FloatArray) -> FloatArray:
        """(3, 3) covariance of a pose (3,) by errors of the calibration."""
        return self._window.drift.covariance(float(pose[2]))
