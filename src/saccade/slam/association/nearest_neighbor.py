"""Nearest-neighbor data association by Mahalanobis distances."""

from typing import NamedTuple

import numpy as np

from saccade.slam.association._kernels import (
    compare_with_landmarks,
    mahalanobis_distances,
    prefilter_landmarks,
)
from saccade.slam.association.outcomes import DROPPED, NEW
from saccade.slam.association.rules import Pairing
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.predictions import expected
from saccade.types import BoolArray, FloatArray, IntArray

AMBIGUITY_MARGIN = 3.0
"""A pair is ambiguous if the squared Mahalanobis distance of the observation from an unpaired
landmark is larger by less than this: the pair is less than four times as likely."""


class Gates(NamedTuple):
    """Parameters of nearest-neighbor association."""

    gate: float
    """Largest squared Mahalanobis distance of an observation from the landmark of its pair."""
    new_gate: float
    """Squared Mahalanobis distance from every landmark beyond which an observation is new."""
    pairing: Pairing
    """Pairs of observations and landmarks, see `rules`."""


def compare(
    ekf: EkfSlam, z: FloatArray, R: FloatArray, landmarks: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Compares observations (m, 2) with the landmarks of these ids (m,), -1 for none.

    Returns:
        (m,) NIS, infinite without a landmark; and (m,) ratios of the predicted variance to the
        noise, 0 without a landmark.
    """
    nis, variance_ratio = np.full(len(z), np.inf), np.zeros(len(z))
    compare_with_landmarks(ekf.active, z, R, ekf.rows(landmarks), nis, variance_ratio)
    return nis, variance_ratio


def associate_by_geometry(
    ekf: EkfSlam,
    z: FloatArray,
    R: FloatArray,
    gates: Gates,
    taken: IntArray | None = None,
    confirmed: BoolArray | None = None,
) -> IntArray:
    """Associates a scan with the nearest landmarks by Mahalanobis distance, within a gate.

    Within a scan each landmark is paired with at most one observation and each observation with
    at most one landmark, the closest pair first. An observation outside the larger gate of every
    landmark is new; the others are ambiguous, and so are those to which an unpaired landmark is
    almost as near.

    Args:
        ekf: the filter, predicted to the pose of the scan.
        z: (m, 2) range in meters, bearing in radians.
        R: (m, 2, 2) their covariances.
        gates: the gates and the pairing.
        taken: (n,) ids of the landmarks of other observations of the scan.
        confirmed: (N,) landmarks of `EkfSlam.active` that are more than candidates; by default all.

    Returns:
        (m,) the id of the landmark, `NEW` or `DROPPED`.
    """
    f, ids = ekf.active, ekf.active_ids
    near = np.empty(len(ids), np.int64)
    near = near[: prefilter_landmarks(f, z, R, gates.new_gate, near)]
    distance = np.empty((len(z), len(near)))
    mahalanobis_distances(*expected(f, near), z, R, gates.new_gate, distance)
    used = np.zeros(len(near), np.bool_) if taken is None else np.isin(ids[near], taken)
    more = np.ones(len(near), np.bool_) if confirmed is None else confirmed[near]
    paired = select_pairs(distance, gates, used, more)
    found = paired >= 0
    paired[found] = ids[near[paired[found]]]
    return paired


def select_pairs(
    distance: FloatArray, gates: Gates, taken: BoolArray, confirmed: BoolArray
) -> IntArray:
    """(m,) column of each row of squared distances (m, c), `NEW` or `DROPPED`.

    An observation that is near a column that is `taken` (c,) is not new, but is not paired with it
    either. For `confirmed` columns (c,), see `drop_ambiguous`.
    """
    paired = np.full(len(distance), NEW)
    if distance.size == 0:
        return paired
    if taken.any():
        distance = np.where(taken & (distance <= gates.new_gate), gates.new_gate, distance)
    pairs = gates.pairing(distance)
    paired = np.where(distance[np.arange(len(pairs)), pairs] <= gates.gate, pairs, DROPPED)
    paired[pairs < 0] = DROPPED
    drop_ambiguous(distance, confirmed, paired)
    if taken.any():
        paired[np.isin(paired, np.flatnonzero(taken))] = DROPPED
    paired[(distance > gates.new_gate).all(1)] = NEW
    return paired


def drop_ambiguous(distance: FloatArray, confirmed: BoolArray, paired: IntArray) -> None:
    """Drops pairs of distances (m, c) for which an unpaired column is almost as near.

    For a pair with a confirmed column (c,), only confirmed ones count: next to a landmark, a
    candidate is most often one of its own observations that was outside of its gate.
    """
    row = np.flatnonzero(paired >= 0)
    column = paired[row]
    near = distance[row] <= distance[row, column, None] + AMBIGUITY_MARGIN
    if np.count_nonzero(near) == len(row):  # the pairs only
        return
    rival = confirmed | ~confirmed[column, None]
    rival[:, column] = False
    paired[row[(near & rival).any(1)]] = DROPPED


def mahalanobis_squared(
    ekf: EkfSlam, z: FloatArray, R: FloatArray, gate: float = np.inf
) -> FloatArray:
    """Squared Mahalanobis distances between observations and landmarks.

    Args:
        ekf: the filter, with N landmarks.
        z: (m, 2) observations.
        R: (m, 2, 2) their covariances.
        gate: largest distance that is of interest.

    Returns:
        (m, N) in the order of the landmarks' ids; infinite over the gate and where the innovation
        covariance is singular.
    """
    distance = np.empty((len(z), len(ekf)))
    mahalanobis_distances(*ekf.predict_observations(), z, R, gate, distance)
    return distance
