"""The way round a ring: a rectangle with rounded corners, and a robot that sways about it."""

import numpy as np

from saccade.simulation.drive_config import DriveConfig
from saccade.slam.models import wrap
from saccade.types import FloatArray


def lap_length(config: DriveConfig) -> float:
    """Metres once round the middle of the corridor."""
    along, across = (side - config.corridor for side in config.size)
    return 2 * (along + across) - (8 - 2 * np.pi) * config.turning_radius


def drive_course(config: DriveConfig, seed: np.random.SeedSequence) -> FloatArray:
    """Where the robot is at each frame.

    It starts at the origin, in the middle of the first side, along which it looks, and turns
    left. The heading is that of the way, the swaying included.

    Args:
        config: the ring, and how many frames there are.
        seed: of the length of the swaying.

    Returns:
        (frames, 3) x and y in metres, heading in radians.
    """
    lap = lap_length(config)
    s = np.arange(config.frames) * lap / config.frames_per_lap
    wave = 2 * np.pi / (lap * np.random.default_rng(seed).uniform(0.3, 0.45))
    aside = config.sway * (1 - np.cos(wave * s)) / 2
    slope = config.sway * wave * np.sin(wave * s) / 2
    middle, curvature = _middle(config, s)
    x, y, heading = middle.T
    turned = heading + np.arctan2(slope, 1 - curvature * aside)
    return np.stack([x - aside * np.sin(heading), y + aside * np.cos(heading), wrap(turned)], 1)


def _middle(config: DriveConfig, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Poses (n, 3) at arc lengths along the middle of the corridor, and the curvature there."""
    along, across = (side - config.corridor for side in config.size)
    radius = config.turning_radius
    pieces = [(along / 2 - radius, 0.0)]  # length, curvature; the lap ends amid the last of them
    for side in (across, along, across, along):
        pieces += [(np.pi / 2 * radius, 1 / radius), (side - 2 * radius, 0.0)]
    start = np.concatenate([[0.0], np.cumsum([length for length, _ in pieces])])
    poses = np.zeros((len(start), 3))
    for i, (length, bend) in enumerate(pieces):
        poses[i + 1] = _along(poses[i], np.array([length]), np.array([bend]))[0]
    s = s % lap_length(config)
    piece = np.clip(np.searchsorted(start, s, side="right") - 1, 0, len(pieces) - 1)
    curvature = np.array([bend for _, bend in pieces])[piece]
    return _along(poses[piece].T, s - start[piece], curvature), curvature


def _along(pose: FloatArray, length: FloatArray, curvature: FloatArray) -> FloatArray:
    """Poses (n, 3) after arcs from a pose (3,) or (3, n)."""
    x, y, heading = pose
    turn = curvature * length
    chord = length * np.sinc(turn / (2 * np.pi))
    direction = heading + turn / 2
    ends = (x + chord * np.cos(direction), y + chord * np.sin(direction), heading + turn)
    return np.stack(ends, 1)
