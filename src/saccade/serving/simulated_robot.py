"""A simulated robot that measures its motion and the landmarks around it, with noise."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from saccade.errors import require, require_valid, setting
from saccade.slam.models import turn_then_translate, wrap
from saccade.types import FloatArray, IntArray

MAX_LANDMARKS = 60
"""Landmarks of a world."""
START = (0.0, -10.0, 0.0)
"""True first pose."""
SMALLEST_RANGE = 0.1
"""Metres, of an observation."""
RING = ((8.0, 7), (12.0, 9))
"""Radius in metres and number of the landmarks that are there at first."""


@dataclass(frozen=True)
class PlaygroundNoise:
    """Noise of the odometry and the sensor of the simulated robot."""

    distance_percent: float = setting(10.0, 0, 20, slider=1)
    """Standard deviation of the odometry's distance, in per cent of it."""
    turn_sigma: float = setting(6.0, 0, 10, slider=0.5)
    """Standard deviation of the odometry's turn in a step, in degrees."""
    range_percent: float = setting(5.0, 0.5, 20, slider=0.5)
    """Standard deviation of a range, in per cent of it."""
    bearing_sigma: float = setting(3.0, 0.2, 10, slider=0.2)
    """Standard deviation of a bearing, in degrees."""
    reach: float = setting(4.0, 1, 20, slider=0.5)
    """Largest range of an observation, in metres."""
    assumed_factor: float = setting(1.0, 0.2, 5, slider=0)
    """Standard deviations that the filters assume, relative to the true ones above."""

    def __post_init__(self) -> None:
        require_valid(self)


class Scan(NamedTuple):
    """Odometry of a step and the observations after it."""

    control: FloatArray | None
    """(2,) distance and turn; None where the robot stood still."""
    U: FloatArray | None
    """(2, 2) its covariance."""
    z: FloatArray
    """(k, 2) range and bearing."""
    R: FloatArray
    """(k, 2, 2) their covariances."""
    names: IntArray
    """(k,) of the landmarks."""


class World:
    """The true pose of a robot and the landmarks around it; makes its noisy measurements."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self.pose = np.array(START)
        """(3,) x, y in metres, heading in radians."""
        self.landmarks: dict[int, FloatArray] = {}
        """Position (2,) by name."""
        self._num_named = 0

    def add(self, xy: FloatArray) -> None:
        """Add landmarks (n, 2)."""
        room = MAX_LANDMARKS - len(self.landmarks)
        require(len(xy) <= room, "landmarks", f"at most {room} more", len(xy))
        for each in xy:
            self.landmarks[self._num_named] = each
            self._num_named += 1

    def move(self, command: FloatArray | None, noise: PlaygroundNoise) -> Scan:
        """Carry out a command (2,), distance and turn, and measure; None stands still."""
        control, U = None, None
        if command is not None:
            self.pose, _, _ = turn_then_translate(self.pose, command)
            distance = noise.distance_percent / 100 * abs(command[0])
            sigma = np.array([distance, np.deg2rad(noise.turn_sigma)])
            control = command + sigma * self._rng.standard_normal(2)
            U = np.diag(np.square(noise.assumed_factor * sigma))
        names = np.array(sorted(self.landmarks), np.int64)
        offset = np.array([self.landmarks[each] for each in names]).reshape(-1, 2) - self.pose[:2]
        distance = np.hypot(*offset.T)
        seen = (distance >= SMALLEST_RANGE) & (distance <= noise.reach)
        bearing = wrap(np.arctan2(offset[:, 1], offset[:, 0]) - self.pose[2])
        z = np.stack([distance, bearing], 1)[seen]
        sigma = np.empty(z.shape)
        sigma[:, 0] = noise.range_percent / 100 * z[:, 0]
        sigma[:, 1] = np.deg2rad(noise.bearing_sigma)
        z += sigma * self._rng.standard_normal(z.shape)
        z[:, 0] = np.abs(z[:, 0])
        R = np.square(noise.assumed_factor * sigma)[:, :, None] * np.eye(2)
        return Scan(control, U, z, R, names[seen])


def rings() -> list[list[float]]:
    """Landmarks inside and outside of the circle through the first pose."""
    angles = [(radius, 2 * np.pi * (i + 0.25) / n) for radius, n in RING for i in range(n)]
    return [[radius * float(np.cos(a)), radius * float(np.sin(a))] for radius, a in angles]
