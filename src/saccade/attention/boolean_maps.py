"""Boolean map saliency: regions that are surrounded at many thresholds are salient.

After Zhang & Sclaroff (2013, 2016): the color channels of an image, decorrelated and of equal
variance, are thresholded at many values. In each Boolean map, regions of either value that do not
touch the image border are figure and the rest is ground. Each map is divided by its Euclidean norm,
the square root of its area, so that a small figure counts more.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention.channels import whitened
from saccade.attention.maps import SaliencyMaps
from saccade.attention.normalize import rescale
from saccade.errors import Settings, require, setting
from saccade.io.image import check_image, in_unit_range
from saccade.scale.pyramid import resize
from saccade.types import Image


@dataclass(frozen=True)
class BooleanConfig(Settings):
    """Size, thresholds and weights of the Boolean maps.

    The default predicts human fixations best; docs/boolean-maps.md describes how it was chosen.
    """

    longer_side: int = setting(200, 16, 4096)
    """Maximum longer side in pixels; larger images are reduced to it."""
    thresholds: int = setting(24, 1, 256)
    """Number of thresholds per channel, evenly spaced between its extremes."""
    dilation: int = setting(3, 1, 99)
    """Diameter in pixels, odd, of the disc that dilates the surrounded regions; 1 disables
    dilation."""
    smoothing: float = setting(0.03, 0, 1)
    """Standard deviation of the Gaussian that smooths the sum, as a fraction of the longer side."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.dilation % 2 == 1, "dilation", "an odd size", self.dilation)


@dataclass(frozen=True, eq=False, repr=False)
class BooleanMaps(SaliencyMaps):
    """Saliency by surroundedness: (h, w) float32 in [0, 1]."""


def boolean_saliency(
    image: Image, config: BooleanConfig | None = None, *, bgr: bool = False
) -> BooleanMaps:
    """Saliency from the regions that are surrounded in thresholded color channels.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        config: size, thresholds and weights.
        bgr: True for an image in OpenCV's channel order, as `cv2.imread` returns it.

    Returns:
        Saliency (h, w) at the size of the image reduced to `config.longer_side`.

    Raises:
        ImageError: not an image, or not finite.

    Source: Zhang & Sclaroff, *Exploiting surroundedness for saliency detection: a Boolean map
    approach* (TPAMI 2016).
    """
    return boolean_maps(check_image(image, bgr=bgr), config)


def boolean_maps(pixels: npt.NDArray[Any], config: BooleanConfig | None = None) -> BooleanMaps:
    """Boolean map saliency of a validated image; see `boolean_saliency`."""
    config = config or BooleanConfig()
    height, width = pixels.shape[:2]
    scale = min(1.0, config.longer_side / max(height, width))
    shape = max(1, round(height * scale)), max(1, round(width * scale))
    planes = whitened(resize(in_unit_range(pixels), shape))  # (h, w, c)

    summed = np.zeros(shape, np.float32)
    for plane in np.moveaxis(planes, 2, 0):
        low, high = float(plane.min()), float(plane.max())
        steps = (np.arange(config.thresholds) + 0.5) / config.thresholds
        for threshold in low + steps * (high - low) if high > low else ():
            above = plane > threshold
            for boolean_map in (above, ~above):
                figure = surrounded(boolean_map.view(np.uint8), config.dilation)
                area = cv2.countNonZero(figure)
                if area > 0:
                    summed += figure * np.float32(area**-0.5)
    sigma = config.smoothing * max(shape)
    if sigma > 0:
        summed = cv2.GaussianBlur(summed, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
    return BooleanMaps(rescale(summed), (height, width))


def surrounded(boolean_map: npt.NDArray[Any], dilation: int) -> npt.NDArray[Any]:
    """Dilated regions of ones that do not touch the border of a binary map (h, w)."""
    framed = cv2.copyMakeBorder(boolean_map, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
    cv2.floodFill(framed, None, (0, 0), 0, flags=8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (dilation, dilation))
    return cv2.dilate(framed[1:-1, 1:-1], disc)
