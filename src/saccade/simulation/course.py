"""The course of a simulated robot: a rounded rectangle with a lateral oscillation."""

import numpy as np

from saccade.simulation.drive_config import DriveConfig
from saccade.slam.models import wrap
from saccade.types import FloatArray


def lap_length(config: DriveConfig) -> float:
    """Length of the center line in metres."""
    along, across = (side - config.corridor for side in config.size)
    return 2 * (along + across) - (8 - 2 * np.pi) * config.turning_radius


def drive_course(config: DriveConfig, seed: np.random.SeedSequence) -> FloatArray:
    """Poses of the robot at each frame.

    It starts at the origin, in the middle of the first side, heading along it, and turns left.
    The heading is tangential to the path including the oscillation.

    Args:
        config: the scene and the number of frames.
        seed: of the wavelength of the oscillation.

    Returns:
        (frames, 3) x and y in metres, heading in radians.
    """
    lap = lap_length(config)
    s = np.arange(config.frames) * lap / config.frames_per_lap
    wave = 2 * np.pi / (lap * np.random.default_rng(seed).uniform(0.3, 0.45))
    lateral = config.sway * (1 - np.cos(wave * s)) / 2
    slope = config.sway * wave * np.sin(wave * s) / 2
    center, curvature = _center_line(config, s)
    x, y, heading = center.T
    tangent = heading + np.arctan2(slope, 1 - curvature * lateral)
    return np.stack(
        [x - lateral * np.sin(heading), y + lateral * np.cos(heading), wrap(tangent)], 1
    )


def _center_line(config: DriveConfig, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Poses (n, 3) and curvatures (n,) of the center line at arc lengths (n,)."""
    along, across = (side - config.corridor for side in config.size)
    radius = config.turning_radius
    pieces = [(along / 2 - radius, 0.0)]  # length, curvature; the lap ends within the last
    for side in (across, along, across, along):
        pieces += [(np.pi / 2 * radius, 1 / radius), (side - 2 * radius, 0.0)]
    start = np.concatenate([[0.0], np.cumsum([length for length, _ in pieces])])
    poses = np.zeros((len(start), 3))
    for i, (length, k) in enumerate(pieces):
        poses[i + 1] = _advance(poses[i], np.array([length]), np.array([k]))[0]
    s = s % lap_length(config)
    piece = np.clip(np.searchsorted(start, s, side="right") - 1, 0, len(pieces) - 1)
    curvature = np.array([k for _, k in pieces])[piece]
    return _advance(poses[piece].T, s - start[piece], curvature), curvature


def _advance(pose: FloatArray, length: FloatArray, curvature: FloatArray) -> FloatArray:
    """Poses (n, 3) at the ends of arcs from a pose (3,) or (3, n)."""
    x, y, heading = pose
    turn = curvature * length
    chord = length * np.sinc(turn / (2 * np.pi))
    direction = heading + turn / 2
    ends = (x + chord * np.cos(direction), y + chord * np.sin(direction), heading + turn)
    return np.stack(ends, 1)
