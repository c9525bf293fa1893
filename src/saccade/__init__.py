"""Active vision: where to look, what to keep, and the map it makes.

An image goes in, attention says where to look, interest points say what to
keep, landmarks say where things are, and a map comes out.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from saccade.files import LARGEST_IMAGE

if TYPE_CHECKING:
    from saccade import datasets, exchange, slam, textbook, viewing, visual
    from saccade.attention.combined import AttentionConfig, AttentionMaps, attention_saliency
    from saccade.attention.contrast import ContrastConfig, ContrastMaps, contrast_saliency
    from saccade.attention.scanpath import ScanpathConfig, scanpath
    from saccade.attention.symmetric_pairs import symmetric_pairs
    from saccade.attention.symmetry import SymmetryConfig, SymmetryMaps, symmetry_saliency
    from saccade.errors import (
        ConfigError,
        DriveError,
        ImageError,
        KeypointsError,
        LogError,
        OutputError,
        SaccadeError,
    )
    from saccade.image import read_image
    from saccade.keypoints.descriptor_config import DescriptorConfig
    from saccade.keypoints.matching import match
    from saccade.keypoints.must import Must
    from saccade.keypoints.must_config import MustConfig
    from saccade.keypoints.sift import Sift
    from saccade.keypoints.sift_config import SiftConfig
    from saccade.keypoints.symroid import SymRoid
    from saccade.keypoints.symroid_config import SymRoidConfig
    from saccade.keypoints.verification import Verification, verify
    from saccade.types import (
        Keypoints,
        LandmarkLog,
        LandmarkMap,
        Observation,
        Scanpath,
        SymmetricPairs,
        Trajectory,
    )

__version__ = "0.1.0"

os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(LARGEST_IMAGE))  # read as OpenCV loads

_HOMES = {
    "saccade.attention.combined": ("AttentionConfig", "AttentionMaps", "attention_saliency"),
    "saccade.attention.contrast": ("ContrastConfig", "ContrastMaps", "contrast_saliency"),
    "saccade.attention.scanpath": ("ScanpathConfig", "scanpath"),
    "saccade.errors": (
        "ConfigError",
        "DriveError",
        "ImageError",
        "KeypointsError",
        "LogError",
        "OutputError",
        "SaccadeError",
    ),
    "saccade.attention.symmetric_pairs": ("symmetric_pairs",),
    "saccade.attention.symmetry": ("SymmetryConfig", "SymmetryMaps", "symmetry_saliency"),
    "saccade.image": ("read_image",),
    "saccade.keypoints.descriptor_config": ("DescriptorConfig",),
    "saccade.keypoints.matching": ("match",),
    "saccade.keypoints.must": ("Must",),
    "saccade.keypoints.must_config": ("MustConfig",),
    "saccade.keypoints.sift": ("Sift",),
    "saccade.keypoints.sift_config": ("SiftConfig",),
    "saccade.keypoints.symroid": ("SymRoid",),
    "saccade.keypoints.symroid_config": ("SymRoidConfig",),
    "saccade.keypoints.verification": ("Verification", "verify"),
    "saccade.types": (
        "Keypoints",
        "LandmarkLog",
        "LandmarkMap",
        "Observation",
        "Scanpath",
        "SymmetricPairs",
        "Trajectory",
    ),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}
_PACKAGES = ("datasets", "exchange", "slam", "textbook", "viewing", "visual")

__all__ = [
    "AttentionConfig",
    "AttentionMaps",
    "ConfigError",
    "ContrastConfig",
    "ContrastMaps",
    "DescriptorConfig",
    "DriveError",
    "ImageError",
    "Keypoints",
    "KeypointsError",
    "LandmarkLog",
    "LandmarkMap",
    "LogError",
    "Must",
    "MustConfig",
    "Observation",
    "OutputError",
    "SaccadeError",
    "Scanpath",
    "ScanpathConfig",
    "Sift",
    "SiftConfig",
    "SymRoid",
    "SymRoidConfig",
    "SymmetricPairs",
    "SymmetryConfig",
    "SymmetryMaps",
    "Trajectory",
    "Verification",
    "attention_saliency",
    "contrast_saliency",
    "datasets",
    "exchange",
    "match",
    "read_image",
    "scanpath",
    "slam",
    "symmetric_pairs",
    "symmetry_saliency",
    "textbook",
    "verify",
    "viewing",
    "visual",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used: `import saccade` stays light."""
    if name in _PACKAGES:
        return import_module(f"saccade.{name}")
    if name not in _HOME_OF:
        raise AttributeError(f"module 'saccade' has no attribute {name!r}")
    value = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
