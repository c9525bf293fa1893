"""Visual SLAM: camera frames and odometry in, trajectory and map out."""

from saccade.visual.config import VisualConfig
from saccade.visual.frontend import dedicated_process
from saccade.visual.pipeline import Pipeline, measure_odometry, run
from saccade.visual.result import LandmarkObservations, ObservationKind, VisualResult

__all__ = [
    "LandmarkObservations",
    "ObservationKind",
    "Pipeline",
    "VisualConfig",
    "VisualResult",
    "dedicated_process",
    "measure_odometry",
    "run",
]
