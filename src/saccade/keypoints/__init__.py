"""What to keep."""

from saccade.keypoints.matching import match
from saccade.keypoints.sift import Sift, SiftConfig

__all__ = ["Sift", "SiftConfig", "match"]
