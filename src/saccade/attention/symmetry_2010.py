"""The levels of the authors' symmetry release of 2010, inferred from its output.

What differs from the mirrored pyramid of `saccade.attention.symmetry`, and is needed for the
same numbers:

- The weights of red and blue in gray are exchanged, and gray is rounded to 8 bit and divided by
  256. Without the former the maps of colored images correlate by .84 at worst.
- A level is the previous one filtered by [1 2 1] / 4 along both axes and resized bilinearly. Its
  sides are half of the previous, rounded down up to the finest level that counts, and from there
  on to the nearest integer, ties to even.
- Gradients reflect about the center of the outermost pixel.
- The ring of pairs reaches from 3 to 7 pixels: the given radius of 8 is exclusive.

Left out are its tables of logarithms and cosines: they cost at most 4e-4 of correlation, where
all symmetries are the faint ones of a flat background.

Source: the release that accompanies Kootstra, de Boer & Schomaker (2011); no code of it was read.
"""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention.symmetry_config import SymmetryConfig
from saccade.io.image import in_unit_range
from saccade.scale.pyramid import FloatMap, resize

SWAPPED_LUMA = (0.114, 0.587, 0.299)
"""Weights of red, green and blue in gray."""


class Kootstra2010Pyramid:
    """The gray levels of the release of 2010; see the head of this file."""

    border = cv2.BORDER_REFLECT_101

    def __init__(self, config: SymmetryConfig) -> None:
        self.finest = config.levels[0]

    def level_shape(self, shape: tuple[int, int], level: int) -> tuple[int, int]:
        """Shape of a level; the image is level 0."""
        height, width = shape
        for number in range(1, level + 1):
            floor = number <= self.finest
            height, width = (side // 2 if floor else round(side / 2) for side in (height, width))
        return height, width

    def channels(self, pixels: npt.NDArray[Any], levels: tuple[int, ...]) -> dict[int, FloatMap]:
        """(h, w, 1) gray by level."""
        gray = in_unit_range(pixels)
        if gray.ndim == 3:
            gray = cv2.transform(gray, np.array([SWAPPED_LUMA]))
        plane = np.rint(255 * gray) / np.float32(256)
        planes = {}
        for number in range(levels[-1] + 1):
            if number > 0:
                plane = cv2.GaussianBlur(plane, (3, 3), 0, borderType=cv2.BORDER_REPLICATE)
                shape = self.level_shape(pixels.shape[:2], number)
                plane = resize(plane, shape, cv2.INTER_LINEAR)
            if number in levels:
                planes[number] = plane[:, :, None]
        return planes
