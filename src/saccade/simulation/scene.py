"""The scene of a simulated drive: walls with posters, level ground, mipmaps in one atlas."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from saccade.simulation.drive_config import DriveConfig
from saccade.simulation.floor_plans import OUTLINES
from saccade.simulation.textures import (
    Texture,
    all_posters,
    brick_wall,
    gravel_floor,
    mirror,
    painted_surface,
    plaster_wall,
)
from saccade.types import FloatArray, IntArray

PAINT, LINOLEUM = (0.72, 0.70, 0.64), (0.34, 0.36, 0.38)
"""Colors of indoor walls and floors."""
SKY = (206, 217, 230)
"""RGB."""
ACROSS, DOWN, GROUND = 6, 4, 6
"""Mipmap levels of a wall's texture across and down, each half the one before; the ground's."""
TEXELS, GROUND_TEXELS = 180.0, 160.0
"""Per metre of wall and of ground: on the default course at least one per pixel of a wall."""
CORNER = 0.35
"""Metres next to a corner without posters."""
FRAMES = ((38, 34, 32), (232, 228, 220), (110, 74, 46), (64, 76, 92))
"""RGB of the posters' frames."""


@dataclass(frozen=True, eq=False, repr=False)
class Walls:
    """Connected walls along a polyline, visible from its right."""

    corners: FloatArray
    """(k, 2) of the line, in metres; walls run from each to the next."""
    texture: Texture
    """(h, w, 3) front view from the first corner on; its bottom row is at the ground."""


@dataclass(frozen=True, eq=False, repr=False)
class Ground:
    """A piece of level ground."""

    corner: FloatArray
    """(2,) smallest x and largest y in metres, the top-left corner of the texture."""
    texture: Texture
    """(h, w, 3) top view, x to the right and y up."""
    texels: float
    """Per metre."""


class MipmapLevels(NamedTuple):
    """Positions of the mipmap levels of one texture in the atlas: i across, j down."""

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
    """Geometry and textures of a scene with m walls.

    Wall textures are anisotropic mipmaps, halved across and down independently: at oblique angles
    a wall is compressed across far more than down.
    """

    start: FloatArray
    """(m, 2) left end of each wall as seen from its front, in metres."""
    end: FloatArray
    """(m, 2) right end."""
    offset: FloatArray
    """(m,) metres along its band to the left end of each wall."""
    band: IntArray
    """(m,) band of each wall."""
    wall_height: float
    """Metres, of all walls."""
    wall_texels: float
    """Per metre of wall."""
    wall_levels: tuple[MipmapLevels, ...]
    """Of each band of walls; the row above each level is sky."""
    ground: Ground
    """The ground."""
    ground_levels: MipmapLevels
    """Of the ground; only isotropic levels are filled."""
    atlas: npt.NDArray[np.uint8]
    """(H, W) gray or (H, W, 3) RGB: all textures at all levels."""


def build_scene(
    bands: Sequence[Walls], ground: Ground, wall_height: float, texels: float, color: bool
) -> Scene:
    """The scene of bands of walls on the ground, and its texture atlas, gray or RGB.

    The textures of walls have `texels` per metre, and a height of `wall_height` metres.
    """
    rows, levels = 0, []
    textures = [(walls.texture, ACROSS, DOWN) for walls in bands]
    for texture, across, down in [*textures, (ground.texture, GROUND, GROUND)]:
        levels.append(_layout(texture.shape, across, down, rows))
        rows = int(levels[-1].top[-1] + levels[-1].height[-1] + 1)
    columns = max(int(each.left[-1] + each.width[-1] + 1) for each in levels)
    *wall_levels, ground_levels = levels
    shape = (rows, columns, 3) if color else (rows, columns)
    atlas = np.zeros(shape, np.uint8)
    sky = _to_atlas(np.array([[SKY]], np.uint8), color)[0, 0]
    for walls, positions in zip(bands, wall_levels, strict=True):
        narrow = _pad(_to_atlas(walls.texture, color), positions)
        for i in range(ACROSS):
            short = narrow
            for j in range(DOWN):
                _put(atlas, short, positions, i, j)
                short = _halve(short, across=False)
            narrow = _halve(narrow, across=True)
        for row in positions.top - 1:
            atlas[row] = sky
    image = _pad(_to_atlas(ground.texture, color), ground_levels)
    for i in range(GROUND):
        _put(atlas, image, ground_levels, i, i)
        image = _halve(_halve(image, across=True), across=False)
    length = [np.hypot(*np.diff(walls.corners, axis=0).T) for walls in bands]
    return Scene(
        start=np.concatenate([walls.corners[:-1] for walls in bands]),
        end=np.concatenate([walls.corners[1:] for walls in bands]),
        offset=np.concatenate([np.cumsum(lengths) - lengths for lengths in length]),
        band=np.repeat(np.arange(len(bands)), [len(lengths) for lengths in length]),
        wall_height=wall_height,
        wall_texels=texels,
        wall_levels=tuple(wall_levels),
        ground=ground,
        ground_levels=ground_levels,
        atlas=atlas,
    )


