"""Pictures and pages, made from the data types of `saccade.types`."""

from saccade.viewing.attention import attention_figure, heat_beside
from saccade.viewing.drive_film import drive_frames
from saccade.viewing.film import save_film, scanpath_frames
from saccade.viewing.innovations import innovation_figure
from saccade.viewing.keypoints import keypoint_figure, match_figure
from saccade.viewing.map_film import map_frames
from saccade.viewing.maps import map_figure
from saccade.viewing.page import Picture, Section, html_page
from saccade.viewing.style import save_figure
from saccade.viewing.symmetry import pair_figure, region_figure

__all__ = [
    "Picture",
    "Section",
    "attention_figure",
    "drive_frames",
    "heat_beside",
    "html_page",
    "innovation_figure",
    "keypoint_figure",
    "map_figure",
    "map_frames",
    "match_figure",
    "pair_figure",
    "region_figure",
    "save_figure",
    "save_film",
    "scanpath_frames",
]
