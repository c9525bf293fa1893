"""Active vision: attention, interest points, and EKF-SLAM.

Saliency models predict where people look, interest points are detected and matched, and EKF-SLAM
maps landmarks.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from saccade import datasets as datasets
    from saccade import exchange as exchange
    from saccade import gaze as gaze
    from saccade import slam as slam
    from saccade import textbook as textbook
    from saccade import viewing as viewing
    from saccade import visual as visual
    from saccade.attention import AttentionConfig as AttentionConfig
    from saccade.attention import AttentionMaps as AttentionMaps
    from saccade.attention import BooleanConfig as BooleanConfig
    from saccade.attention import BooleanMaps as BooleanMaps
    from saccade.attention import ContrastConfig as ContrastConfig
    from saccade.attention import ContrastMaps as ContrastMaps
    from saccade.attention import FittedModel as FittedModel
    from saccade.attention import ScanpathConfig as ScanpathConfig
    from saccade.attention import ScanpathModelConfig as ScanpathModelConfig
    from saccade.attention import SymmetryConfig as SymmetryConfig
    from saccade.attention import SymmetryMaps as SymmetryMaps
    from saccade.attention import VideoConfig as VideoConfig
    from saccade.attention import VideoMaps as VideoMaps
    from saccade.attention import VideoSaliency as VideoSaliency
    from saccade.attention import attention_saliency as attention_saliency
    from saccade.attention import boolean_saliency as boolean_saliency
    from saccade.attention import contrast_saliency as contrast_saliency
    from saccade.attention import most_probable_scanpath as most_probable_scanpath
    from saccade.attention import next_fixation_density as next_fixation_density
    from saccade.attention import sample_scanpaths as sample_scanpaths
    from saccade.attention import scanpath_log_likelihood as scanpath_log_likelihood
    from saccade.attention import symmetry_saliency as symmetry_saliency
    from saccade.attention.scanpath import scanpath as scanpath
    from saccade.attention.symmetry import symmetric_pairs as symmetric_pairs
    from saccade.errors import ConfigError as ConfigError
    from saccade.errors import DriveError as DriveError
    from saccade.errors import ImageError as ImageError
    from saccade.errors import ImageWarning as ImageWarning
    from saccade.errors import KeypointsError as KeypointsError
    from saccade.errors import LogError as LogError
    from saccade.errors import LogWarning as LogWarning
    from saccade.errors import OutputError as OutputError
    from saccade.errors import SaccadeError as SaccadeError
    from saccade.io.image import read_image as read_image
    from saccade.keypoints.matching import match as match
    from saccade.keypoints.must import Must as Must
    from saccade.keypoints.must_config import MustConfig as MustConfig
    from saccade.keypoints.sift import Sift as Sift
    from saccade.keypoints.sift_config import DescriptorConfig as DescriptorConfig
    from saccade.keypoints.sift_config import SiftConfig as SiftConfig
    from saccade.keypoints.symroid import SymRoid as SymRoid
    from saccade.keypoints.symroid_config import SymRoidConfig as SymRoidConfig
    from saccade.keypoints.verification import Verification as Verification
    from saccade.keypoints.verification import verify as verify
    from saccade.pictures import show as show
    from saccade.settings import load_model as load_model
    from saccade.types import Keypoints as Keypoints
    from saccade.types import LandmarkLog as LandmarkLog
    from saccade.types import LandmarkMap as LandmarkMap
    from saccade.types import Scanpath as Scanpath
    from saccade.types import ScanpathSamples as ScanpathSamples
    from saccade.types import SymmetricPairs as SymmetricPairs
    from saccade.types import Trajectory as Trajectory

__version__ = "0.1.0"

_MODULES = {
    "attention": (
        *("AttentionConfig", "AttentionMaps", "attention_saliency", "symmetric_pairs"),
        *("ContrastConfig", "ContrastMaps", "contrast_saliency", "ScanpathConfig", "scanpath"),
        *("SymmetryConfig", "SymmetryMaps", "symmetry_saliency"),
        *("BooleanConfig", "BooleanMaps", "boolean_saliency", "FittedModel"),
        *("ScanpathModelConfig", "sample_scanpaths", "most_probable_scanpath"),
        *("VideoConfig", "VideoMaps", "VideoSaliency"),
        *("next_fixation_density", "scanpath_log_likelihood"),
    ),
    "errors": (
        *("ConfigError", "DriveError", "ImageError", "ImageWarning", "KeypointsError"),
        *("LogError", "LogWarning", "OutputError", "SaccadeError"),
    ),
    "io.image": ("read_image",),
    "keypoints.matching": ("match",),
    "keypoints.must": ("Must",),
    "keypoints.must_config": ("MustConfig",),
    "keypoints.sift": ("Sift",),
    "keypoints.sift_config": ("DescriptorConfig", "SiftConfig"),
    "keypoints.symroid": ("SymRoid",),
    "keypoints.symroid_config": ("SymRoidConfig",),
    "keypoints.verification": ("Verification", "verify"),
    "settings": ("load_model",),
    "types": (
        *("Keypoints", "LandmarkLog", "LandmarkMap", "Scanpath", "ScanpathSamples"),
        *("SymmetricPairs", "Trajectory"),
    ),
    "pictures": ("show",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}
_PACKAGES = ("datasets", "exchange", "gaze", "slam", "textbook", "viewing", "visual")

__all__ = sorted([*_MODULE_OF, *_PACKAGES])


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used: `import saccade` stays light."""
    if name in _PACKAGES:
        return import_module(f"saccade.{name}")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'saccade' has no attribute {name!r}")
    value = getattr(import_module(f"saccade.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
