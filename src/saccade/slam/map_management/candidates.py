"""Candidate landmarks: confirmed by repeated observations before they enter the map."""

import numpy as np

from saccade.slam.checkpoint import Arrays
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.map_management._kernels import CandidateBuffer, ConfirmationPolicy, confirm
from saccade.types import FloatArray, IntArray

FIRST_CAPACITY = 64
"""Candidates for which there is room at first; doubled whenever it runs out."""


class Candidates:
    """Positions of unassociated observations, until they were observed often enough.

    A candidate is a position in the frame of the map with the noise of the sensor alone: it is
    short-lived, so that the robot's own uncertainty is common to its observations. It is no part
    of the filter's state.

    Args:
        confirm_after: observations after which a candidate becomes a landmark; 1 for the first.
        timeout: units of the log's time without an observation after which it is dropped.
        gate: probability with which an observation of a candidate is inside its gate.
    """

    def __init__(self, confirm_after: int, timeout: float, gate: float = 0.99) -> None:
        self.policy = ConfirmationPolicy(confirm_after, timeout, chi_square_gate(2, gate))
        self.buffer = _new_buffer(FIRST_CAPACITY)

    def confirm(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, time: float) -> IntArray:
        """Associate unassociated observations of a scan with the candidates.

        Args:
            ekf: the filter, at the pose of the scan.
            z: (m, 2) observations of no landmark of the map.
            R: (m, 2, 2) their covariances.
            time: of the scan, in the unit of `timeout`.

        Returns:
            The rows of `z` that confirm a candidate: each is to become a landmark.
        """
        if self.policy.confirm_after <= 1:
            return np.arange(len(z))
        self.reserve(len(z))
        xy, _, Gz = ekf.sensor.inverse_observe(ekf.pose, z)  # (m, 2), (m, 2, 2)
        confirmed = np.empty(len(z), np.bool_)
        C = Gz @ R @ Gz.transpose(0, 2, 1)  # (m, 2, 2)
        confirm(self.buffer, self.policy, xy, C, time, confirmed)
        return np.flatnonzero(confirmed)

    def reserve(self, count: int) -> None:
        """Make room for `count` more."""
        while len(self.buffer.kept) < int(self.buffer.length[0]) + count:
            self.buffer = _copy(self.buffer, 2 * len(self.buffer.kept))

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        return self.buffer._asdict()

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        self.buffer = CandidateBuffer(**arrays)


def _new_buffer(capacity: int) -> CandidateBuffer:
    return CandidateBuffer(
        xy=np.zeros((capacity, 2)),
        covariance=np.zeros((capacity, 2, 2)),
        observations=np.zeros(capacity, np.int64),
        last_observed=np.zeros(capacity),
        kept=np.zeros(capacity, np.bool_),
        length=np.zeros(1, np.int64),
    )


def _copy(buffer: CandidateBuffer, capacity: int) -> CandidateBuffer:
    new = _new_buffer(capacity)
    for source, target in zip(buffer, new, strict=True):
        target[: len(source)] = source
    return new
