"""Landmarks that must be seen again before the map takes them in."""

from dataclasses import dataclass, field

import numpy as np

from saccade.slam.association import DROPPED, pair_nearest_first, squared_distance
from saccade.slam.consistency import chi_square_gate
from saccade.slam.ekf import EkfSlam
from saccade.types import FloatArray


@dataclass
class _Candidate:
    xy: FloatArray
    covariance: FloatArray
    sightings: int
    last: float


@dataclass
class Candidates:
    """Places where something new was seen, until it has been seen often enough.

    A candidate is a place in the frame of the map with the noise of the sensor
    alone: it lives so briefly that the robot's own uncertainty is common to its
    sightings. It is no part of the filter's state.
    """

    sightings: int
    """Observations after which a candidate becomes a landmark; 1 takes the first."""
    lifetime: float
    """Units of the log's time without a sighting after which a candidate is forgotten."""
    gate: float = 0.99
    """Probability with which an observation of a candidate is taken for one."""
    _waiting: list[_Candidate] = field(default_factory=list)

    def confirm(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, time: float) -> list[int]:
        """Look for the new observations of a scan among the candidates.

        Args:
            ekf: the filter, at the pose of the scan.
            z: (m, 2) observations that are of no landmark of the map.
            R: (m, 2, 2) their covariances.
            time: of the scan, in the unit of `lifetime`.

        Returns:
            The rows of `z` that confirm a candidate: each is to become a landmark.
        """
        if self.sightings <= 1:
            return list(range(len(z)))
        if len(z) == 0:
            return []
        self._waiting = [c for c in self._waiting if time - c.last <= self.lifetime]
        xy, _, Gz = ekf.sensor.place(ekf.pose, z)  # (m, 2), (m, 2, 2)
        covariance = Gz @ R @ Gz.transpose(0, 2, 1)  # (m, 2, 2)
        paired = pair_nearest_first(self._distance(xy, covariance), chi_square_gate(2, self.gate))
        confirmed = []
        for row, column in enumerate(paired.tolist()):
            count = 1 if column == DROPPED else self._waiting[column].sightings + 1
            seen = _Candidate(xy[row], covariance[row], count, time)
            if column == DROPPED:
                self._waiting.append(seen)
            else:
                self._waiting[column] = seen
            if count >= self.sightings:
                confirmed.append(row)
        self._waiting = [c for c in self._waiting if c.sightings < self.sightings]
        return confirmed

    def _distance(self, xy: FloatArray, covariance: FloatArray) -> FloatArray:
        if not self._waiting:
            return np.empty((len(xy), 0))
        there = np.array([c.xy for c in self._waiting])
        spread = np.array([c.covariance for c in self._waiting])
        apart = xy[:, None] - there  # (m, C, 2)
        total = covariance[:, None] + spread  # (m, C, 2, 2)
        return squared_distance(apart, total)
