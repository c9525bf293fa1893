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
    observations with landmarks by geometry alone (`Pairing`)."""
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
    estimate_odometry_bias: bool = True
    """Whether systematic odometry errors (`LandmarkLog.odometry_bias`) are estimated."""
    odometry_bias: tuple[float, float, float] = setting((0.05, 0.05, 0.05), 0, below=1e6)
    """Standard deviations of these errors for a log that declares none: relative error of the
    distance, turn in radians per meter of distance, and distance in meters per radian of turn."""
    smooth: bool = True
    """Whether the trajectory and the map of a recorded log are smoothed at its end
    (`saccade.slam.smooth`). `Slam.step` is causal anyway."""
    submaps: Literal["auto", "always", "never"] = "auto"
    """Compressed filter: whether steps change only the landmarks around the robot, and all others
    later; with "auto" in maps of 1000 landmarks and more. The estimate is equal up to rounding."""

    def __post_init__(self) -> None:
        super().__post_init__()
        rule_of(self.association)
        require(self.gate <= self.new_gate, "new_gate", "at least `gate`", self.new_gate)

    @property
    def rule(self) -> Rule:
        """The association rule."""
        return rule_of(self.association)

    def bias_sigmas(self, declared: tuple[float, float, float]) -> tuple[float, float, float]:
        """Standard deviations of the odometry biases; zero if they are not estimated."""
        if not self.estimate_odometry_bias:
            return 0.0, 0.0, 0.0
        return declared if any(declared) else self.odometry_bias

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
            estimate_odometry_bias=False,
            smooth=False,
        )
