"""Textures of brick, plaster and gravel, and poster images; all (h, w, 3) uint8 RGB."""

from collections.abc import Iterator
from importlib.resources import as_file, files

import cv2
import numpy as np
import numpy.typing as npt

from saccade.io.image import read_image
from saccade.types import Float32Array

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

BRICK, MORTAR = (0.30, 0.09), 0.012
"""Width and height of a brick with its mortar, and width of the mortar, in metres."""


def all_posters() -> list[Texture]:
    """All poster images, pairwise distinct."""
    return [part for name, cuts in PHOTOGRAPHS.items() for part in _cut(_photograph(name), *cuts)]


def mirror(image: Texture) -> Texture:
    """The left half of an image, continued by its mirror image."""
    left = image[:, : (image.shape[1] + 1) // 2]
    return np.concatenate([left, left[:, ::-1][:, image.shape[1] % 2 :]], 1)


def brick_wall(shape: tuple[int, int], texels: float, rng: np.random.Generator) -> Texture:
    """Bricks in running bond with random tone and grain; `texels` are per metre."""
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
    """Rough plaster with stains, and a painted band at the bottom; `texels` are per metre."""
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
    color: tuple[float, float, float],
    rng: np.random.Generator,
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
