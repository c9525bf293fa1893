"""Planarity: how far the robot leaves the plane of its map."""

from dataclasses import dataclass, field

import numpy as np

from saccade.types import FloatArray

INTEGRATION_TIME = 2.0
"""Seconds over which tilt and height are integrated: over longer ones their drift dominates."""
AVERAGING_TIME = 10.0
"""Seconds over which their variances are averaged."""
MAX_TILT_RATIO = 3.0
"""Tilt over the assumed one from which it is reported."""
MAX_HEIGHT = 0.3
"""Standard deviation of the height in metres from which it is reported."""


@dataclass
class Planarity:
    """Standard deviations of roll, pitch and height, by the motion of the camera."""

    assumed_tilt: float
    """Least standard deviation of roll and pitch, in radians."""
    max_tilt: float = field(default=0.0, init=False)
    """The largest `tilt` so far."""
    max_height: float = field(default=0.0, init=False)
    """The largest standard deviation of the height so far, in metres."""
    _integral: FloatArray = field(default_factory=lambda: np.zeros(3), init=False)
    _squared: FloatArray = field(default_factory=lambda: np.zeros(3), init=False)
    _weight: float = field(default=0.0, init=False)

    @property
    def tilt(self) -> float:
        """Present standard deviation of roll and pitch, in radians."""
        return max(self.assumed_tilt, float(self._sigma[1:].max()))

    @property
    def _sigma(self) -> FloatArray:
        return np.asarray(np.sqrt(self._squared / max(self._weight, 1e-9)))

    def update(self, off_plane: FloatArray, seconds: float) -> None:
        """Add metres up, radians rolled and pitched (3,) since the last frame."""
        self._integral = self._integral * np.exp(-seconds / INTEGRATION_TIME) + off_plane
        decay = np.exp(-seconds / AVERAGING_TIME)
        self._squared = decay * self._squared + (1 - decay) * np.square(self._integral)
        self._weight = decay * self._weight + (1 - decay)
        self.max_tilt = max(self.max_tilt, self.tilt)
        self.max_height = max(self.max_height, float(self._sigma[0]))

    def remarks(self) -> tuple[str, ...]:
        """What the user should know, in sentences."""
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
