"""Whether the robot stays on the plane that its map is, by what its camera sees."""

from dataclasses import dataclass, field

import numpy as np

from saccade.types import FloatArray

MEMORY = 2.0
"""Seconds over which turns and rises are added up: over longer ones it is their errors that
grow, not what the robot leans."""
LASTING = 10.0
"""Seconds for which it counts how far the robot has leaned."""
REMARKABLE = 3.0
"""Times as far as was assumed."""
HEAVE = 0.3
"""Metres up and down that are worth one."""


@dataclass
class Planarity:
    """How far the robot leaves it."""

    assumed: float
    """Radians of roll and pitch that are taken for granted (standard deviation)."""
    most: float = field(default=0.0, init=False)
    """The largest `tilt` so far."""
    heave: float = field(default=0.0, init=False)
    """The largest standard deviation of the height so far, in metres."""
    _away: FloatArray = field(default_factory=lambda: np.zeros(3), init=False)
    _square: FloatArray = field(default_factory=lambda: np.zeros(3), init=False)
    _weight: float = field(default=0.0, init=False)

    @property
    def tilt(self) -> float:
        """Standard deviation of roll and pitch at present, in radians: what is assumed at least."""
        return max(self.assumed, float(self._deviation[1:].max()))

    @property
    def _deviation(self) -> FloatArray:
        return np.asarray(np.sqrt(self._square / max(self._weight, 1e-9)))

    def update(self, tilt: FloatArray, seconds: float) -> None:
        """Take in metres up, radians rolled and pitched (3,) since the last frame."""
        self._away = self._away * np.exp(-seconds / MEMORY) + tilt
        kept = np.exp(-seconds / LASTING)
        self._square = kept * self._square + (1 - kept) * np.square(self._away)
        self._weight = kept * self._weight + (1 - kept)
        self.most = max(self.most, self.tilt)
        self.heave = max(self.heave, float(self._deviation[0]))

    def remarks(self) -> tuple[str, ...]:
        """What the user should know, in sentences."""
        found = []
        if self.most > REMARKABLE * self.assumed:
            found.append(f"pitches and rolls by {np.degrees(self.most):.1f} deg")
        if self.heave > HEAVE:
            found.append(f"rises and falls by {self.heave:.1f} m")
        if not found:
            return ()
        return (
            f"the robot {' and '.join(found)} by what its camera sees, but its map is flat: "
            "sightings and motion are trusted so much less",
        )
