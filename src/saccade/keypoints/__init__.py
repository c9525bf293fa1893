"""What to keep."""

from saccade.keypoints.matching import match
from saccade.keypoints.sift import Sift
from saccade.keypoints.sift_config import SiftConfig
from saccade.keypoints.verification import Verification, verify

__all__ = ["Sift", "SiftConfig", "Verification", "match", "verify"]
