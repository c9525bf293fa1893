"""Floor plans of simulated drives: the outlines of the walls, and the course among them."""

import numpy as np

from saccade.simulation.drive_config import DriveConfig
from saccade.slam.filter.robot_models import wrap
from saccade.types import FloatArray

ROOM = (3.9, 4.0)
"""Length and width of each room, in meters."""
GAP = 0.1
"""Half the thickness of the wall between the rooms, in meters."""
DOOR = 0.5
"""Half the width of the door in this wall, in meters."""
TURNING_RADIUS = 0.45
"""Radius of the turns through the rooms, in meters."""
BLOCK = 1.6
"""Side of a block in a hall, in meters."""
BLOCK_JITTER = 0.12
"""Largest displacement of a block, as a fraction of the space that it has."""


def wall_outlines(config: DriveConfig, rng: np.random.Generator) -> list[FloatArray]:
    """Closed polylines (k, 2) of connected walls in meters, visible from their right.

    A ring has outer walls and the walls of the central block; a hall has outer walls and blocks
    inside the course, whose positions are drawn.
    """
    if config.world != "rooms":
        (width, depth), corridor = config.size, config.corridor
        around = _rectangle(-width / 2, -corridor / 2, width, depth)[::-1]
        if config.world == "hall":
            space = np.array([(width - corridor) / max(config.blocks, 1), depth - corridor])
            drawn = rng.uniform(-BLOCK_JITTER, BLOCK_JITTER, (config.blocks, 2))
            column = np.arange(config.blocks) - (config.blocks - 1) / 2
            centers = (drawn + np.stack([column, np.full(config.blocks, 0.5)], 1)) * space
            corners = (centers - BLOCK / 2).tolist()
            return [around, *(_rectangle(x, y, BLOCK, BLOCK) for x, y in corners)]
        inner = width - 2 * corridor, depth - 2 * corridor
        return [around, _rectangle(corridor - width / 2, corridor / 2, *inner)]
    (along, across), x, d = ROOM, GAP, DOOR
    left, right, y = -x - along, x + along, across / 2
    upper = [[left, y], [-x, y], [-x, d], [x, d], [x, y], [right, y]]
    lower = [[right, -y], [x, -y], [x, -d], [-x, -d], [-x, -y], [left, -y]]
    return [np.array([*upper, *lower, [left, y]])]


def drive_course(config: DriveConfig, seed: np.random.SeedSequence) -> FloatArray:
    """Poses (frames, 3) of the robot on a closed polyline with rounded corners, at constant speed.

    Around a ring or a hall it starts at the origin, in the middle of the first side, heading along
    it, and turns left, with a lateral oscillation whose wavelength the seed determines. Through the
    rooms it drives around one, through the door, around the other, and back.
    """
    is_ring = config.world != "rooms"
    if is_ring:
        along, across = (side - config.corridor for side in config.size)
        corners = _rectangle(-along / 2, 0.0, along, across)
        corners = np.concatenate([[[0.0, 0.0]], corners[1:], [[0.0, 0.0]]])
    else:
        near, far, y = 1.0, 3.1, 1.1
        there = [[-far, 0], [-far, -y], [-near, -y], [-near, 0], [near, 0], [near, -y], [far, -y]]
        back = [[far, y], [near, y], [near, 0], [-near, 0], [-near, y], [-far, y], [-far, 0]]
        corners = np.array([*there, *back])
    start, pose, curvature = _rounded(corners, config.turning_radius if is_ring else TURNING_RADIUS)
    lap = start[-1]
    s = np.arange(config.frames) * lap / config.frames_per_lap
    piece = np.searchsorted(start, s % lap, side="right") - 1
    center = _advance(pose[piece].T, s % lap - start[piece], curvature[piece])
    sway = config.sway if is_ring else 0.0
    wave = 2 * np.pi / (lap * np.random.default_rng(seed).uniform(0.3, 0.45))
    lateral = sway * (1 - np.cos(wave * s)) / 2
    slope = sway * wave * np.sin(wave * s) / 2
    x, y, heading = center.T
    tangent = heading + np.arctan2(slope, 1 - curvature[piece] * lateral)
    return np.stack(
        [x - lateral * np.sin(heading), y + lateral * np.cos(heading), wrap(tangent)], 1
    )


def _rectangle(x: float, y: float, width: float, depth: float) -> FloatArray:
    """(5, 2) corners, counterclockwise from the minimum of x and y, closed."""
    right, far = x + width, y + depth
    return np.array([[x, y], [right, y], [right, far], [x, far], [x, y]])


def _rounded(corners: FloatArray, radius: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Straight pieces and arcs along a polyline (k, 2) whose inner corners are rounded.

    Returns:
        Arc lengths (n + 1,) of the ends of the n pieces, their first poses (n, 3), and their
        curvatures (n,), positive to the left.
    """
    steps = np.diff(corners, axis=0)
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    turn = wrap(np.diff(heading))
    cut = np.concatenate([[0.0], radius * np.tan(np.abs(turn) / 2), [0.0]])  # from each corner
    length, curvature = np.zeros((2, 2 * len(steps) - 1))
    length[::2] = np.hypot(*steps.T) - cut[:-1] - cut[1:]
    length[1::2], curvature[1::2] = radius * np.abs(turn), np.sign(turn) / radius
    pose = np.empty((len(length), 3))
    pose[0] = *corners[0], heading[0]
    for i in range(1, len(length)):
        pose[i] = _advance(pose[i - 1], length[i - 1 : i], curvature[i - 1 : i])[0]
    return np.concatenate([[0.0], np.cumsum(length)]), pose, curvature


def _advance(pose: FloatArray, length: FloatArray, curvature: FloatArray) -> FloatArray:
    """Poses (n, 3) at the ends of arcs from a pose (3,) or (3, n)."""
    x, y, heading = pose
    turn = curvature * length
    chord = length * np.sinc(turn / (2 * np.pi))
    direction = heading + turn / 2
    ends = (x + chord * np.cos(direction), y + chord * np.sin(direction), heading + turn)
    return np.stack(ends, 1)
