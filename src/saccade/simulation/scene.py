"""The scene of a simulated drive: floor plan, walls with posters, ground, mipmaps in one atlas."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import as_file, files
from itertools import cycle
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from saccade.io.image import read_image
from saccade.simulation.drive_config import DriveConfig
from saccade.simulation.floor_plan import wall_outlines
from saccade.simulation.wall_tags import paint_tag, place_tags, tag_map
from saccade.types import Float32Array, FloatArray, IntArray, LandmarkMap

Texture = npt.NDArray[np.uint8]

PHOTOGRAPHS = {
    "astronaut": (2, 2),
    "hubble": (3, 3),
    "coffee": (2, 1),
    "rocket": (3, 1),
    "chelsea": (2, 1),
    "retina": (2, 2),
    "camera": (2, 1),
    "hallway_1": (1, 1),
    "horse": (1, 1),
    "hallway_2": (1, 1),
    "text": (1, 1),
}
"""Photographs of the package, and the columns and rows into which each is cut: posters are
disjoint parts."""

BRICK = (0.30, 0.09)
"""Width and height of a brick with its mortar in meters."""
MORTAR = 0.012
"""Width of the mortar in meters."""


def all_posters() -> list[Texture]:
    """All poster images, pairwise distinct."""
    return [part for name, cuts in PHOTOGRAPHS.items() for part in _cut(_photograph(name), *cuts)]


def mirror(image: Texture) -> Texture:
    """The left half of an image, continued by its mirror image."""
    left = image[:, : (image.shape[1] + 1) // 2]
    return np.concatenate([left, left[:, ::-1][:, image.shape[1] % 2 :]], 1)


def brick_wall(shape: tuple[int, int], texels: float, rng: np.random.Generator) -> Texture:
    """Bricks in running bond with random tone and grain; `texels` are per meter."""
    height, width = shape
    y = np.arange(height, dtype=np.float32) / np.float32(texels)
    x = np.arange(width, dtype=np.float32) / np.float32(texels)
    row = (y // BRICK[1]).astype(np.intp)  # (h,)
    columns = [((x + shift) // BRICK[0]).astype(np.intp) for shift in (0, BRICK[0] / 2)]
    drawn = (int(row[-1]) + 1, int(columns[1][-1]) + 1)
    tone = rng.normal(1, 0.14, drawn).astype(np.float32)
    colors = np.stack([rng.normal(0.53, 0.05, drawn) * tone, 0.37 * tone, 0.30 * tone], -1)
    edges = [_to_edge(x + shift, BRICK[0]) for shift in (0, BRICK[0] / 2)]
    upright, level = np.stack(edges)[row % 2], _to_edge(y, BRICK[1])[:, None]
    edge = np.minimum(upright, level) + 0.004 * _noise(shape, (6, 12), rng)  # rough
    inside = np.clip((edge - MORTAR / 2) / 0.006 + 0.5, 0, 1)
    grain = 1 + 0.11 * _noise(shape, (1, 2, 4, 10), rng)
    grain *= 1 + 0.10 * _noise(shape, (int(texels / 4), int(texels)), rng)
    wall = np.empty((*shape, 3), np.uint8)
    for channel, mortar in enumerate((0.62, 0.60, 0.56)):
        bricks = colors[:, :, channel].astype(np.float32)
        brick = np.stack([bricks[:, column] for column in columns])[row % 2, row]  # (h, w)
        wall[:, :, channel] = _as_bytes((mortar + inside * (brick - np.float32(mortar))) * grain)
    return wall


def plaster_wall(shape: tuple[int, int], texels: float, rng: np.random.Generator) -> Texture:
    """Rough plaster with stains, and a painted band at the bottom; `texels` are per meter."""
    shade = 1 + 0.05 * _noise(shape, (2, 5, 11), rng)
    shade *= 1 + 0.09 * _noise(shape, tuple(int(texels * m) for m in (0.15, 0.4, 1.2)), rng)
    shade[_noise(shape, (3, 6), rng) > 2.6] *= 0.75  # holes
    painted = shape[0] - int(0.28 * texels)
    wall = np.empty((*shape, 3), np.uint8)
    for channel, (bare, paint) in enumerate(((0.78, 0.42), (0.74, 0.45), (0.64, 0.47))):
        color = np.where(np.arange(shape[0]) < painted, bare, paint).astype(np.float32)
        wall[:, :, channel] = _as_bytes(color[:, None] * shade)
    return wall


def painted_surface(
    shape: tuple[int, int],
    texels: float,
    rng: np.random.Generator,
    color: tuple[float, float, float],
) -> Texture:
    """Smooth paint or linoleum of a color in [0, 1]: only its shade varies, over half a meter."""
    shade = 1 + 0.02 * _noise(shape, (int(texels / 2), int(2 * texels)), rng)
    return np.stack([_as_bytes(shade * np.float32(level)) for level in color], -1)


def gravel_floor(shape: tuple[int, int], rng: np.random.Generator) -> Texture:
    """Gravel: overlapping patches of one photograph, randomly rotated and mirrored."""
    stone = _photograph("gravel")[:, :, 0].astype(np.float32)
    side = min(stone.shape) // 2
    ramp = np.clip(np.sin(np.linspace(0, np.pi, side)) * 3, 0, 1).astype(np.float32)
    mask = ramp * ramp[:, None]
    step = side // 2
    height, width = shape
    floor = np.full((height + 2 * side, width + 2 * side), stone.mean(), np.float32)
    for top in range(0, height + side, step):
        for left in range(0, width + side, step):
            y, x = (int(rng.integers(0, length - side + 1)) for length in stone.shape)
            patch = np.rot90(stone[y : y + side, x : x + side], int(rng.integers(4)))
            patch = patch[:, :: int(rng.choice([-1, 1]))]
            target = floor[top : top + side, left : left + side]
            target += mask * (patch - target)
    floor = floor[side : side + height, side : side + width] / 255
    floor *= 1 + 0.12 * _noise(shape, (60, 160), rng)
    return np.stack([_as_bytes(floor * np.float32(tint)) for tint in (1.0, 0.97, 0.92)], -1)


def _photograph(name: str) -> Texture:
    with as_file(files("saccade") / "data" / f"{name}.jpg") as path:
        return _as_bytes(read_image(path))


def _cut(image: Texture, columns: int, rows: int) -> Iterator[Texture]:
    height, width = (image.shape[0] // rows, image.shape[1] // columns)
    for top in range(rows):
        for left in range(columns):
            yield image[top * height : (top + 1) * height, left * width : (left + 1) * width]


def _to_edge(x: Float32Array, period: float) -> Float32Array:
    """Distance to the nearest multiple of a period."""
    return np.asarray(np.abs((x + period / 2) % period - period / 2), np.float32)


def _noise(
    shape: tuple[int, int], grains: tuple[int, ...], rng: np.random.Generator
) -> Float32Array:
    """(h, w) noise of zero mean and unit variance, equal parts of each grain size in texels."""
    total = np.zeros(shape, np.float32)
    for grain in grains:
        size = [max(2, -(-side // max(grain, 1)) + 1) for side in shape]
        noise = rng.standard_normal(size, np.float32)
        total += cv2.resize(noise, shape[::-1], interpolation=cv2.INTER_CUBIC)
    total -= total.mean()
    total /= total.std()
    return total


def _as_bytes(image: npt.NDArray[np.floating]) -> Texture:
    """Intensities in [0, 1] as bytes, rounded and saturated."""
    return np.asarray(cv2.convertScaleAbs(np.maximum(image, 0), alpha=255), np.uint8)


PAINT = (0.72, 0.70, 0.64)
"""Color of indoor walls."""
LINOLEUM = (0.34, 0.36, 0.38)
"""Color of indoor floors."""
SKY = (206, 217, 230)
"""RGB."""
ACROSS = 6
"""Number of mipmap levels of a wall's texture across, each half as wide as the last."""
DOWN = 4
"""Number of mipmap levels of a wall's texture down."""
GROUND = 6
"""Number of mipmap levels of the ground's texture."""
TEXELS = 180.0
"""Texels per meter of wall: on the default course at least one per pixel."""
GROUND_TEXELS = 160.0
"""Texels per meter of ground."""
CORNER = 0.35
"""Meters next to a corner without posters."""
POSTERS_PER_GROUP = 3
"""Number of posters of a group in a hall."""
POSTER_FRAMES = ((38, 34, 32), (232, 228, 220), (110, 74, 46), (64, 76, 92))
"""RGB of the posters' frames."""


