"""Systematic and correlated errors of visual odometry, and motion off the ground plane."""

from dataclasses import dataclass, field

import numpy as np

from saccade.types import FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Egomotion

CONSTANT_TURN = np.pi / 2
"""Constancy of the calibration error of the turn, in radians turned."""
CONSTANT_DISTANCE = 10.0
"""Constancy of the calibration error of the distance, in meters driven."""
INTEGRATION_TIME = 2.0
"""Time constant of the integration of tilt and height, in seconds; beyond it drift dominates."""
AVERAGING_TIME = 10.0
"""Time constant of the average of the variances of tilt and height, in seconds."""
TOTAL_RELATIVE_SIGMA = (0.007, 0.015)
"""`VisualConfig.relative_motion_sigma` with errors that are constant over the drive included, for
motions without `CalibrationDrift`."""
MAX_TILT_RATIO = 3.0
"""Minimum ratio of estimated and assumed tilt for a warning."""
MAX_HEIGHT = 0.3
"""Minimum standard deviation of the height for a warning, in meters."""


@dataclass
class Planarity:
    """Standard deviations of roll, pitch and height, estimated from the egomotion."""

    assumed_tilt: float
    """Minimum standard deviation of roll and pitch, in radians."""
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
        """Adds the off-plane motion (3,) of an `Egomotion` over a duration."""
        self._integral = self._integral * np.exp(-seconds / INTEGRATION_TIME) + off_plane
        decay = np.exp(-seconds / AVERAGING_TIME)
        self._squared = decay * self._squared + (1 - decay) * np.square(self._integral)
        self._weight = decay * self._weight + (1 - decay)
        self.max_tilt = max(self.max_tilt, self.tilt)
        self.max_height = max(self.max_height, float(self._sigma[0]))

    def remarks(self) -> tuple[str, ...]:
        """Warning if the robot leaves the plane of its map; else none."""
        parts = []
        if self.max_tilt > MAX_TILT_RATIO * self.assumed_tilt:
            parts.append(f"pitches and rolls by {np.degrees(self.max_tilt):.1f} deg")
        if self.max_height > MAX_HEIGHT:
            parts.append(f"rises and falls by {self.max_height:.1f} m")
        if not parts:
            return ()
        return (
            f"the camera measures that the robot {' and '.join(parts)}, but the map is flat: "
            "standard deviations of observations and motion are enlarged accordingly",
        )


def correlation_factor(seconds: float, config: VisualConfig) -> float:
    """Variance inflation of accumulated errors that are correlated in time.

    For samples every dt and a correlation time T it is (1 + r) / (1 - r) with r = exp(-dt / T).
    """
    decay = float(np.exp(-seconds / config.correlation_time))
    return (1 + decay) / (1 - min(decay, 1 - 1e-6))


def camera_error_covariance(
    motion: Egomotion, seconds: float, config: VisualConfig, tilt: float, measures_range: bool
) -> FloatArray:
    """Covariance (3, 3) of an egomotion, with correlated and calibration errors.

    Successive frames observe the same points (see `correlation_factor`). Calibration errors are
    constant over `CONSTANT_DISTANCE` and `CONSTANT_TURN`. A tilt in radians shortens the motion on
    the ground by its cosine. Without `measures_range` odometry determines the length.
    """
    factor = np.sqrt(correlation_factor(seconds, config))
    relative = config.relative_motion_sigma
    if not measures_range:
        relative = 0.0, TOTAL_RELATIVE_SIGMA[1]
    along = factor if measures_range else 1.0
    inflation = np.diag([along, along, factor])
    distance, turn = np.hypot(relative, 1 - np.cos(tilt))
    forward = motion.control[:2]
    covariance = inflation @ motion.covariance @ inflation
    length = max(float(np.hypot(*forward)), 1e-9)
    covariance[:2, :2] += distance**2 * CONSTANT_DISTANCE / length * np.outer(forward, forward)
    covariance[2, 2] += turn**2 * CONSTANT_TURN * abs(motion.control[2])
    return covariance
