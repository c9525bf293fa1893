"""The region that made a place win: what inhibition of return can cover instead of a disc.

After Walther & Koch (2006), *Modeling attention to salient proto-objects*.
"""

import cv2
import numpy as np

from saccade.attention.contrast import ContrastMaps
from saccade.attention.scanpath import Region
from saccade.errors import ImageError
from saccade.pyramid import FloatMap, resize

FAINTEST = 0.05
"""Part of the winner's height at which its region ends."""
LARGEST = 0.1
"""Part of the map; a larger region is background."""
MARGIN = 2
"""Cells by which a region is widened."""


def proto_object(maps: ContrastMaps, row: int, column: int) -> Region | None:
    """The region around a cell in the feature map that contributed most to it.

    The conspicuity map that is highest at the cell is searched for its feature map that is; of
    that the cells connected to the winner which reach 5 % of its height are taken, and widened
    by a disc.

    Args:
        maps: with features, as `contrast_saliency(..., keep_features=True)` gives them.
        row: of the cell in the saliency map.
        column: of the cell.

    Returns:
        (h, w) where the region is; None where it would be empty or over a tenth of the map.

    Raises:
        ImageError: the maps hold no features, or the cell lies outside.
    """
    shape = maps.saliency.shape
    if not maps.features:
        raise ImageError("maps: expected features; compute them with keep_features=True")
    if not (0 <= row < shape[0] and 0 <= column < shape[1]):
        raise ImageError(f"cell: expected one of {shape[0]} x {shape[1]}, found {row}, {column}")
    conspicuity = {
        "intensity": maps.intensity,
        "color": maps.color,
        "orientation": maps.orientation,
    }
    winner = max(conspicuity, key=lambda name: float(conspicuity[name][row, column]))
    features = [
        resize(feature.normalized, shape)
        for feature in maps.features
        if conspicuity_of(feature.channel) == winner
    ]
    strongest = max(features, key=lambda values: float(values[row, column]))
    return region_around(strongest, row, column)


def conspicuity_of(channel: str) -> str:
    """The conspicuity map that a feature map of this channel goes into."""
    kind = channel.partition(" ")[0]
    return "color" if kind in ("red-green", "blue-yellow") else kind


def region_around(values: FloatMap, row: int, column: int) -> Region | None:
    """The cells connected to one that reach a part of its height, widened; None for none.

    The part is 5 %, doubled while the region would be a tenth of the map or more.
    """
    height = float(values[row, column])
    part = FAINTEST
    while height > 0 and part <= 1:
        above = (values >= part * height).astype(np.uint8)
        _, label = cv2.connectedComponents(above, connectivity=4)
        region = label == label[row, column]
        if region.sum() < LARGEST * region.size:
            y, x = np.ogrid[-MARGIN : MARGIN + 1, -MARGIN : MARGIN + 1]
            disc = (x**2 + y**2 <= MARGIN**2).astype(np.uint8)
            return np.asarray(cv2.dilate(region.astype(np.uint8), disc) > 0)
        part *= 2
    return None
