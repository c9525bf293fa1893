"""Where things are: range-bearing landmark SLAM; it never sees an image."""

from saccade.slam.association import Association, KnownIdentity, NearestNeighbor
from saccade.slam.checkpoint import Checkpoint
from saccade.slam.compressed import CompressedSlam
from saccade.slam.consistency import Consistency
from saccade.slam.ekf import EkfSlam
from saccade.slam.gating import DROPPED, NEW
from saccade.slam.joint_compatibility import JointCompatibility
from saccade.slam.landmarks import Candidates
from saccade.slam.models import (
    RANGE_BEARING,
    Motion,
    Sensor,
    compose,
    difference,
    drive,
    observe,
    place,
    wrap,
)
from saccade.slam.outcomes import Innovation
from saccade.slam.recording import Recorder
from saccade.slam.retraction import FIRST_ESTIMATES, INVARIANT, STANDARD, Retraction
from saccade.slam.run import EkfConfig, SlamResult, dead_reckon, run
from saccade.slam.smoothing import smooth
from saccade.slam.smoothing_problem import SmoothConfig, SmoothResult

__all__ = [
    "DROPPED",
    "FIRST_ESTIMATES",
    "INVARIANT",
    "NEW",
    "RANGE_BEARING",
    "STANDARD",
    "Association",
    "Candidates",
    "Checkpoint",
    "CompressedSlam",
    "Consistency",
    "EkfConfig",
    "EkfSlam",
    "Innovation",
    "JointCompatibility",
    "KnownIdentity",
    "Motion",
    "NearestNeighbor",
    "Recorder",
    "Retraction",
    "Sensor",
    "SlamResult",
    "SmoothConfig",
    "SmoothResult",
    "compose",
    "dead_reckon",
    "difference",
    "drive",
    "observe",
    "place",
    "run",
    "smooth",
    "wrap",
]
