"""The whole chain: camera frames in, map out."""

from saccade.visual.config import VisualConfig
from saccade.visual.frame_features import Memory
from saccade.visual.pipeline import Pipeline, run
from saccade.visual.result import Meetings, VisualResult

__all__ = ["Meetings", "Memory", "Pipeline", "VisualConfig", "VisualResult", "run"]
