"""Settings of EKF-SLAM."""

from dataclasses import dataclass
from math import inf
from typing import Literal, Self

import numpy as np

from saccade.errors import Settings, require, setting
from saccade.slam.association.rules import Pairing, Rule, rule_of
from saccade.slam.filter.state import Errors


@dataclass(frozen=True)
class EkfConfig(Settings):
    """Parameters of the filter, of data association and of map management."""

    errors: Errors = "invariant"
    """Error parametrization: right-invariant, which stays consistent, or as published."""
    association: str | Rule | Pairing = "auto"
    """Data association: a name in `association.rules.RULES`, a `Rule`, or a function that pairs
    observations with landmarks by geometry alone (`Pairing`), itself or as module:function."""
    gate: float = setting(0.99, above=0, below=1)
    """Association by geometry: probability to accept an observation of a landmark."""
    new_gate: float = setting(0.9999, above=0, below=1)
    """Association by geometry: an observation outside this gate of every landmark is new."""
    confirm_after: int = setting(5, 1)
    """Association by geometry: a candidate becomes a landmark of the map at this observation; 1 for
    the first. It is in the filter from the first on."""
    candidate_scans: int = setting(20, 1)
    """Association by geometry: scans without a re-observation before a candidate is dropped."""
    culling_ratio: float | None = setting(0.4, above=0, below=1)
    """Association by geometry: least detections of a landmark, as a fraction of the usual number at
    the same ranges and bearings; landmarks below are removed. None keeps all."""
    label_gate: float = setting(0.99999, above=0, below=1)
    """Association by label: probability with which an observation of the landmark of its label is
    inside its gate; outside, the label is rejected, unless the rule accepts all labels."""
    max_hypotheses: int = setting(8, 1)
    """Largest number of association hypotheses, for rules that may have several."""
    recover: bool = True
    """Whether a kidnapped robot stops the filter, keeps its map, and searches for its pose."""
    motion_noise_scale: float = setting(1.0, above=0, below=1e6)
    """Factor on the standard deviations of the controls."""
    sensor_noise_scale: float = setting(1.0, above=0, below=1e6)
    """Factor on the standard deviations of the observations."""
    huber: float = setting(1.345, above=0, maximum=inf)
    """Huber's threshold: an observation with a larger root of the normalized innovation squared has
    less weight, as its covariance is multiplied by their ratio. The usual value costs 5 % of
    efficiency where all noise is Gaussian; infinite gives every observation its full weight."""
    start_sigma: tuple[float, float, float] = setting((0.0, 0.0, 0.0), 0, below=1e6)
    """Standard deviation of the first pose: meters, meters, radians."""
    estimate_systematic_errors: bool = True
    """Whether systematic errors of odometry and ranges are estimated, as states of the filter and
    variables of smoothing."""
    odometry_bias: tuple[float, float, float] = setting((0.018, 0.05, 0.05), 0, below=1e6)
    """Standard deviations of the systematic odometry errors of a log that declares none: relative
    error of the distance, turn in radians per meter of distance, and distance in meters per radian
    of turn."""
    range_errors: tuple[float, float] = setting((0.03, 0.05), 0, below=1e6)
    """Standard deviations of the systematic errors of the ranges of a log that declares none:
    relative error, and offset in meters. Without known distances, a common scale of odometry and
    ranges is not observable; these values share a disagreement."""
    smooth: bool = True
    """Whether the trajectory and the map of a recorded log are smoothed at its end
    (`saccade.slam.smooth`). `Slam.step` is causal anyway."""
    submaps: Literal["auto", "always", "never"] = "auto"
    """Compressed filter: whether steps change only the landmarks around the robot, and all others
    later; with "auto" in maps of 350 landmarks and more. The estimate is equal up to rounding."""

    def __post_init__(self) -> None:
        super().__post_init__()
        rule_of(self.association)
        require(self.gate <= self.new_gate, "new_gate", "at least `gate`", self.new_gate)

    @property
    def rule(self) -> Rule:
        """The association rule."""
        return rule_of(self.association)

    def systematic_sigmas(
        self, odometry: tuple[float, float, float], ranges: tuple[float, float]
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Standard deviations of the systematic errors of odometry and ranges; empty without.

        Args:
            odometry: as a log declares them; zeros if it does not.
            ranges: as a log declares them; zeros if it does not.
        """
        if not self.estimate_systematic_errors:
            return (), ()
        by_odometry = odometry if any(odometry) else self.odometry_bias
        by_range = ranges if any(ranges) else self.range_errors
        return by_odometry if any(by_odometry) else (), by_range if any(by_range) else ()

    @classmethod
    def kootstra2010(cls) -> Self:
        """Kootstra (2010): the filter of C.1-C.18 with known data association.

        Errors along the axes of the map, full weight for every observation, no odometry bias, no
        culling, no relocalization, no smoothing. Two details are not specified there: singular
        covariances R are made regular (`MIN_SIGMA`), and a second observation of a new landmark in
        the same scan is dropped.
        """
        return cls(
            errors="standard",
            association="known",
            recover=False,
            huber=np.inf,
            estimate_systematic_errors=False,
            smooth=False,
        )
