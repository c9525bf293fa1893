"""Hypotheses of a pose in a known map, and the parameters of their search."""

from dataclasses import dataclass

from saccade.errors import require
from saccade.types import FloatArray, IntArray


@dataclass(frozen=True)
class RelocalizationConfig:
    """Parameters of relocalization."""

    unmapped: float = 0.2
    """Prior probability that an observed point is no landmark of the map."""
    elsewhere: float = 0.05
    """Prior probability that the robot is outside of the map."""
    max_pairs: int = 12
    """Pairs of observed points that propose poses: distant ones, of distances rare in the map."""
    max_proposals: int = 50_000
    """Proposed poses whose support is computed, after those of the first few pairs."""
    max_hypotheses: int = 50
    """Proposed poses that are refined, those with the most support."""
    settled: float = 0.999
    """Probability of all hypotheses from which they are followed without another search."""
    memory: int = 10
    """Scans for which an observed point counts."""

    def __post_init__(self) -> None:
        for name in ("unmapped", "elsewhere", "settled"):
            require(0 < getattr(self, name) < 1, name, "between 0 and 1", getattr(self, name))
        for name in ("max_pairs", "max_proposals", "max_hypotheses", "memory"):
            require(getattr(self, name) >= 1, name, "at least 1", getattr(self, name))


@dataclass(frozen=True, eq=False, repr=False)
class PoseHypotheses:
    """Hypotheses of the robot's pose in a map, the most probable first."""

    pose: FloatArray
    """(h, 3) x, y in metres, heading in radians."""
    covariance: FloatArray
    """(h, 3, 3)."""
    probability: FloatArray
    """(h,) posterior probabilities; the rest to 1 is that of being outside of the map."""
    association: IntArray
    """(h, k) row of the landmark of each of the k observed points, -1 for none."""

    def __len__(self) -> int:
        return len(self.pose)

    def __repr__(self) -> str:
        if len(self) == 0:
            return "PoseHypotheses(none)"
        x, y, theta = self.pose[0]
        return (
            f"PoseHypotheses({len(self)}, first {x:.2f} {y:.2f} m {theta:.3f} rad "
            f"with {self.probability[0]:.3f})"
        )
