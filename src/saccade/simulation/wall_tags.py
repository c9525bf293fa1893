"""Tags on the walls of a simulated drive."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from saccade.simulation.drive_config import DriveConfig
from saccade.tags import tag_cells
from saccade.types import FloatArray, LandmarkMap

FAMILY = "tag36h11"
"""Family of the tags."""
CLEARANCE = 0.1
"""Minimum distance of a tag with its border from a corner, in meters."""
CANDIDATES = 40
"""Number of positions that are tried for a tag in its section of the walls."""
MAX_ABOVE = 0.4
"""Maximum height of a tag above the camera, in meters."""
INK = (28.0, 238.0)
"""Gray levels of black and white."""
FINE = 16
"""Samples per texel along each side of a tag before it is averaged."""


class WallTag(NamedTuple):
    """A tag on a wall."""

    id: int
    along: float
    """Meters along the walls to its center."""
    height: float
    """Meters above the ground."""


def place_tags(
    config: DriveConfig,
    corners: FloatArray,
    posters: Sequence[tuple[float, float]],
    rng: np.random.Generator,
) -> list[WallTag]:
    """Places tags along connected walls, one in each of `config.tags` sections of equal length.

    Args:
        config: settings of the drive.
        corners: (k, 2) of the walls in meters.
        posters: center and width in meters of what hangs there, which a tag avoids if it can.
        rng: source of the positions.
    """
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    half = config.tag_size * 0.625 + CLEARANCE  # with the border of a cell on each side
    found = []
    for k in range(config.tags):
        along = (k + rng.random(CANDIDATES)) / config.tags * ends[-1]
        above = rng.uniform(0.0, MAX_ABOVE)
        to_corner = np.abs(along[:, None] - ends).min(1) - half
        to_poster = [np.abs(along - center) - width / 2 - half for center, width in posters]
        free = np.minimum(to_corner, np.min([np.full(CANDIDATES, 1.0), *to_poster], axis=0))
        best = int(np.argmax(free > 0)) if (free > 0).any() else int(np.argmax(to_corner))
        if to_corner[best] > 0:
            low, high = half, config.wall_height - half
            height = float(np.clip(config.camera_height + above, low, high))
            found.append(WallTag(k, float(along[best]), height))
    return found


def paint_tag(
    wall: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], tag: WallTag, size: float, texels: float
) -> None:
    """Paint a tag of a size in meters, with its border, onto the texture (h, w, 3) of walls."""
    cells = np.pad(tag_cells(FAMILY, tag.id), 1, constant_values=True)
    image = np.where(cells, INK[1], INK[0]).astype(np.float32)
    side = size * len(cells) / (len(cells) - 2) * texels
    left, top = tag.along * texels - side / 2, len(wall) - tag.height * texels - side / 2
    column, row = int(np.floor(left)), int(np.floor(top))
    count = int(np.ceil(side)) + 1
    grid = (np.arange(count * FINE) + 0.5) / FINE
    x, y = ((grid - start) / side * len(cells) for start in (left - column, top - row))
    inside = [(each >= 0) & (each < len(cells)) for each in (x, y)]
    i, j = (each.clip(0, len(cells) - 1).astype(int) for each in (x, y))
    covers = (inside[1][:, None] & inside[0]).astype(np.float32)
    color, alpha = (
        np.asarray(cv2.resize(each, (count, count), interpolation=cv2.INTER_AREA))[:, :, None]
        for each in (image[j[:, None], i] * covers, covers)
    )
    target = wall[row : row + count, column : column + count]
    blended = target * (1 - alpha) + color
    target[:] = np.rint(blended).astype(np.uint8)


def tag_map(tags: Sequence[WallTag], corners: FloatArray) -> LandmarkMap:
    """True positions of tags on walls along a polyline (k, 2)."""
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    along = np.array([tag.along for tag in tags])
    xy = np.stack([np.interp(along, ends, each) for each in corners.T], 1).reshape(-1, 2)
    names = tuple(f"{FAMILY}:{tag.id}" for tag in tags)
    return LandmarkMap(10**18 + np.arange(len(names)), xy, text_names=names)
