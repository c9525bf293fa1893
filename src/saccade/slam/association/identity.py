"""What is known of one landmark identity."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from saccade.types import FloatArray

UNDECIDED = -3
"""Association of an observation for which geometry is still to be asked."""
ESTABLISHED = 3
"""Accepted observations after which an identity may contradict the filter, along with others."""


@dataclass
class Identity:
    """What is known of an identity. Times count the identified observations before."""

    landmark: int = -1
    """Number in the map, -1 for none."""
    accepted: int = 0
    """Observations that were accepted for that landmark."""
    accepted_at: int = -1
    """Time of the last of them."""
    refused_at: int = -1
    """Time of the last refused observation."""
    votes: int = 0
    """Refused observations, one after the other, at one position."""
    since: int = -1
    """Time of the first of them."""
    target: int = UNDECIDED
    """Landmark that they are near to, `NEW` or `UNDECIDED`."""
    closings: int = 0
    """Recent observations that would close a loop by themselves."""
    closing_at: int = -1
    """Time of the last of them."""
    xy: FloatArray = field(default_factory=lambda: np.zeros(2))
    """(2,) position in the map of the last refused observation."""
    covariance: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    """(2, 2) of its noise."""

    FIELDS: ClassVar[tuple[str, ...]] = (
        *("landmark", "accepted", "accepted_at", "refused_at", "votes", "since", "target"),
        *("closings", "closing_at", "xy", "covariance"),
    )

    @property
    def is_established(self) -> bool:
        """Whether it may contradict the filter."""
        return self.accepted >= ESTABLISHED
