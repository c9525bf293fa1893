"""The cells of a tag, for printing and rendering."""

import re
from typing import Any

import numpy as np

from saccade.errors import require
from saccade.tags.config import FAMILIES, family_name
from saccade.types import BoolArray


def dictionary_of(family: str) -> Any:
    """OpenCV's dictionary of a family, with the number of wrong cells that its codes can correct.

    Codes that differ in at least d cells correct (d - 1) / 2. OpenCV 4 corrects none of AprilTag's
    families, and 12 cells of 36h12.
    """
    import cv2  # slow to import

    kind = getattr(cv2.aruco, f"DICT_{FAMILIES[family]}")
    dictionary = cv2.aruco.getPredefinedDictionary(kind)
    least_distance = re.search(r"h(\d+)$", family)
    if least_distance is not None:
        dictionary.maxCorrectionBits = (int(least_distance[1]) - 1) // 2
    return dictionary


def tag_cells(family: str, tag: int) -> BoolArray:
    """(n, n) cells of a tag with its black border, True where white.

    Raises:
        ConfigError: unknown family, or no such tag in it.
    """
    import cv2  # slow to import

    name = family_name(family)
    dictionary = dictionary_of(name)
    count = len(dictionary.bytesList)
    require(0 <= tag < count, "ids", f"0 to {count - 1} in the family {name}", tag)
    side = dictionary.markerSize + 2
    return np.asarray(cv2.aruco.generateImageMarker(dictionary, tag, side) > 0)
