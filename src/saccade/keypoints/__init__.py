"""Keypoint detectors, descriptors, matching and geometric verification."""

from typing import TYPE_CHECKING, Any

import saccade

if TYPE_CHECKING:
    from saccade.keypoints.descriptor_config import DescriptorConfig
    from saccade.keypoints.matching import match
    from saccade.keypoints.must import Must
    from saccade.keypoints.must_config import MustConfig, SymRoidConfig
    from saccade.keypoints.sift import Sift
    from saccade.keypoints.sift_config import SiftConfig
    from saccade.keypoints.symroid import SymRoid
    from saccade.keypoints.verification import Verification, verify

__all__ = [
    "DescriptorConfig",
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


def __getattr__(name: str) -> Any:
    """Loads a name at its first use, since detectors need different libraries."""
    if name in __all__:
        return getattr(saccade, name)
    raise AttributeError(f"module 'saccade.keypoints' has no attribute {name!r}")
