"""Where things are: range-bearing landmark SLAM; it never sees an image."""

from saccade.slam.association import KnownIdentity, NearestNeighbor
from saccade.slam.consistency import Consistency
from saccade.slam.ekf import EkfSlam, Innovation
from saccade.slam.landmarks import Candidates
from saccade.slam.models import RANGE_BEARING, Sensor, compose, drive, observe, place, wrap
from saccade.slam.retraction import FIRST_ESTIMATES, INVARIANT, STANDARD, Retraction
from saccade.slam.run import EkfConfig, SlamResult, dead_reckon, run

__all__ = [
    "FIRST_ESTIMATES",
    "INVARIANT",
    "RANGE_BEARING",
    "STANDARD",
    "Candidates",
    "Consistency",
    "EkfConfig",
    "EkfSlam",
    "Innovation",
    "KnownIdentity",
    "NearestNeighbor",
    "Retraction",
    "Sensor",
    "SlamResult",
    "compose",
    "dead_reckon",
    "drive",
    "observe",
    "place",
    "run",
    "wrap",
]