class Walls(NamedTuple):
    """Connected walls along a polyline, visible from its right."""

    corners: FloatArray
    """(k, 2) of the line, in meters; walls run from each to the next."""
    texture: Texture
    """(h, w, 3) front view from the first corner on; its bottom row is at the ground."""


class Ground(NamedTuple):
    """A piece of level ground."""

    corner: FloatArray
    """(2,) smallest x and largest y in meters, the top-left corner of the texture."""
    texture: Texture
    """(h, w, 3) top view, x to the right and y up."""
    texels: float
    """Per meter."""


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
    """(m, 2) left end of each wall as seen from its front, in meters."""
    end: FloatArray
    """(m, 2) right end."""
    offset: FloatArray
    """(m,) meters along its band to the left end of each wall."""
    band: IntArray
    """(m,) band of each wall."""
    wall_height: float
    """Meters, of all walls."""
    wall_texels: float
    """Per meter of wall."""
    wall_levels: tuple[MipmapLevels, ...]
    """Mipmaps of each band of walls; the row above each level is sky."""
    ground: Ground
    """The ground."""
    ground_levels: MipmapLevels
    """Mipmaps of the ground; only isotropic levels are filled."""
    atlas: npt.NDArray[np.uint8]
    """(H, W) gray or (H, W, 3) RGB: all textures at all levels."""
    tags: LandmarkMap | None = None
    """True positions of the tags on the walls; None without tags."""


