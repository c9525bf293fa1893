"""Motion prior, systematic errors of odometry and camera, and departures from the ground plane."""

from dataclasses import dataclass, field

import numpy as np

from saccade.slam.consistency import chi_square_gate
from saccade.types import FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Egomotion, MotionEstimate
from saccade.visual.ground_scale import DISTANCE_NOISE

FUSION_GATE = 0.9999
"""Probability of the gate within which two estimates of a control are fused."""
CONSTANT_TURN, CONSTANT_DISTANCE = np.pi / 2, 10.0
"""Radians and metres over which a calibration error of turn and distance is constant."""
MAX_OUTAGE = 5.0
"""Seconds without camera for which the covariance of odometry allows for its systematic errors."""
MAX_NIS = 9.0
"""Normalized innovation squared (one dimension, 3 sigma) beyond which a measurement is ignored."""
SLIP_ANGLE, SLIP_PER_ACCELERATION, SLIP_SECONDS = 0.01, 0.006, 1.0
"""Side-slip before the first frame: standard deviations of its angle in radians, on a straight road
and per m/s^2 of lateral acceleration; and the seconds over which what remains of it is constant. By
the true poses of KITTI's drives 00 to 09 angles are .003 to .015, and .003 to .008 per m/s^2."""
INTEGRATION_TIME, AVERAGING_TIME = 2.0, 10.0
"""Seconds over which tilt and height are integrated, before their drift dominates; and over which
their variances are averaged."""
MAX_TILT_RATIO, MAX_HEIGHT = 3.0, 0.3
"""Tilt over the assumed one, and standard deviation of the height in metres, that are reported."""


def fuse(first: MotionEstimate, second: MotionEstimate) -> MotionEstimate:
    """Fuse two independent estimates of a control by their information.

    Where they differ by more than the gate allows, the first alone.
    """
    difference, total = first[0] - second[0], first[1] + second[1]
    weighted = np.linalg.solve(total, difference)
    if difference @ weighted > chi_square_gate(3, FUSION_GATE):
        return first
    covariance = second[1]
    fused = covariance - covariance @ np.linalg.solve(total, covariance)
    return second[0] + covariance @ weighted, fused


@dataclass
class MotionPrior:
    """Constant-velocity prediction, fused with odometry."""

    acceleration_sigma: FloatArray
    """(3,) standard deviations of the change of forward and lateral speed (m/s) and of turn rate
    (rad/s) in a second."""
    _velocity: FloatArray | None = field(default=None, init=False)
    _covariance: FloatArray = field(default_factory=lambda: np.zeros((3, 3)), init=False)

    def predict(
        self, control: FloatArray, covariance: FloatArray, seconds: float
    ) -> MotionEstimate:
        """Odometry (3,) with its covariance (3, 3), fused with the last motion.

        Where they disagree, odometry alone: the robot may have stopped, or been lifted or turned.
        """
        if self._velocity is None or seconds <= 0:
            return control, covariance
        expected = self._velocity * seconds
        noise = np.diag(np.square(self.acceleration_sigma * seconds**2))
        return fuse((control, covariance), (expected, self._covariance * seconds**2 + noise))

    def update(self, control: FloatArray, covariance: FloatArray, seconds: float) -> None:
        """Set the last motion (3,), its covariance (3, 3) and its duration."""
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
        """Update by the ratio of the camera's distance to that of odometry times `factor`."""
        innovation = ratio - 1.0 - self._error[1]
        S = self._covariance.sum() + DISTANCE_NOISE**2
        if innovation**2 < MAX_NIS * S:
            gain = self._covariance.sum(1) / S
            self._error = self._error + gain * innovation
            self._covariance = self._covariance - np.outer(gain, gain) * S


@dataclass
class TurnRateBias:
    """Bias of odometry's turn rate, positive to the left (Kalman filter)."""

    rate: float = 0.0
    """Radians per second."""
    variance: float = 0.02**2
    """Variance of the rate."""

    def corrected(self, control: FloatArray, seconds: float) -> FloatArray:
        """A control (3,) of odometry without the bias; half of its turn rotates the translation."""
        turn = self.rate * seconds
        c, s = np.cos(turn / 2), np.sin(turn / 2)
        ahead, left, turned = control
        return np.array([c * ahead + s * left, c * left - s * ahead, turned - turn])

    def update(self, difference: float, seconds: float, variance: float) -> None:
        """Update by the turn of odometry less that of the camera in radians, and its variance.

        Outliers are ignored: the robot may have been lifted, or its wheels may slip.
        """
        S = variance + self.variance * seconds**2
        innovation = difference - self.rate * seconds
        if 0 < innovation**2 < MAX_NIS * S:
            gain = self.variance * seconds / S
            self.rate += gain * innovation
            self.variance -= gain * seconds * self.variance


@dataclass
class SideSlip:
    """Side-slip of which odometry does not know, positive to the left (Kalman filter).

    Its angle is a constant plus one in proportion to the lateral acceleration.
    """

    def __post_init__(self) -> None:
        self._error = np.zeros(2)  # radians; radians per m/s^2
        self._covariance = np.diag(np.square([SLIP_ANGLE, SLIP_PER_ACCELERATION]))

    def corrected(self, control: FloatArray, seconds: float) -> FloatArray:
        """A control (3,) of odometry with the estimated side-slip."""
        slip = float(slip_lever(control, seconds) @ self._error)
        return np.asarray(control + np.array([0.0, slip, 0.0]))

    def variance(self, control: FloatArray, seconds: float) -> float:
        """Variance of the side-slip of a control in square metres."""
        lever = slip_lever(control, seconds)
        return float(lever @ self._covariance @ lever)

    def update(
        self, difference: float, control: FloatArray, seconds: float, variance: float
    ) -> None:
        """Update by what the camera moved to the left beyond a corrected control, in metres."""
        lever = slip_lever(control, seconds)
        gain = self._covariance @ lever
        S = variance + float(lever @ gain)
        if 0 < difference**2 < MAX_NIS * S:
            self._error = self._error + gain * (difference / S)
            self._covariance = self._covariance - np.outer(gain, gain) / S


