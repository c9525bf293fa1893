"""Visual SLAM: camera frames and odometry in, trajectory and map out."""

from saccade.visual.config import VisualConfig
from saccade.visual.frontend import FeatureCache, dedicated_process
from saccade.visual.pipeline import Pipeline, run
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
