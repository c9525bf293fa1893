"""Tags in images (AprilTag, ArUco): landmarks with labels, from a camera and printed paper.

OpenCV finds and decodes the tags; their corners are refined, and located by the camera.
"""

from saccade.tags.config import FAMILIES, TagConfig, parse_ids, parse_sizes
from saccade.tags.detector import Tags, TagSightings
from saccade.tags.drive_log import TagLog, observe_tags
from saccade.tags.markers import tag_cells

__all__ = [
    "FAMILIES",
    "TagConfig",
    "TagLog",
    "TagSightings",
    "Tags",
    "observe_tags",
    "parse_ids",
    "parse_sizes",
    "tag_cells",
]
