"""Visual SLAM: camera frames and odometry in, trajectory and map out."""

from saccade.visual.config import VisualConfig
from saccade.visual.frame_features import FeatureCache
from saccade.visual.pipeline import Pipeline, run
from saccade.visual.prefetch import dedicated_process
from saccade.visual.result import LandmarkObservations, ObservationKind, VisualResult

__all__ = [
    "FeatureCache",
    "LandmarkObservations",
    "ObservationKind",
    "Pipeline",
    "VisualConfig",
    "VisualResult",
    "dedicated_process",
    "run",
]
