"""What to keep."""

from saccade.keypoints.matching import match
from saccade.keypoints.must import Must
from saccade.keypoints.must_config import MustConfig
from saccade.keypoints.sift import Sift
from saccade.keypoints.sift_config import SiftConfig
from saccade.keypoints.symroid import SymRoid
from saccade.keypoints.symroid_config import SymRoidConfig
from saccade.keypoints.verification import Verification, verify

__all__ = [
    "Must",
    "MustConfig",
    "Sift",
    "SiftConfig",
    "SymRoid",
    "SymRoidConfig",
    "Verification",
    "match",
    "verify",
]
