"""Self-calibration: calibration errors estimated from the residuals of the sliding window.

Calibration errors leave residuals that no motion explains. The focal length is not estimated, since
a small window hardly separates it from distortion.

Drifting tracks resemble an offset of all disparities, which changes every distance. Therefore the
offset is estimated from each half of the frames, and corrected as far as the residuals of the other
half decrease.
"""

from dataclasses import dataclass

import numpy as np

from saccade.frames import Camera
from saccade.slam.filter.robot_models import compose, heading_rotation
from saccade.types import FloatArray

CALIBRATION_SIGMA = (0.02, 0.3, 0.5)
"""Prior standard deviations of the calibration errors: relative distortion at the radius of a focal
length; disparity at this radius, in pixels (unequal focal lengths); and offset of all disparities,
in pixels."""
REMAINING_SIGMA = (0.0018, 0.0019)
"""Standard deviations of errors that are not estimated: relative focal length, and yaw of the
camera on the robot in radians."""
OFFSET = 2
"""Index of the disparity offset."""
TRACK_CORRELATION = 12.0
"""Variance inflation of the estimates, as the errors of a track are correlated."""
MIN_OFFSET_GAIN = 12.0
"""Minimum gain of the log-likelihood of held-out residuals for a correction of the offset. The gain
reaches 8 by chance."""


class SelfCalibration:
    """Constant calibration errors, estimated from all windows so far.

    Blocks of `block` windows belong alternately to the two halves of the frames.
    """

    def __init__(self, camera: Camera, block: int) -> None:
        self._camera, self._block = camera, block
        self._information = np.zeros(
            (2, len(CALIBRATION_SIGMA), len(CALIBRATION_SIGMA))
        )  # of both halves
        self._vector = np.zeros((2, len(CALIBRATION_SIGMA)))
        self._count = 0
        self.error = np.zeros(len(CALIBRATION_SIGMA))
        """(3,) corrected errors."""
        self.covariance = np.diag(np.square(CALIBRATION_SIGMA))
        """(3, 3) covariance of the estimates."""
        self.estimate = np.zeros(len(CALIBRATION_SIGMA))
        """(3,) estimated errors, whether corrected or not."""

    def correct(self, observed: FloatArray) -> FloatArray:
        """Corrects observations (..., 3) of pixels and inverse depths."""
        return np.asarray(observed + calibration_jacobian(self._camera, observed) @ self.error)

    def update(self, information: FloatArray, gradient: FloatArray) -> None:
        """Adds normal equations (3, 3), (3,) of the errors about the current estimate."""
        half, prior = self._count // self._block % 2, np.diag(1 / np.square(CALIBRATION_SIGMA))
        self._count += 1
        self._vector[half] += information @ self.error + gradient
        self._information[half] += information
        information, vector = self._information.sum(0), self._vector.sum(0)
        total = information + prior
        self.covariance = np.linalg.inv(information / TRACK_CORRELATION + prior)
        self.estimate = np.linalg.solve(total, vector)
        offset = self._confirmed() * float(self.estimate[OFFSET])
        rest = vector[:OFFSET] - total[:OFFSET, OFFSET] * offset
        self.error = np.append(np.linalg.solve(total[:OFFSET, :OFFSET], rest), offset)

    def _confirmed(self) -> float:
        """Fraction of the offset that fits held-out residuals best; 0 if the gain is small."""
        total = self._information.copy()  # of the offset alone: the others are eliminated
        total[:, :OFFSET, :OFFSET] += np.diag(1 / np.square(CALIBRATION_SIGMA[:OFFSET]))
        cross = np.linalg.solve(total[:, :OFFSET, :OFFSET], total[:, :OFFSET, OFFSET:])[:, :, 0]
        information = total[:, OFFSET, OFFSET] - (cross * total[:, OFFSET, :OFFSET]).sum(1)
        vector = self._vector[:, OFFSET] - (cross * self._vector[:, :OFFSET]).sum(1)
        offset = vector / (information + 1 / CALIBRATION_SIGMA[OFFSET] ** 2)
        slope = float(vector[::-1] @ offset)  # of the log likelihood of the other half
        curvature = float(information[::-1] @ offset**2)
        fraction = min(max(slope / max(curvature, 1e-12), 0.0), 1.0)
        gain = fraction * slope - fraction**2 * curvature / 2
        return fraction if gain > MIN_OFFSET_GAIN else 0.0


