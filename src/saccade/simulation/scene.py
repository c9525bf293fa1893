"""A place of upright walls on level ground, with the textures on them at every scale."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from saccade.simulation.textures import Texture
from saccade.types import FloatArray, IntArray

SKY = (206, 217, 230)
"""RGB."""
ACROSS, DOWN = 6, 4
"""Scales of a wall's texture, each half the one before."""
GROUND = 6
"""Scales of the ground's texture."""


@dataclass(frozen=True, eq=False, repr=False)
class Walls:
    """A band of walls that stand on a line and are seen from its right."""

    corners: FloatArray
    """(k, 2) of the line, in metres; walls run from each to the next."""
    texture: Texture
    """(h, w, 3) seen from the front, from the first corner on; its bottom stands on the ground."""


@dataclass(frozen=True, eq=False, repr=False)
class Ground:
    """A piece of level ground."""

    corner: FloatArray
    """(2,) least x and greatest y, in metres, where its texture begins."""
    texture: Texture
    """(h, w, 3) seen from above, x to the right and y up."""
    texels: float
    """Per metre."""


@dataclass(frozen=True, eq=False, repr=False)
class Scales:
    """Where in the atlas the scales of one texture are: scale i across, j down."""

    left: IntArray
    """(across,) column of the first texel."""
    top: IntArray
    """(down,) row of the first texel."""
    width: IntArray
    """(across,) texels."""
    height: IntArray
    """(down,) texels."""


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """Everything there is to see, the m walls of all bands in one list.

    A wall's texture is halved across and down independently: at a slant it is seen far more
    crowded across than down.
    """

    start: FloatArray
    """(m, 2) left end of each wall as one faces it, in metres."""
    end: FloatArray
    """(m, 2) right end."""
    offset: FloatArray
    """(m,) metres along its band at which each begins."""
    band: IntArray
    """(m,) to which each belongs."""
    wall_height: float
    """Metres, of all walls."""
    wall_texels: float
    """Per metre of wall."""
    wall_scales: tuple[Scales, ...]
    """Of each band; above the first row of each scale is a row of sky."""
    ground: Ground
    """Its place."""
    ground_scales: Scales
    """Only those that are halved as often across as down are filled."""
    atlas: npt.NDArray[np.uint8]
    """(H, W) grey or (H, W, 3) RGB: all textures at all scales."""


def build_scene(
    bands: Sequence[Walls], ground: Ground, wall_height: float, texels: float, color: bool
) -> Scene:
    """Put walls on the ground.

    Args:
        bands: whose textures are `texels * wall_height` high.
        ground: under all of them.
        wall_height: metres.
        texels: per metre of wall.
        color: whether the scene is seen in color.
    """
    columns, rows = 0, 0
    scales = []
    for walls in bands:
        scales.append(_lay_out(walls.texture.shape, ACROSS, DOWN, rows))
        columns, rows = max(columns, _right(scales[-1])), _bottom(scales[-1])
    ground_scales = _lay_out(ground.texture.shape, GROUND, GROUND, rows)
    columns, rows = max(columns, _right(ground_scales)), _bottom(ground_scales)
    shape = (rows, columns, 3) if color else (rows, columns)
    atlas = np.zeros(shape, np.uint8)
    sky = _seen(np.array([[SKY]], np.uint8), color)[0, 0]
    for walls, where in zip(bands, scales, strict=True):
        narrow = _padded(_seen(walls.texture, color), where)
        for i in range(ACROSS):
            short = narrow
            for j in range(DOWN):
                _put(atlas, short, where, i, j)
                short = _halved(short, across=False)
            narrow = _halved(narrow, across=True)
        for above in where.top - 1:
            atlas[above] = sky
    picture = _padded(_seen(ground.texture, color), ground_scales)
    for i in range(GROUND):
        _put(atlas, picture, ground_scales, i, i)
        picture = _halved(_halved(picture, across=True), across=False)
    length = [np.hypot(*np.diff(walls.corners, axis=0).T) for walls in bands]
    return Scene(
        start=np.concatenate([walls.corners[:-1] for walls in bands]),
        end=np.concatenate([walls.corners[1:] for walls in bands]),
        offset=np.concatenate([np.cumsum(each) - each for each in length]),
        band=np.repeat(np.arange(len(bands)), [len(each) for each in length]),
        wall_height=wall_height,
        wall_texels=texels,
        wall_scales=tuple(scales),
        ground=ground,
        ground_scales=ground_scales,
        atlas=atlas,
    )


def _lay_out(shape: tuple[int, ...], across: int, down: int, row: int) -> Scales:
    """Room for the scales of a texture from a row of the atlas on, a texel between them."""
    height, width = (
        -(-side // 2 ** (scales - 1)) * 2 ** (scales - 1) >> np.arange(scales)
        for side, scales in ((shape[0], down), (shape[1], across))
    )
    left = 1 + np.concatenate([[0], np.cumsum(width + 2)[:-1]])
    top = row + 1 + np.concatenate([[0], np.cumsum(height + 2)[:-1]])
    return Scales(left, top, width, height)


def _right(scales: Scales) -> int:
    return int(scales.left[-1] + scales.width[-1] + 1)


def _bottom(scales: Scales) -> int:
    return int(scales.top[-1] + scales.height[-1] + 1)


def _seen(texture: Texture, color: bool) -> npt.NDArray[np.uint8]:
    return texture if color else np.asarray(cv2.cvtColor(texture, cv2.COLOR_RGB2GRAY), np.uint8)


def _padded(picture: npt.NDArray[np.uint8], scales: Scales) -> npt.NDArray[np.uint8]:
    """With its last row and column repeated, so that halving never leaves half a texel."""
    below, right = scales.height[0] - picture.shape[0], scales.width[0] - picture.shape[1]
    return np.asarray(
        cv2.copyMakeBorder(picture, 0, int(below), 0, int(right), cv2.BORDER_REPLICATE), np.uint8
    )


def _halved(picture: npt.NDArray[np.uint8], across: bool) -> npt.NDArray[np.uint8]:
    height, width = picture.shape[:2]
    size = (width // 2, height) if across else (width, height // 2)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def _put(
    atlas: npt.NDArray[np.uint8], picture: npt.NDArray[np.uint8], scales: Scales, i: int, j: int
) -> None:
    """Put a scale where it belongs, its edges repeated once around it."""
    framed = cv2.copyMakeBorder(picture, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    top, left = scales.top[j] - 1, scales.left[i] - 1
    atlas[top : top + framed.shape[0], left : left + framed.shape[1]] = framed
