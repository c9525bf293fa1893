"""Motion prior and systematic errors: what is known of a step beside its measurement."""

from dataclasses import dataclass, field

import numpy as np

from saccade.slam.consistency import chi_square_gate
from saccade.types import FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Motion, Prior
from saccade.visual.ground_scale import DISTANCE_NOISE

CONTRADICTION = 0.9999
"""Probability inside which two estimates of a control may differ."""
CONSTANT_TURN = np.pi / 2
"""Radians of turning over which a calibration error of the turn is constant."""
CONSTANT_DISTANCE = 10.0
"""Metres over which a calibration error of the distance is constant."""
MAX_OUTAGE = 5.0
"""Seconds without camera for which the covariance of odometry allows for its systematic errors."""
OUTLIER_SQUARED = 9.0
"""Normalized innovation squared (one dimension, 3 sigma) beyond which a measurement is ignored."""


def fuse(first: Prior, second: Prior) -> Prior:
    """Two independent estimates (3,) with covariances (3, 3), fused by their information.

    Where they contradict each other, the first alone.
    """
    difference, total = first[0] - second[0], first[1] + second[1]
    weighted = np.linalg.solve(total, difference)
    if difference @ weighted > chi_square_gate(3, CONTRADICTION):
        return first
    covariance = second[1]
    return (
        second[0] + covariance @ weighted,
        covariance - covariance @ np.linalg.solve(total, covariance),
    )


@dataclass
class MotionPrior:
    """Constant-velocity prediction, fused with odometry."""

    acceleration_sigma: FloatArray
    """(3,) standard deviations of the change of speed ahead, to the left (m/s) and of the turn
    rate (rad/s) in a second."""
    _velocity: FloatArray | None = field(default=None, init=False)
    _covariance: FloatArray = field(default_factory=lambda: np.zeros((3, 3)), init=False)

    def predict(self, control: FloatArray, covariance: FloatArray, seconds: float) -> Prior:
        """Odometry (3,) with its covariance (3, 3), fused with the last motion.

        Where they contradict each other, odometry alone: the robot may have stopped, or been
        lifted or turned.
        """
        if self._velocity is None or seconds <= 0:
            return control, covariance
        expected = self._velocity * seconds
        noise = np.diag(np.square(self.acceleration_sigma * seconds**2))
        return fuse((control, covariance), (expected, self._covariance * seconds**2 + noise))

    def update(self, control: FloatArray, covariance: FloatArray, seconds: float) -> None:
        """Record the last motion (3,), its covariance (3, 3) and duration."""
        if seconds > 0:
            self._velocity, self._covariance = control / seconds, covariance / seconds**2


@dataclass
class OdometryScale:
    """Scale error of odometry, estimated together with that of the camera (Kalman filter).

    Both are constant: odometry has the wrong wheel radius, the camera the wrong height.
    """

    odometry_sigma: float
    """Standard deviation of the fraction by which true distances exceed those of odometry."""
    camera_sigma: float
    """Standard deviation of the fraction by which distances by the camera are too long."""

    def __post_init__(self) -> None:
        self._error = np.zeros(2)  # of odometry, of the camera
        self._covariance = np.diag(np.square([self.odometry_sigma, self.camera_sigma]))

    @property
    def factor(self) -> float:
        """True distance over that of odometry."""
        return 1.0 + float(self._error[0])

    @property
    def sigma(self) -> float:
        """Standard deviation of the factor."""
        return float(np.sqrt(self._covariance[0, 0]))

    @property
    def camera_factor(self) -> float:
        """Distance by the camera over the true one."""
        return 1.0 + float(self._error[1])

    def update(self, ratio: float) -> None:
        """Update by a distance measured by the camera over that of odometry times `factor`."""
        innovation = ratio - 1.0 - self._error[1]
        S = self._covariance.sum() + DISTANCE_NOISE**2
        if innovation**2 < OUTLIER_SQUARED * S:
            gain = self._covariance.sum(1) / S
            self._error = self._error + gain * innovation
            self._covariance = self._covariance - np.outer(gain, gain) * S


@dataclass
class TurnRateBias:
    """Bias of odometry's turn rate, positive to the left (Kalman filter)."""

    rate: float = 0.0
    """Radians per second."""
    variance: float = 0.02**2
    """Of the rate."""

    def corrected(self, control: FloatArray, seconds: float) -> FloatArray:
        """A control (3,) of odometry without the bias, half of which turns its translation."""
        turn = self.rate * seconds
        c, s = np.cos(turn / 2), np.sin(turn / 2)
        ahead, left, turned = control
        return np.array([c * ahead + s * left, c * left - s * ahead, turned - turn])

    def update(self, difference: float, seconds: float, variance: float) -> None:
        """Update by radians that odometry turned more than the camera, and their variance.

        Outliers are ignored: the robot may have been lifted, or its wheels slip.
        """
        S = variance + self.variance * seconds**2
        innovation = difference - self.rate * seconds
        if 0 < innovation**2 < OUTLIER_SQUARED * S:
            gain = self.variance * seconds / S
            self.rate += gain * innovation
            self.variance -= gain * seconds * self.variance


def odometry_error_covariance(
    control: FloatArray, seconds: float, scale_sigma: float, bias: TurnRateBias
) -> FloatArray:
    """(3, 3) covariance of a step by the systematic errors that were not learned yet.

    It is that of an error which is new in each step; over `CONSTANT_DISTANCE` and `MAX_OUTAGE` the
    steps together have that of the constant one.
    """
    forward = control[:2]
    length = max(float(np.hypot(*forward)), 1e-9)
    by_scale = np.append(forward, 0.0)
    by_turn = np.array([-forward[1] / 2, forward[0] / 2, 1.0])
    return np.asarray(
        scale_sigma**2 * max(CONSTANT_DISTANCE / length, 1.0) * np.outer(by_scale, by_scale)
        + bias.variance * seconds * max(MAX_OUTAGE, seconds) * np.outer(by_turn, by_turn)
    )


def camera_error_covariance(
    motion: Motion, seconds: float, config: VisualConfig, tilt: float
) -> FloatArray:
    """(3, 3) covariance of a motion by the camera, inflated for errors correlated in time.

    Successive frames observe the same points. Errors with correlation time T, sampled every dt,
    accumulate as independent ones of (1 + r) / (1 - r) times the variance, r = exp(-dt / T).
    Calibration errors are constant over `CONSTANT_DISTANCE` and `CONSTANT_TURN`. A robot tilted by
    `tilt` radians moves and turns by cos(tilt) of that on the ground.
    """
    decay = np.exp(-seconds / config.correlation_time)
    factor = np.sqrt((1 + decay) / (1 - min(decay, 1 - 1e-6)))
    inflation = np.diag([1.0, 1.0, factor]) if motion.includes_prior else factor * np.eye(3)
    distance, turn = config.relative_motion_sigma
    distance, turn = np.hypot((0.0 if motion.includes_prior else distance, turn), 1 - np.cos(tilt))
    forward = motion.control[:2]
    covariance = inflation @ motion.covariance @ inflation
    length = max(float(np.hypot(*forward)), 1e-9)
    covariance[:2, :2] += distance**2 * CONSTANT_DISTANCE / length * np.outer(forward, forward)
    covariance[2, 2] += turn**2 * CONSTANT_TURN * abs(motion.control[2])
    return covariance
