"""Where to look: contrast saliency, and the scanpath over a saliency map."""

from saccade.attention.contrast import ContrastConfig, ContrastMaps, FeatureMap, contrast_saliency
from saccade.attention.proto_object import proto_object
from saccade.attention.scanpath import ScanpathConfig, scanpath

__all__ = [
    "ContrastConfig",
    "ContrastMaps",
    "FeatureMap",
    "ScanpathConfig",
    "contrast_saliency",
    "proto_object",
    "scanpath",
]
