"""Range-bearing landmark SLAM; independent of images."""

from saccade.slam.config import EkfConfig
from saccade.slam.consistency import Consistency
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.models import (
    compose,
    difference,
    inverse_observe,
    observe,
    turn_then_translate,
    wrap,
)
from saccade.slam.filter.predictions import Innovations
from saccade.slam.filter.state import ERRORS
from saccade.slam.kidnapping import KidnappingDetector
from saccade.slam.merging import MergedMaps, merge_maps
from saccade.slam.online import Slam
from saccade.slam.relocalization import Relocalizer
from saccade.slam.results import PoseHypotheses, SlamMap, SlamResult, StepResult
from saccade.slam.run import Recorder, dead_reckon, find_start, run, slam_for
from saccade.slam.smoothing import smooth

__all__ = [
    "ERRORS",
    "Consistency",
    "EkfConfig",
    "EkfSlam",
    "Innovations",
    "KidnappingDetector",
    "MergedMaps",
    "PoseHypotheses",
    "Recorder",
    "Relocalizer",
    "Slam",
    "SlamMap",
    "SlamResult",
    "StepResult",
    "compose",
    "dead_reckon",
    "difference",
    "find_start",
    "inverse_observe",
    "merge_maps",
    "observe",
    "run",
    "slam_for",
    "smooth",
    "turn_then_translate",
    "wrap",
]
