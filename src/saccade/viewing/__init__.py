"""Figures, films and pages, made from the data types of `saccade.types`."""

from saccade.viewing.attention import attention_figure, pair_figure
from saccade.viewing.film import drive_frames, map_frames
from saccade.viewing.keypoints import keypoint_figure, match_figure, region_figure
from saccade.viewing.page import Section
from saccade.viewing.slam import map_figure
from saccade.viewing.style import save_figure, save_figures

__all__ = [
    "Section",
    "attention_figure",
    "drive_frames",
    "keypoint_figure",
    "map_figure",
    "map_frames",
    "match_figure",
    "pair_figure",
    "region_figure",
    "save_figure",
    "save_figures",
]