def _layout(shape: tuple[int, ...], across: int, down: int, row: int) -> MipmapLevels:
    """Positions of the levels of a texture below a row of the atlas, padded by a texel."""
    height, width = (
        -(-side // 2 ** (levels - 1)) * 2 ** (levels - 1) >> np.arange(levels)
        for side, levels in ((shape[0], down), (shape[1], across))
    )
    left = 1 + np.concatenate([[0], np.cumsum(width + 2)[:-1]])
    top = row + 1 + np.concatenate([[0], np.cumsum(height + 2)[:-1]])
    return MipmapLevels(left, top, width, height)


def _to_atlas(texture: Texture, color: bool) -> npt.NDArray[np.uint8]:
    return texture if color else np.asarray(cv2.cvtColor(texture, cv2.COLOR_RGB2GRAY), np.uint8)


def _pad(image: npt.NDArray[np.uint8], levels: MipmapLevels) -> npt.NDArray[np.uint8]:
    """Repeat the last row and column, so that all sizes can be halved exactly."""
    below, right = int(levels.height[0]) - image.shape[0], int(levels.width[0]) - image.shape[1]
    return np.asarray(cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_REPLICATE), np.uint8)


def _halve(image: npt.NDArray[np.uint8], across: bool) -> npt.NDArray[np.uint8]:
    height, width = image.shape[:2]
    size = (width // 2, height) if across else (width, height // 2)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _put(
    atlas: npt.NDArray[np.uint8], image: npt.NDArray[np.uint8], levels: MipmapLevels, i: int, j: int
) -> None:
    """Copy a level to its position in the atlas, with replicated borders."""
    framed = cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    top, left = levels.top[j] - 1, levels.left[i] - 1
    atlas[top : top + framed.shape[0], left : left + framed.shape[1]] = framed


def floor_scene(config: DriveConfig, seed: np.random.SeedSequence) -> Scene:
    """The scene of a configuration; a ring's drive starts at the origin along the x axis."""
    outer, inner, floor, posters = (np.random.default_rng(s) for s in seed.spawn(4))
    indoors = config.world != "ring"
    outlines = OUTLINES[config.world] if indoors else _ring(config)
    bands = []
    walls = ((outer, painted_wall if indoors else brick_wall), (inner, plaster_wall))
    for corners, (rng, wall) in zip(outlines, walls, strict=False):
        length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
        shape = (round(config.wall_height * TEXELS), round(length * TEXELS))
        bands.append(Walls(corners, wall(shape, TEXELS, rng)))
    _paint_posters(config, bands, posters)
    low, high = outlines[0].min(0), outlines[0].max(0)
    width, depth = high - low
    shape = (round(depth * GROUND_TEXELS), round(width * GROUND_TEXELS))
    corner = np.array([low[0], high[1]])
    if indoors:
        texture = painted_surface(shape, GROUND_TEXELS, LINOLEUM, floor)
    else:
        texture = gravel_floor(shape, floor)
    ground = Ground(corner, texture, GROUND_TEXELS)
    return build_scene(bands, ground, config.wall_height, TEXELS, config.color)


def painted_wall(shape: tuple[int, int], texels: float, rng: np.random.Generator) -> Texture:
    """A smooth wall."""
    return painted_surface(shape, texels, PAINT, rng)


def _ring(config: DriveConfig) -> list[FloatArray]:
    """Outlines of the outer walls and of the central block."""
    (width, depth), corridor = config.size, config.corridor
    around = _rectangle(-width / 2, -corridor / 2, width, depth)[::-1]
    block = _rectangle(
        corridor - width / 2, corridor / 2, width - 2 * corridor, depth - 2 * corridor
    )
    return [around, block]


def _rectangle(x: float, y: float, width: float, depth: float) -> FloatArray:
    """(5, 2) corners, counterclockwise from the minimum of x and y, closed."""
    right, far = x + width, y + depth
    return np.array([[x, y], [right, y], [right, far], [x, far], [x, y]])


def poster_images(config: DriveConfig, rng: np.random.Generator) -> list[Texture]:
    """The distinct poster images of a scene, in random order."""
    images = all_posters()
    order = rng.permutation(len(images))[: config.posters]
    return [mirror(images[k]) if config.mirrored_posters else images[k] for k in order]


def _paint_posters(config: DriveConfig, bands: list[Walls], rng: np.random.Generator) -> None:
    """Paint posters onto the walls, cycling through the images."""
    images = cycle(poster_images(config, rng))
    for walls in bands:
        start = 0.0
        for length in np.hypot(*np.diff(walls.corners, axis=0).T):
            space = length - 2 * CORNER
            count = max(1, int(space / config.poster_spacing)) if space > 0.5 else 0
            for k in range(count):
                center = start + CORNER + space * (k + 0.5) / count
                center += rng.uniform(-0.12, 0.12) * space / count
                _paint(config, walls.texture, next(images), center, space / count, rng)
            start += length


def _paint(
    config: DriveConfig,
    wall: Texture,
    image: Texture,
    x: float,
    max_width: float,
    rng: np.random.Generator,
) -> None:
    """Paint one poster onto the texture of a wall, centered at `x` and near the camera's height."""
    low, high = 0.12, config.wall_height - 0.12
    aspect = image.shape[1] / image.shape[0]
    area = rng.uniform(0.55, 1.0)
    height = min(np.sqrt(area / aspect), high - low, 0.8 * max_width / aspect)
    center = config.camera_height + rng.uniform(-0.1, 0.35)
    center = float(np.clip(center, low + height / 2, high - height / 2))
    size = (round(height * aspect * TEXELS), round(height * TEXELS))
    border = round(0.03 * TEXELS)
    frame = FRAMES[rng.integers(len(FRAMES))]
    poster = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    borders = (border, border, border, border)
    poster = cv2.copyMakeBorder(poster, *borders, cv2.BORDER_CONSTANT, value=frame)
    top = round((config.wall_height - center) * TEXELS) - poster.shape[0] // 2
    left = round(x * TEXELS) - poster.shape[1] // 2
    wall[top : top + poster.shape[0], left : left + poster.shape[1]] = poster