def slip_lever(control: FloatArray, seconds: float) -> FloatArray:
    """(2,) derivative of the side-slip of a control in metres by the errors of `SideSlip`."""
    length = float(np.hypot(*control[:2]))
    acceleration = length * float(control[2]) / max(seconds, 1e-3) ** 2
    return np.array([length, length * acceleration])


@dataclass
class Planarity:
    """Standard deviations of roll, pitch and height, from the motion of the camera."""

    assumed_tilt: float
    """Least standard deviation of roll and pitch, in radians."""
    max_tilt: float = field(default=0.0, init=False)
    max_height: float = field(default=0.0, init=False)
    _integral: FloatArray = field(default_factory=lambda: np.zeros(3), init=False)
    _squared: FloatArray = field(default_factory=lambda: np.zeros(3), init=False)
    _weight: float = field(default=0.0, init=False)

    @property
    def tilt(self) -> float:
        """Current standard deviation of roll and pitch, in radians."""
        return max(self.assumed_tilt, float(self._sigma[1:].max()))

    @property
    def _sigma(self) -> FloatArray:
        return np.asarray(np.sqrt(self._squared / max(self._weight, 1e-9)))

    def update(self, off_plane: FloatArray, seconds: float) -> None:
        """Add a `Motion.off_plane` (3,)."""
        self._integral = self._integral * np.exp(-seconds / INTEGRATION_TIME) + off_plane
        decay = np.exp(-seconds / AVERAGING_TIME)
        self._squared = decay * self._squared + (1 - decay) * np.square(self._integral)
        self._weight = decay * self._weight + (1 - decay)
        self.max_tilt = max(self.max_tilt, self.tilt)
        self.max_height = max(self.max_height, float(self._sigma[0]))

    def remarks(self) -> tuple[str, ...]:
        """A warning where the robot leaves the plane of its map."""
        parts = []
        if self.max_tilt > MAX_TILT_RATIO * self.assumed_tilt:
            parts.append(f"pitches and rolls by {np.degrees(self.max_tilt):.1f} deg")
        if self.max_height > MAX_HEIGHT:
            parts.append(f"rises and falls by {self.max_height:.1f} m")
        if not parts:
            return ()
        return (
            f"the robot {' and '.join(parts)} as its camera measures it, but its map is flat: the "
            "standard deviations of observations and motion are enlarged accordingly",
        )


def odometry_error_covariance(
    control: FloatArray, seconds: float, scale_sigma: float, bias: TurnRateBias, slip: SideSlip
) -> FloatArray:
    """(3, 3) covariance of a control (3,) by the systematic errors that remain.

    Taken as independent from step to step, they accumulate to those of constant errors over
    `CONSTANT_DISTANCE`, `MAX_OUTAGE` and `SLIP_SECONDS`.
    """
    x, y, _ = control
    length = max(float(np.hypot(x, y)), 1e-9)
    by_scale, by_turn = np.array([x, y, 0.0]), np.array([-y / 2, x / 2, 1.0])
    by_slip = slip.variance(control, seconds) * max(SLIP_SECONDS / max(seconds, 1e-3), 1.0)
    return np.asarray(
        scale_sigma**2 * max(CONSTANT_DISTANCE / length, 1.0) * np.outer(by_scale, by_scale)
        + bias.variance * seconds * max(MAX_OUTAGE, seconds) * np.outer(by_turn, by_turn)
        + np.diag([0.0, by_slip, 0.0])
    )


def correlation_factor(seconds: float, config: VisualConfig) -> float:
    """Variance that errors with correlation time T accumulate, over that of independent ones.

    Sampled every dt it is (1 + r) / (1 - r), r = exp(-dt / T).
    """
    decay = float(np.exp(-seconds / config.correlation_time))
    return (1 + decay) / (1 - min(decay, 1 - 1e-6))


def camera_error_covariance(
    motion: Egomotion, seconds: float, config: VisualConfig, tilt: float
) -> FloatArray:
    """(3, 3) covariance of a motion by the camera, inflated for errors correlated in time.

    Successive frames observe the same points (see `correlation_factor`). Calibration errors are
    constant over `CONSTANT_DISTANCE` and `CONSTANT_TURN`. The motion of a robot tilted by `tilt`
    radians is cos(tilt) times as long on the ground.
    """
    factor = np.sqrt(correlation_factor(seconds, config))
    inflation = np.diag([1.0, 1.0, factor]) if motion.includes_prior else factor * np.eye(3)
    distance, turn = config.relative_motion_sigma
    distance, turn = np.hypot((0.0 if motion.includes_prior else distance, turn), 1 - np.cos(tilt))
    forward = motion.control[:2]
    covariance = inflation @ motion.covariance @ inflation
    length = max(float(np.hypot(*forward)), 1e-9)
    covariance[:2, :2] += distance**2 * CONSTANT_DISTANCE / length * np.outer(forward, forward)
    covariance[2, 2] += turn**2 * CONSTANT_TURN * abs(motion.control[2])
    return covariance
