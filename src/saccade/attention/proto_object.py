"""Proto-objects: the region about a fixation, for inhibition of return in place of a disc.

After Walther & Koch (2006), *Modeling attention to salient proto-objects*.
"""

from typing import get_args

import cv2
import numpy as np

from saccade.attention.channels import CONSPICUITY, Conspicuity
from saccade.attention.contrast import ContrastMaps
from saccade.attention.scanpath import Region
from saccade.errors import ImageError
from saccade.scale.pyramid import FloatMap, resize

MIN_HEIGHT = 0.05
"""Height at which the region ends, as a fraction of that of the winner."""
MAX_AREA = 0.1
"""Fraction of the map; a larger region is background."""
MARGIN = 2
"""Radius of the dilation of a region, in cells."""


def proto_object(maps: ContrastMaps, row: int, column: int) -> Region | None:
    """The region around a cell in the feature map that contributed most to it.

    Of the conspicuity map that is highest at the cell, the feature map that is highest there is
    taken. The region is its connected component of at least 5 % of the height at the cell, dilated
    by a disc.

    Args:
        maps: with features, as `contrast_saliency(..., keep_features=True)` gives them.
        row: of the cell in the saliency map.
        column: of the cell.

    Returns:
        (h, w) mask; None where the region would be empty or over a tenth of the map.

    Raises:
        ImageError: the maps hold no features, or the cell lies outside.
    """
    shape = maps.saliency.shape
    if not maps.features:
        raise ImageError("maps: expected features; compute them with keep_features=True")
    if not (0 <= row < shape[0] and 0 <= column < shape[1]):
        raise ImageError(f"cell: expected one of {shape[0]} x {shape[1]}, found {row}, {column}")
    winner = max(get_args(Conspicuity), key=lambda name: float(getattr(maps, name)[row, column]))
    features = [
        resize(feature.normalized, shape)
        for feature in maps.features
        if CONSPICUITY[feature.channel.name] == winner
    ]
    strongest = max(features, key=lambda values: float(values[row, column]))
    return region_around(strongest, row, column)


def region_around(values: FloatMap, row: int, column: int) -> Region | None:
    """The dilated connected component about a cell, above a fraction of its height.

    The fraction is 5 %, doubled while the region would be a tenth of the map or more; None where
    no fraction up to 1 suffices.
    """
    height = float(values[row, column])
    fraction = MIN_HEIGHT
    while height > 0 and fraction <= 1:
        above = (values >= fraction * height).astype(np.uint8)
        _, label = cv2.connectedComponents(above, connectivity=4)
        region = label == label[row, column]
        if region.sum() < MAX_AREA * region.size:
            y, x = np.ogrid[-MARGIN : MARGIN + 1, -MARGIN : MARGIN + 1]
            disc = (x**2 + y**2 <= MARGIN**2).astype(np.uint8)
            return np.asarray(cv2.dilate(region.astype(np.uint8), disc) > 0)
        fraction *= 2
    return None
