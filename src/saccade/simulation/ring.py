"""The ring through which a simulated drive goes: brick outside, plaster inside, posters on both."""

import cv2
import numpy as np

from saccade.simulation.drive_config import DriveConfig
from saccade.simulation.scene import Ground, Scene, Walls, build_scene
from saccade.simulation.textures import (
    Texture,
    brick_wall,
    gravel_floor,
    mirrored,
    pictures,
    plaster_wall,
)
from saccade.types import FloatArray

TEXELS = 180.0
"""Per metre of wall: as near as the default course comes to a wall, a pixel sees at least one."""
GROUND_TEXELS = 160.0
"""Per metre of ground."""
CORNER = 0.35
"""Metres next to a corner where no poster hangs."""
FRAMES = ((38, 34, 32), (232, 228, 220), (110, 74, 46), (64, 76, 92))
"""RGB of the posters' frames."""


def ring_scene(config: DriveConfig, seed: np.random.SeedSequence) -> Scene:
    """The ring of a configuration; the drive starts at the origin and runs along x."""
    (width, depth), corridor = config.size, config.corridor
    outer, inner, floor, hanging = (np.random.default_rng(each) for each in seed.spawn(4))
    around = _rectangle(-width / 2, -corridor / 2, width, depth)[::-1]
    block = _rectangle(
        corridor - width / 2, corridor / 2, width - 2 * corridor, depth - 2 * corridor
    )
    bands = []
    for corners, rng, wall in ((around, outer, brick_wall), (block, inner, plaster_wall)):
        length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
        shape = (round(config.wall_height * TEXELS), round(length * TEXELS))
        bands.append(Walls(corners, wall(shape, TEXELS, rng)))
    _hang_posters(config, bands, hanging)
    shape = (round(depth * GROUND_TEXELS), round(width * GROUND_TEXELS))
    corner = np.array([-width / 2, depth - corridor / 2])
    ground = Ground(corner, gravel_floor(shape, floor), GROUND_TEXELS)
    return build_scene(bands, ground, config.wall_height, TEXELS, config.color)


def _rectangle(x: float, y: float, width: float, depth: float) -> FloatArray:
    """(5, 2) corners, counterclockwise from the one with least x and y, back to it."""
    right, far = x + width, y + depth
    return np.array([[x, y], [right, y], [right, far], [x, far], [x, y]])


def chosen_pictures(config: DriveConfig, rng: np.random.Generator) -> list[Texture]:
    """The pictures of a ring, in the order in which they hang."""
    there = pictures()
    order = rng.permutation(len(there))[: config.posters or len(there)]
    return [mirrored(there[k]) if config.mirrored else there[k] for k in order]


def _hang_posters(config: DriveConfig, bands: list[Walls], rng: np.random.Generator) -> None:
    """Paint posters onto walls; when the pictures are used up they begin anew."""
    chosen = chosen_pictures(config, rng)
    hung = 0
    for walls in bands:
        start = 0.0
        for length in np.hypot(*np.diff(walls.corners, axis=0).T):
            room = length - 2 * CORNER
            count = max(1, int(room / config.spacing)) if room > 0.5 else 0
            for k in range(count):
                middle = start + CORNER + room * (k + 0.5) / count
                middle += rng.uniform(-0.12, 0.12) * room / count
                picture = chosen[hung % len(chosen)]
                _hang(config, walls.texture, picture, middle, room / count, rng)
                hung += 1
            start += length


def _hang(
    config: DriveConfig,
    wall: Texture,
    picture: Texture,
    middle: float,
    room: float,
    rng: np.random.Generator,
) -> None:
    """Paint one poster onto the texture of a wall, at about the camera's height."""
    low, high = 0.12, config.wall_height - 0.12
    aspect = picture.shape[1] / picture.shape[0]
    area = rng.uniform(0.55, 1.0)
    tall = min(np.sqrt(area / aspect), high - low, 0.8 * room / aspect)
    center = config.camera_height + rng.uniform(-0.1, 0.35)
    center = float(np.clip(center, low + tall / 2, high - tall / 2))
    size = (round(tall * aspect * TEXELS), round(tall * TEXELS))
    border = max(2, round(0.03 * TEXELS))
    frame = FRAMES[rng.integers(len(FRAMES))]
    poster = cv2.copyMakeBorder(
        cv2.resize(picture, size, interpolation=cv2.INTER_AREA),
        border,
        border,
        border,
        border,
        cv2.BORDER_CONSTANT,
        value=frame,
    )
    top = round((config.wall_height - center) * TEXELS) - poster.shape[0] // 2
    left = round(middle * TEXELS) - poster.shape[1] // 2
    wall[top : top + poster.shape[0], left : left + poster.shape[1]] = poster
