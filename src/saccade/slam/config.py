"""Settings of EKF-SLAM."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, Self

import numpy as np

from saccade.errors import require
from saccade.slam.association.jcbb import JointCompatibility
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.association.rule import Association
from saccade.slam.filter.error_state import FIRST_ESTIMATES, INVARIANT, STANDARD, Retraction

RETRACTIONS: dict[str, Retraction] = {
    "invariant": INVARIANT,
    "standard": STANDARD,
    "first-estimates": FIRST_ESTIMATES,
}
"""The error parametrization of each kind of filter."""
ASSOCIATION_RULES: dict[str, Callable[[float, float], Association]] = {
    "nearest": NearestNeighbor,
    "mutual": partial(NearestNeighbor, mutual=True),
    "joint": JointCompatibility,
}
"""The rules of unknown association, given two gates."""


@dataclass(frozen=True)
class EkfConfig:
    """Parameters of the filter, of data association and of map management."""

    filter: Literal["invariant", "standard", "first-estimates"] = "invariant"
    """Error parametrization: right-invariant, which stays consistent, or the source's."""
    association: Literal["auto", "known", "nearest", "mutual", "joint"] = "auto"
    """Data association: by the log's landmark identities, to the nearest landmark, to the mutually
    nearest one, or of the largest jointly compatible set of pairs. "auto" is "known" for a log that
    identifies every landmark, else "mutual"; a `Slam` without a log takes "mutual"."""
    gate: float = 0.99
    """Unknown association: probability with which an observation of a landmark is accepted."""
    new_gate: float = 0.9999
    """Unknown association: an observation outside this probability of every landmark is new."""
    confirm_after: int = 5
    """Unknown association: a landmark enters the map at this observation; 1 for the first."""
    candidate_timeout: float = 2.0
    """Unknown association: units of the log's time until a candidate without a re-observation is
    dropped."""
    min_observations: int = 10
    """Unknown association: landmarks with fewer observations in the whole log are removed at its
    end."""
    culling_ratio: float | None = 0.4
    """Unknown association: a landmark that is observed in less than this fraction of the checks in
    which it is in view is removed; None keeps all."""
    recover: bool = False
    """Whether a robot that finds itself lost stops the filter, keeps its map, and searches for its
    pose in it. Not by default: there are false alarms where the noise of a log is too small."""
    motion_noise_scale: float = 1.0
    """Factor on the standard deviations of the controls."""
    sensor_noise_scale: float = 1.0
    """Factor on the standard deviations of the observations."""
    huber: float = 1.345
    """Root of the normalized innovation squared beyond which an observation has less weight, its
    covariance multiplied by their ratio. The usual value costs 5 % of efficiency where all noise is
    Gaussian; infinite for full weight always."""
    start_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Standard deviation of the first pose: metres, metres, radians."""
    estimate_odometry_bias: bool = True
    """Whether systematic odometry errors are states of the filter where the log gives their
    standard deviations (`LandmarkLog.odometry_bias`)."""

    def __post_init__(self) -> None:
        require(self.filter in RETRACTIONS, "filter", f"one of {(*RETRACTIONS,)}", self.filter)
        kinds = ("auto", "known", *ASSOCIATION_RULES)
        require(self.association in kinds, "association", f"one of {kinds}", self.association)
        require(0 < self.gate < 1, "gate", "a probability between 0 and 1", self.gate)
        require(self.gate <= self.new_gate < 1, "new_gate", "from `gate` to under 1", self.new_gate)
        require(self.confirm_after >= 1, "confirm_after", "at least 1", self.confirm_after)
        require(self.candidate_timeout > 0, "candidate_timeout", "over 0", self.candidate_timeout)
        require(self.min_observations >= 1, "min_observations", "at least 1", self.min_observations)
        ratio = self.culling_ratio
        in_range = ratio is None or 0 < ratio < 1
        require(in_range, "culling_ratio", "None, or over 0 and under 1", ratio)
        for name in ("motion_noise_scale", "sensor_noise_scale"):
            value = getattr(self, name)
            require(0 < value < 1e6, name, "over 0 and under 1e6", value)
        require(self.huber > 0, "huber", "over 0, infinite for never", self.huber)
        require(
            len(self.start_sigma) == 3 and all(0 <= s < 1e6 for s in self.start_sigma),
            "start_sigma",
            "three numbers from 0 to under 1e6",
            self.start_sigma,
        )

    @classmethod
    def kootstra2010(cls) -> Self:
        """Kootstra (2010): the filter of C.1-C.18 with known data association.

        Errors along the axes of the map, every observation with its full weight, no odometry
        bias, no landmark removed, no search for a lost robot. Two things are not specified there:
        singular covariances R are made regular (`MIN_SIGMA`), and a second observation of a new
        landmark in the same scan is dropped.
        """
        return cls(
            filter="standard",
            association="known",
            huber=np.inf,
            estimate_odometry_bias=False,
        )