def build_scene(
    bands: Sequence[Walls], ground: Ground, wall_height: float, texels: float, color: bool
) -> Scene:
    """The scene of bands of walls on the ground, and its texture atlas, gray or RGB.

    The textures of walls have `texels` per meter, and a height of `wall_height` meters.
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
    streams = [np.random.default_rng(each) for each in seed.spawn(6)]
    outer, inner, floor, posters, plan, placed = streams
    outlines, bands = wall_outlines(config, plan), []
    indoors, smooth = config.world != "ring", partial(painted_surface, color=PAINT)
    walls = (smooth, smooth) if indoors else (brick_wall, plaster_wall)
    for k, corners in enumerate(outlines):
        wall, rng = walls[min(k, 1)], (outer, inner)[min(k, 1)]
        length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
        shape = (round(config.wall_height * TEXELS), round(length * TEXELS))
        bands.append(Walls(corners, wall(shape, TEXELS, rng)))
    taken = _paint_posters(config, bands, posters)
    tags = place_tags(config, outlines[0], taken, placed)
    for tag in tags:
        paint_tag(bands[0].texture, tag, config.tag_size, TEXELS)
    low, high = outlines[0].min(0), outlines[0].max(0)
    width, depth = high - low
    shape = (round(depth * GROUND_TEXELS), round(width * GROUND_TEXELS))
    corner = np.array([low[0], high[1]])
    if indoors:
        texture = painted_surface(shape, GROUND_TEXELS, floor, LINOLEUM)
    else:
        texture = gravel_floor(shape, floor)
    ground = Ground(corner, texture, GROUND_TEXELS)
    scene = build_scene(bands, ground, config.wall_height, TEXELS, config.color)
    return replace(scene, tags=tag_map(tags, outlines[0])) if tags else scene


def poster_images(config: DriveConfig, rng: np.random.Generator) -> list[Texture]:
    """The distinct poster images of a scene, in random order."""
    images = all_posters()
    order = rng.permutation(len(images))[: config.posters]
    return [mirror(images[k]) if config.mirrored_posters else images[k] for k in order]


def _paint_posters(
    config: DriveConfig, bands: list[Walls], rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Paint posters onto the walls, cycling through the images.

    Returns the positions and largest widths of those on the first walls, in meters.
    """
    images, first = cycle(poster_images(config, rng)), list[tuple[float, float]]()
    for k, walls in enumerate(bands):
        groups = k == 0 and config.world == "hall"
        places = _grouped_posters(config, rng) if groups else _spaced_posters(config, walls, rng)
        for center, width in places:
            _paint(config, walls.texture, next(images), center, width, rng)
            first += [(center, width)] * (k == 0)
    return first


def _spaced_posters(
    config: DriveConfig, walls: Walls, rng: np.random.Generator
) -> Iterator[tuple[float, float]]:
    """Positions and largest widths in meters of posters all along walls."""
    start = 0.0
    for length in np.hypot(*np.diff(walls.corners, axis=0).T):
        space = length - 2 * CORNER
        count = max(1, int(space / config.poster_spacing)) if space > 0.5 else 0
        for k in range(count):
            center = start + CORNER + space * (k + 0.5) / count
            yield center + rng.uniform(-0.12, 0.12) * space / count, space / count
        start += length


def _grouped_posters(
    config: DriveConfig, rng: np.random.Generator
) -> Iterator[tuple[float, float]]:
    """Positions and largest widths of grouped posters on the outer walls of a hall."""
    (width, depth), spacing = config.size, config.poster_spacing
    ends = np.cumsum([0.0, depth, width, depth, width])
    margin = CORNER + POSTERS_PER_GROUP / 2 * spacing
    ahead = ends[3] - config.corridor / 2  # of the start
    for k in range(config.poster_groups):
        drawn = rng.uniform(-0.3, 0.3) if k else 0.0
        position = (ahead + (k + drawn) / config.poster_groups * ends[-1]) % ends[-1]
        wall = np.searchsorted(ends, position, side="right") - 1
        position = np.clip(position, ends[wall] + margin, ends[wall + 1] - margin)
        for i in range(POSTERS_PER_GROUP):
            yield position + (i - (POSTERS_PER_GROUP - 1) / 2) * spacing, spacing


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
    frame = POSTER_FRAMES[rng.integers(len(POSTER_FRAMES))]
    poster = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    borders = (border, border, border, border)
    poster = cv2.copyMakeBorder(poster, *borders, cv2.BORDER_CONSTANT, value=frame)
    top = round((config.wall_height - center) * TEXELS) - poster.shape[0] // 2
    left = round(x * TEXELS) - poster.shape[1] // 2
    wall[top : top + poster.shape[0], left : left + poster.shape[1]] = poster
