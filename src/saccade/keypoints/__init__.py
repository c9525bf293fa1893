"""What to keep."""

from saccade.keypoints.matching import match
from saccade.keypoints.sift import Sift
from saccade.keypoints.sift_config import SiftConfig

__all__ = ["Sift", "SiftConfig", "match"]
