"""Tags on the walls of a simulated drive."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from saccade.simulation.drive_config import DriveConfig
from saccade.simulation.floor_plan import drive_course
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
MIN_FACING = 0.4
"""Minimum cosine of the angle of incidence at which a tag is seen well."""
MIN_PIXELS = 18.0
"""Minimum side of a tag that is seen well, in pixels."""
MAX_LAP_POSES = 100
"""Maximum number of poses of a lap from which tags are viewed."""
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

    In its section a tag hangs where the robot sees it most often, beside the tags before it; a tag
    without room is left out.

    Args:
        config: settings of the drive.
        corners: (k, 2) of the walls in meters.
        posters: center and width in meters of what hangs there, which a tag avoids if it can.
        rng: source of the positions.
    """
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    half = config.tag_size * 0.625 + CLEARANCE  # with the border of a cell on each side
    poses = drive_course(replace(config, sway=0.0), np.random.SeedSequence(0))
    poses = poses[: config.frames_per_lap : max(1, config.frames_per_lap // MAX_LAP_POSES)]
    found = list[WallTag]()
    for k in range(config.tags):
        along = (k + rng.random(CANDIDATES)) / config.tags * ends[-1]
        above = rng.uniform(0.0, MAX_ABOVE)
        room = np.abs(along[:, None] - ends).min(1) - half
        if found:
            hung = np.array([tag.along for tag in found])
            room = np.minimum(room, np.abs(along[:, None] - hung).min(1) - 2 * half)
        to_poster = [np.abs(along - center) - width / 2 - half for center, width in posters]
        free = np.minimum(room, np.min([np.full(CANDIDATES, 1.0), *to_poster], axis=0))
        seen = _views(config, _on_walls(corners, ends, along), poses)
        best = int(np.argmax(np.where(free > 0, seen, np.where(room > 0, seen, -2) - 1)))
        if room[best] > 0:
            low, high = half, config.wall_height - half
            height = float(np.clip(config.camera_height + above, low, high))
            found.append(WallTag(k, float(along[best]), height))
    return found


def _on_walls(corners: FloatArray, ends: FloatArray, along: FloatArray) -> FloatArray:
    """Positions (n, 2) and directions (n, 2) of walls, as columns (n, 4), at lengths (n,)."""
    wall = np.searchsorted(ends, along, side="right").clip(1, len(ends) - 1) - 1
    direction = np.diff(corners, axis=0)[wall] / np.diff(ends)[wall, None]
    return np.hstack([corners[wall] + (along - ends[wall])[:, None] * direction, direction])


def _views(config: DriveConfig, places: FloatArray, poses: FloatArray) -> FloatArray:
    """(n,) number of poses (m, 3) that see a tag well at places (n, 4); see `_on_walls`."""
    offset = places[:, None, :2] - poses[:, :2]  # (n, m, 2)
    distance = np.maximum(np.hypot(offset[..., 0], offset[..., 1]), 1e-6)
    bearing = np.arctan2(offset[..., 1], offset[..., 0]) - poses[:, 2]
    is_ahead = np.abs(np.angle(np.exp(1j * bearing))) < np.deg2rad(config.field_of_view_deg / 2.2)
    x, y = places[:, None, 2], places[:, None, 3]
    facing = (offset[..., 0] * y - offset[..., 1] * x) / -distance  # front is to the right
    pixels = config.camera.fx * config.tag_size / distance
    return np.asarray((is_ahead & (facing > MIN_FACING) & (pixels > MIN_PIXELS)).sum(1))


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
