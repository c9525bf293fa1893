"""What a filter says of its steps."""

from typing import NamedTuple

import numpy as np

from saccade.types import FloatArray


class Innovation(NamedTuple):
    """What an observation said beyond what was expected."""

    value: FloatArray
    """(2,) observed less expected: range and bearing, or map coordinates (see `error_state`)."""
    covariance: FloatArray
    """(2, 2) S of C.12, before the update."""
    nis: float
    """Normalized innovation squared; chi-square with two degrees if the filter is right."""


class PredictedObservations(NamedTuple):
    """What the filter expects to see of every landmark."""

    z: FloatArray
    """(n, 2) expected observations."""
    covariance: FloatArray
    """(n, 2, 2) H P H^T of each, without the noise of an observation."""


class Replay(NamedTuple):
    """What came of a stretch of a log."""

    pose: FloatArray
    """(t, 3) after each step."""
    covariance: FloatArray
    """(t, 3, 3) of the pose."""
    innovation: FloatArray
    """(k, 2) as in `Innovation`; here and below NaN where an observation corrected nothing."""
    innovation_covariance: FloatArray
    """(k, 2, 2)."""
    nis: FloatArray
    """(k,)."""

    @classmethod
    def empty(cls, t: int, k: int) -> "Replay":
        """Room for so many steps and observations."""
        return cls(
            pose=np.empty((t, 3)),
            covariance=np.empty((t, 3, 3)),
            innovation=np.full((k, 2), np.nan),
            innovation_covariance=np.full((k, 2, 2), np.nan),
            nis=np.full(k, np.nan),
        )
