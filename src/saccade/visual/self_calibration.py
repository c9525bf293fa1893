"""Self-calibration: errors of the camera's calibration that the points themselves reveal.

An error of the calibration leaves residuals over a window that no motion explains. The focal length
is no part of it: over a small window it can hardly be told from the distortion.

Over a few frames the drift of the tracks looks like an offset of all disparities, which changes
every distance. So it is estimated by two halves of the frames apart, and corrected only as far as
that makes the residuals of the other half smaller.
"""

from dataclasses import dataclass

import numpy as np

from saccade.frames import Camera
from saccade.slam.models import compose, heading_rotation
from saccade.types import FloatArray

SIGMA = (0.02, 0.3, 0.5)
"""Standard deviations before the first frame: of the distortion at the radius of a focal length,
as a fraction of that; of the disparity there, in pixels: by how much the focal lengths of the two
cameras differ; and of all disparities, in pixels."""
REMAINING_SIGMA = (0.0018, 0.0019)
"""Standard deviations of constant errors that a drive does not reveal: of the focal length, as a
fraction of it, and of the yaw of the camera on the robot, in radians."""
OFFSET = 2
"""Row of the disparity offset."""
TRACK_CORRELATION = 12.0
"""Variance of the estimates over that of independent errors: those of a track are correlated."""
MIN_GAIN = 12.0
"""Least gain of the log likelihood of held-out residuals by which the offset is corrected: as the
errors of a track are correlated, they reach 8 by chance."""


class SelfCalibration:
    """Constant errors of a calibration, estimated from all windows so far.

    After `block` windows the other half of the frames follows.
    """

    def __init__(self, camera: Camera, block: int) -> None:
        self._camera, self._block = camera, block
        self._information = np.zeros((2, len(SIGMA), len(SIGMA)))  # of the two halves
        self._vector = np.zeros((2, len(SIGMA)))
        self._count = 0
        self.error = np.zeros(len(SIGMA))
        """(3,) errors that are corrected."""
        self.covariance = np.diag(np.square(SIGMA))
        """(3, 3) of the estimates."""
        self.estimate = np.zeros(len(SIGMA))
        """(3,) estimated errors, whether corrected or not."""

    def correct(self, observed: FloatArray) -> FloatArray:
        """Observations (..., 3) of pixels and inverse depths, without the estimated errors."""
        return np.asarray(observed + calibration_jacobian(self._camera, observed) @ self.error)

    def update(self, information: FloatArray, gradient: FloatArray) -> None:
        """Add the normal equations (3, 3), (3,) of corrections, about the current estimate.

        The offset is corrected as far as the other half of the frames confirms it.
        """
        half, prior = self._count // self._block % 2, np.diag(1 / np.square(SIGMA))
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
        """The fraction of the offset by which held-out residuals gain most; 0 if too little."""
        total = self._information.copy()  # of the offset alone: the others are eliminated
        total[:, :OFFSET, :OFFSET] += np.diag(1 / np.square(SIGMA[:OFFSET]))
        cross = np.linalg.solve(total[:, :OFFSET, :OFFSET], total[:, :OFFSET, OFFSET:])[:, :, 0]
        information = total[:, OFFSET, OFFSET] - (cross * total[:, OFFSET, :OFFSET]).sum(1)
        vector = self._vector[:, OFFSET] - (cross * self._vector[:, :OFFSET]).sum(1)
        offset = vector / (information + 1 / SIGMA[OFFSET] ** 2)
        slope = float(vector[::-1] @ offset)  # of the log likelihood of the other half
        curvature = float(information[::-1] @ offset**2)
        fraction = min(max(slope / max(curvature, 1e-12), 0.0), 1.0)
        gain = fraction * slope - fraction**2 * curvature / 2
        return fraction if gain > MIN_GAIN else 0.0


def calibration_jacobian(camera: Camera, observed: FloatArray) -> FloatArray:
    """(..., 3, 3) derivatives of corrected observations (..., 3) by the errors."""
    offset = observed[..., :2] - (camera.cx, camera.cy)
    ray = offset / (camera.fx, camera.fy)
    squared = np.square(ray)
    J = np.zeros((*observed.shape, len(SIGMA)))
    J[..., :2, 0] = offset * squared.sum(-1, keepdims=True)
    if camera.baseline > 0:
        J[..., 2, 0] = observed[..., 2] * (3 * squared[..., 0] + squared[..., 1])
        J[..., 2, 1] = ray[..., 0] / (camera.fx * camera.baseline)
        J[..., 2, 2] = 1 / (camera.fx * camera.baseline)
    return J


@dataclass(frozen=True)
class CalibrationReport:
    """Errors of the calibration that a drive has revealed."""

    distortion: float
    """Radial distortion that was corrected, at the radius of a focal length, as a fraction."""
    disparity_slope: float
    """Pixels of disparity that were corrected at that radius."""
    disparity_offset: float
    """Pixels by which all disparities were corrected."""
    sigma: tuple[float, float, float]
    """Standard deviations of the three."""
    scale_by_offset: float
    """Fraction by which a disparity offset of one pixel changes all distances."""


class CalibrationDrift:
    """Effect of the errors of the calibration on the pose since the start.

    Errors that are estimated late, or remain, displace the whole trajectory: they widen the
    covariance of the pose as one error, not as one of each step.
    """

    def __init__(self, calibration: SelfCalibration) -> None:
        self._calibration = calibration
        self.by_errors = np.zeros((3, len(SIGMA) + len(REMAINING_SIGMA)))
        """(3, 5) derivative of the pose, in its own frame, by the errors and those that remain."""
        self._corrected = np.zeros(3)  # the part of it that was corrected
        self._distance = self._by_offset = 0.0

    def add(self, control: FloatArray, by_errors: FloatArray, corrected: FloatArray) -> None:
        """Add a control (3,), with its derivative (3, 3) by the errors; (3,) were corrected."""
        _, Fx, Fu = compose(np.zeros(3), control)
        back, (x, y, turn) = heading_rotation(float(control[2])).T, control
        by_all = np.c_[by_errors, [x, y, -turn], [-y, x, 0.0]]
        self.by_errors = back @ (Fx @ self.by_errors + Fu @ by_all)
        self._corrected = back @ (Fx @ self._corrected + Fu @ by_errors @ corrected)
        length = float(np.hypot(*control[:2]))
        self._distance += length
        self._by_offset += float(control[:2] @ by_errors[:2, OFFSET]) / max(length, 1e-9)

    def covariance(self, heading: float, is_corrected: bool = True) -> FloatArray:
        """(3, 3) covariance of a pose with a heading by what is not corrected of the errors."""
        S, calibration = self.by_errors, self._calibration
        n = len(SIGMA)
        remaining = S[:, :n] @ calibration.estimate - is_corrected * self._corrected
        R = heading_rotation(heading)
        total = S[:, :n] @ calibration.covariance @ S[:, :n].T + np.outer(remaining, remaining)
        total += S[:, n:] @ np.diag(np.square(REMAINING_SIGMA)) @ S[:, n:].T
        return np.asarray(R @ total @ R.T)

    def report(self) -> CalibrationReport:
        """The corrected errors, and how the scale depends on them."""
        distortion, slope, offset = self._calibration.error.tolist()
        sigma = np.sqrt(np.diag(self._calibration.covariance))
        by_offset = abs(self._by_offset) / max(self._distance, 1e-9)
        return CalibrationReport(distortion, slope, offset, (*sigma.tolist(),), by_offset)
