"""Landmarks met again after they were out of sight: by their looks and by where they should be."""

from dataclasses import replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.keypoints.matching import match
from saccade.slam.consistency import chi_square_gate, normalized_squared
from saccade.slam.models import wrap
from saccade.slam.results import PredictedObservations
from saccade.types import Float32Array, FloatArray, IntArray, Keypoints
from saccade.visual.camera import RangeBearings
from saccade.visual.frontend import TrackedPoints

BoolArray: TypeAlias = npt.NDArray[np.bool_]

HEIGHT = 0.15
"""Share of the range by which the height of a landmark may seem to change: pitch is in it."""
TOLERANCE = 0.05
"""Share of the range by which landmarks may lie otherwise than they are seen together."""
ASIDE = 0.02
"""The same where the range is what the map says, and the bearing alone is seen."""
HERE = 4.0
"""Pixels within which a point that is followed is found again where it is."""
MIN_AGREEING = 4
"""Landmarks that must agree on one pose where several are met at a time."""


def descriptor_matches(
    points: Keypoints, descriptors: npt.NDArray[np.uint8], ratio: float
) -> IntArray:
    """(m, 2) points and landmarks whose descriptors are each other's nearest by far."""
    if len(points) == 0 or len(descriptors) == 0:
        return np.zeros((0, 2), np.int64)
    known = Keypoints.at(np.zeros((len(descriptors), 2)), 1.0)
    return match(points, replace(known, descriptors=descriptors), ratio=ratio, mutual=True)


def within_gate(
    seen: RangeBearings, expected: PredictedObservations, height: FloatArray, gate: float
) -> BoolArray:
    """Which sightings may be of the landmarks they look like.

    Args:
        seen: m sightings.
        expected: where the filter expects their landmarks, m of each.
        height: (m,) of the landmarks.
        gate: probability with which a right one passes.

    Returns:
        (m,): the Mahalanobis distance over the ground is inside the gate, and the height fits.
    """
    v = seen.z - expected.z
    v[:, 1] = wrap(v[:, 1])
    near = normalized_squared(v, expected.covariance + seen.covariance) < chi_square_gate(2, gate)
    return np.asarray(near & (np.abs(seen.height - height) < HEIGHT * seen.z[:, 0] + HEIGHT))


def consistent_layout(
    z: FloatArray, positions: FloatArray, tolerance: float = TOLERANCE
) -> BoolArray:
    """Which of several landmarks lie to each other as they are seen.

    Each two of them tell a pose; that with which most of all agree wins. Of up to two landmarks
    none is taken: there is nothing to compare them with.

    Args:
        z: (m, 2) range and bearing.
        positions: (m, 2) of the landmarks in the map.
        tolerance: share of the range, and metres, by which one may miss.

    Returns:
        (m,).
    """
    m = len(z)
    if m < 3:
        return np.zeros(m, np.bool_)
    seen = z[:, 0] * np.exp(1j * z[:, 1])  # in the robot's frame
    there = positions[:, 0] + 1j * positions[:, 1]
    i, j = np.triu_indices(m, 1)
    turn = (there[j] - there[i]) * np.conj(seen[j] - seen[i])
    turn /= np.maximum(np.abs(turn), 1e-12)
    middle_seen, middle_there = (seen[i] + seen[j]) / 2, (there[i] + there[j]) / 2
    missed = np.abs(
        middle_there[:, None] + turn[:, None] * (seen - middle_seen[:, None]) - there
    )  # (pairs, m)
    fits = missed < tolerance * z[:, 0] + tolerance
    best = fits[np.argmax(fits.sum(1))]
    return best if best.sum() >= min(MIN_AGREEING, m) else np.zeros(m, np.bool_)


def consistent_subset(v: FloatArray, S: FloatArray, gate: float) -> BoolArray:
    """Which of some sightings the others bear out.

    Those that fit together best are left after the one that the others contradict most has been
    taken away, again and again. What one sighting should be by all others follows from the
    inverse of the covariance of all.

    Args:
        v: (m, 2) innovations.
        S: (2m, 2m) their covariance.
        gate: probability with which a right one is borne out.

    Returns:
        (m,).
    """
    kept = np.arange(len(v))
    while len(kept) > 1:
        rows = (2 * kept[:, None] + (0, 1)).ravel()
        Q = np.linalg.inv(S[np.ix_(rows, rows)])
        i = np.arange(len(kept))
        own = Q.reshape(len(kept), 2, -1, 2)[i, :, i]  # of each, given the others: inverted
        missed = (Q @ v[kept].ravel()).reshape(-1, 2)
        distance = normalized_squared(missed, own)
        worst = int(distance.argmax())
        if distance[worst] < chi_square_gate(2, gate):
            break
        kept = np.delete(kept, worst)
    return np.isin(np.arange(len(v)), kept)


def enforce_spacing(
    xy: Float32Array, order: IntArray, occupied: Float32Array, min_spacing: float, count: int
) -> IntArray:
    """The first of some points that are not near one another, nor near others.

    Args:
        xy: (n, 2) pixels.
        order: (n,) indices, the most wanted first.
        occupied: (k, 2) pixels that are occupied.
        min_spacing: pixels.
        count: how many are wanted.

    Returns:
        (up to count,) indices.
    """
    near = [*occupied]
    chosen: list[int] = []
    for i in order.tolist():
        if len(chosen) == count:
            break
        if not near or np.square(np.asarray(near) - xy[i]).sum(1).min() >= min_spacing**2:
            near.append(xy[i])
            chosen.append(i)
    return np.asarray(chosen, np.int64)


def count_rematches(followed: TrackedPoints, found: TrackedPoints, ratio: float) -> TrackedPoints:
    """Followed points, looked for by their looks alone among what is found in the same frame.

    Whoever is not known again while it is in plain sight will not be after it was lost.

    Args:
        followed: k points.
        found: n points.
        ratio: as that of `descriptor_matches`.
    """
    pairs = descriptor_matches(found.keypoints, followed.descriptor, ratio)
    distance = np.hypot(*(found.xy[pairs[:, 0]] - followed.xy[pairs[:, 1]]).T)
    counts = followed.rematches.copy()
    counts[pairs[distance < HERE, 1]] += 1
    return replace(followed, rematch_attempts=followed.rematch_attempts + 1, rematches=counts)
