"""The whole chain: camera frames in, map out."""

from saccade.visual.config import VisualConfig
from saccade.visual.frame_features import FeatureCache
from saccade.visual.pipeline import Pipeline, run
from saccade.visual.result import LandmarkObservations, VisualResult

__all__ = [
    "FeatureCache",
    "LandmarkObservations",
    "Pipeline",
    "VisualConfig",
    "VisualResult",
    "run",
]