def calibration_jacobian(camera: Camera, observed: FloatArray) -> FloatArray:
    """Derivatives (..., 3, 3) of corrected observations (..., 3) by the calibration errors."""
    offset = observed[..., :2] - (camera.cx, camera.cy)
    ray = offset / (camera.fx, camera.fy)
    squared = np.square(ray)
    J = np.zeros((*observed.shape, len(CALIBRATION_SIGMA)))
    J[..., :2, 0] = offset * squared.sum(-1, keepdims=True)
    if camera.baseline > 0:
        J[..., 2, 0] = observed[..., 2] * (3 * squared[..., 0] + squared[..., 1])
        J[..., 2, 1] = ray[..., 0] / (camera.fx * camera.baseline)
        J[..., 2, 2] = 1 / (camera.fx * camera.baseline)
    return J


@dataclass(frozen=True)
class CalibrationReport:
    """Calibration errors estimated on a drive."""

    distortion: float
    """Corrected radial distortion, relative, at the radius of a focal length."""
    disparity_slope: float
    """Corrected disparity at this radius, in pixels."""
    disparity_offset: float
    """Corrected offset of all disparities, in pixels."""
    sigma: tuple[float, float, float]
    """Standard deviations of distortion, slope and offset."""
    scale_by_offset: float
    """Relative change of all distances by a disparity offset of one pixel."""


class CalibrationDrift:
    """Effect of calibration errors on the pose since the start.

    Remaining errors, and errors that are corrected late, displace the whole trajectory. They
    enlarge the covariance of the pose as one common error, not as independent errors of the steps.
    """

    def __init__(self, calibration: SelfCalibration) -> None:
        self._calibration = calibration
        self.by_errors = np.zeros((3, len(CALIBRATION_SIGMA) + len(REMAINING_SIGMA)))
        """(3, 5) derivative of the pose, in its own frame, by estimated and remaining errors."""
        self._corrected = np.zeros(3)  # the part of it that was corrected
        self._distance = self._by_offset = 0.0

    def add(self, control: FloatArray, by_errors: FloatArray, corrected: FloatArray) -> None:
        """Adds a control (3,), its derivative (3, 3) by the errors, and corrected errors (3,)."""
        _, Fx, Fu = compose(np.zeros(3), control)
        back, (x, y, turn) = heading_rotation(float(control[2])).T, control
        by_all = np.c_[by_errors, [x, y, -turn], [-y, x, 0.0]]
        self.by_errors = back @ (Fx @ self.by_errors + Fu @ by_all)
        self._corrected = back @ (Fx @ self._corrected + Fu @ by_errors @ corrected)
        length = float(np.hypot(*control[:2]))
        self._distance += length
        self._by_offset += float(control[:2] @ by_errors[:2, OFFSET]) / max(length, 1e-9)

    def covariance(self, heading: float, is_corrected: bool = True) -> FloatArray:
        """Covariance (3, 3) by uncorrected errors of a pose with a heading in radians."""
        S, calibration = self.by_errors, self._calibration
        n = len(CALIBRATION_SIGMA)
        remaining = S[:, :n] @ calibration.estimate - is_corrected * self._corrected
        R = heading_rotation(heading)
        total = S[:, :n] @ calibration.covariance @ S[:, :n].T + np.outer(remaining, remaining)
        total += S[:, n:] @ np.diag(np.square(REMAINING_SIGMA)) @ S[:, n:].T
        return np.asarray(R @ total @ R.T)

    def report(self) -> CalibrationReport:
        """Corrected errors, and their effect on the scale."""
        distortion, slope, offset = self._calibration.error.tolist()
        sigma = np.sqrt(np.diag(self._calibration.covariance))
        by_offset = abs(self._by_offset) / max(self._distance, 1e-9)
        return CalibrationReport(distortion, slope, offset, (*sigma.tolist(),), by_offset)
