"""Landmarks that must be seen again before the map takes them in."""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.association.gating import pair_nearest_first
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import BoolArray, FloatArray, IntArray

FIRST_CAPACITY = 64
"""Candidates for which there is room at first."""


class CandidateBuffer(NamedTuple):
    """Places where something new was seen."""

    xy: FloatArray
    """(c, 2)."""
    covariance: FloatArray
    """(c, 2, 2)."""
    observations: IntArray
    """(c,)."""
    last_observed: FloatArray
    """(c,) time of the last sighting."""
    kept: BoolArray
    """(c,) whether it is kept, while others are forgotten."""
    size: IntArray
    """(1,) how many of these places there are."""

    @classmethod
    def empty(cls, count: int) -> "CandidateBuffer":
        """None as yet."""
        return cls(
            xy=np.zeros((count, 2)),
            covariance=np.zeros((count, 2, 2)),
            observations=np.zeros(count, np.int64),
            last_observed=np.zeros(count),
            kept=np.zeros(count, np.bool_),
            size=np.zeros(1, np.int64),
        )


class ConfirmationPolicy(NamedTuple):
    """When a candidate becomes a landmark, and when it is forgotten."""

    confirm_after: int
    timeout: float
    max_distance: float
    """Normalized distance squared within which an observation is of a candidate."""


class Candidates:
    """Places where something new was seen, until it has been seen often enough.

    A candidate is a place in the frame of the map with the noise of the sensor
    alone: it lives so briefly that the robot's own uncertainty is common to its
    sightings. It is no part of the filter's state.

    Args:
        sightings: observations after which a candidate becomes a landmark; 1 takes the first.
        lifetime: units of the log's time without a sighting after which it is forgotten.
        gate: probability with which an observation of a candidate is taken for one.
    """

    def __init__(self, confirm_after: int, timeout: float, gate: float = 0.99) -> None:
        self.patience = ConfirmationPolicy(confirm_after, timeout, chi_square_gate(2, gate))
        self.waiting = CandidateBuffer.empty(FIRST_CAPACITY)

    def confirm(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, time: float) -> list[int]:
        """Look for the new observations of a scan among the candidates.

        Args:
            ekf: the filter, at the pose of the scan.
            z: (m, 2) observations that are of no landmark of the map.
            R: (m, 2, 2) their covariances.
            time: of the scan, in the unit of `timeout`.

        Returns:
            The rows of `z` that confirm a candidate: each is to become a landmark.
        """
        if self.patience.confirm_after <= 1:
            return list(range(len(z)))
        self.make_room(len(z))
        xy, _, Gz = ekf.sensor.inverse_observe(ekf.pose, z)  # (m, 2), (m, 2, 2)
        confirmed = np.empty(len(z), np.bool_)
        spread = Gz @ R @ Gz.transpose(0, 2, 1)  # (m, 2, 2)
        confirm(self.waiting, self.patience, xy, spread, time, confirmed)
        return np.flatnonzero(confirmed).tolist()

    def make_room(self, count: int) -> None:
        """For so many more."""
        used = int(self.waiting.size[0])
        while len(self.waiting.last_observed) < used + count:
            old, self.waiting = (
                self.waiting,
                CandidateBuffer.empty(2 * len(self.waiting.last_observed)),
            )
            for theirs, ours in zip(old[:-1], self.waiting[:-1], strict=True):
                ours[:used] = theirs[:used]
            self.waiting.size[0] = used


@kernel()
def confirm(
    w: CandidateBuffer,
    policy: ConfirmationPolicy,
    xy: FloatArray,
    covariance: FloatArray,
    time: float,
    confirmed: BoolArray,
) -> None:
    """Fill whether observations at xy (m, 2) with covariance (m, 2, 2) confirm a candidate (m,)."""
    if policy.confirm_after <= 1:
        for i in range(len(xy)):
            confirmed[i] = True
        return
    if len(xy) == 0:
        return
    for j in range(w.size[0]):
        w.kept[j] = time - w.last_observed[j] <= policy.timeout
    _drop_stale(w)
    paired = np.empty(len(xy), np.int64)
    pair_nearest_first(_squared_distances(w, xy, covariance), policy.max_distance, paired)
    for i in range(len(xy)):
        j, times = paired[i], 1
        if j < 0:
            j = w.size[0]
            w.size[0] += 1
        else:
            times = w.observations[j] + 1
        for k in range(2):
            w.xy[j, k] = xy[i, k]
            for m in range(2):
                w.covariance[j, k, m] = covariance[i, k, m]
        w.observations[j], w.last_observed[j] = times, time
        confirmed[i] = times >= policy.confirm_after
    for j in range(w.size[0]):
        w.kept[j] = w.observations[j] < policy.confirm_after
    _drop_stale(w)


@kernel()
def _squared_distances(w: CandidateBuffer, xy: FloatArray, covariance: FloatArray) -> FloatArray:
    """Normalized distances squared (m, c) of observations from candidates; infinite if singular."""
    distance = np.empty((len(xy), w.size[0]))
    for i in range(len(xy)):
        for j in range(w.size[0]):
            v, u = xy[i, 0] - w.xy[j, 0], xy[i, 1] - w.xy[j, 1]
            a = covariance[i, 0, 0] + w.covariance[j, 0, 0]
            c = covariance[i, 0, 1] + w.covariance[j, 0, 1]
            d = covariance[i, 1, 1] + w.covariance[j, 1, 1]
            determinant = a * d - c * c
            distance[i, j] = np.inf
            if determinant > 0:
                distance[i, j] = (d * v * v - 2 * c * v * u + a * u * u) / determinant
    return distance


@kernel()
def _drop_stale(w: CandidateBuffer) -> None:
    """Forget the candidates that do not stay."""
    j = 0
    for i in range(w.size[0]):
        if w.kept[i]:
            for k in range(2):
                w.xy[j, k] = w.xy[i, k]
                for m in range(2):
                    w.covariance[j, k, m] = w.covariance[i, k, m]
            w.observations[j], w.last_observed[j] = w.observations[i], w.last_observed[i]
            j += 1
    w.size[0] = j
