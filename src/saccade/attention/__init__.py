"""Where to look: contrast, symmetry and Boolean map saliency, and the scanpath over a map."""

from saccade.attention.boolean_maps import BooleanConfig, BooleanMaps, boolean_saliency
from saccade.attention.combined import AttentionConfig, AttentionMaps, attention_saliency
from saccade.attention.contrast import (
    ContrastConfig,
    ContrastMaps,
    FeatureMap,
    contrast_pyramids,
    contrast_saliency,
)
from saccade.attention.fitted import FittedMaps, FittedModel
from saccade.attention.proto_object import proto_object
from saccade.attention.scanpath import ScanpathConfig, scanpath
from saccade.attention.scanpath_model import (
    ScanpathModelConfig,
    most_probable_scanpath,
    next_fixation_density,
    sample_scanpaths,
    scanpath_log_likelihood,
)
from saccade.attention.symmetric_pairs import symmetric_pairs
from saccade.attention.symmetry import SymmetryConfig, SymmetryMaps, symmetry_saliency
from saccade.attention.video import VideoConfig, VideoMaps, VideoSaliency

__all__ = [
    "AttentionConfig",
    "AttentionMaps",
    "BooleanConfig",
    "BooleanMaps",
    "ContrastConfig",
    "ContrastMaps",
    "FeatureMap",
    "FittedMaps",
    "FittedModel",
    "ScanpathConfig",
    "ScanpathModelConfig",
    "SymmetryConfig",
    "SymmetryMaps",
    "VideoConfig",
    "VideoMaps",
    "VideoSaliency",
    "attention_saliency",
    "boolean_saliency",
    "contrast_pyramids",
    "contrast_saliency",
    "most_probable_scanpath",
    "next_fixation_density",
    "proto_object",
    "sample_scanpaths",
    "scanpath",
    "scanpath_log_likelihood",
    "symmetric_pairs",
    "symmetry_saliency",
]
