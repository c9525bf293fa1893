"""The scene of a simulated drive: brick outer walls, a plastered block, posters on both."""

from itertools import cycle

import cv2
import numpy as np

from saccade.simulation.drive_config import DriveConfig
from saccade.simulation.scene import Ground, Scene, Walls, build_scene
from saccade.simulation.textures import (
    Texture,
    all_posters,
    brick_wall,
    gravel_floor,
    mirror,
    plaster_wall,
)
from saccade.types import FloatArray

TEXELS = 180.0
"""Per metre of wall: at the smallest distance of the default course, at least one per pixel."""
GROUND_TEXELS = 160.0
"""Per metre of ground."""
CORNER = 0.35
"""Metres next to a corner without posters."""
FRAMES = ((38, 34, 32), (232, 228, 220), (110, 74, 46), (64, 76, 92))
"""RGB of the posters' frames."""


def ring_scene(config: DriveConfig, seed: np.random.SeedSequence) -> Scene:
    """The scene of a configuration; the drive starts at the origin along the x axis."""
    (width, depth), corridor = config.size, config.corridor
    outer, inner, floor, posters = (np.random.default_rng(s) for s in seed.spawn(4))
    around = _rectangle(-width / 2, -corridor / 2, width, depth)[::-1]
    block = _rectangle(
        corridor - width / 2, corridor / 2, width - 2 * corridor, depth - 2 * corridor
    )
    bands = []
    for corners, rng, wall in ((around, outer, brick_wall), (block, inner, plaster_wall)):
        length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
        shape = (round(config.wall_height * TEXELS), round(length * TEXELS))
        bands.append(Walls(corners, wall(shape, TEXELS, rng)))
    _paint_posters(config, bands, posters)
    shape = (round(depth * GROUND_TEXELS), round(width * GROUND_TEXELS))
    corner = np.array([-width / 2, depth - corridor / 2])
    ground = Ground(corner, gravel_floor(shape, floor), GROUND_TEXELS)
    return build_scene(bands, ground, config.wall_height, TEXELS, config.color)


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
    border = max(2, round(0.03 * TEXELS))
    frame = FRAMES[rng.integers(len(FRAMES))]
    poster = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    borders = (border, border, border, border)
    poster = cv2.copyMakeBorder(poster, *borders, cv2.BORDER_CONSTANT, value=frame)
    top = round((config.wall_height - center) * TEXELS) - poster.shape[0] // 2
    left = round(x * TEXELS) - poster.shape[1] // 2
    wall[top : top + poster.shape[0], left : left + poster.shape[1]] = poster
