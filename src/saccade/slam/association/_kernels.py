"""Mahalanobis distances of observations from landmarks."""

from math import atan2, inf, sqrt

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter._kernels import (
    MIN_RANGE,
    expected_observation,
    is_relative,
    wrapped,
)
from saccade.slam.filter._state_kernels import FilterState
from saccade.types import FloatArray, IntArray

_SLACK = 1 + 1e-9
"""Factor on gates, so that rounding excludes no landmark."""


@kernel()
def mahalanobis_distances(
    expected: FloatArray,
    S: FloatArray,
    z: FloatArray,
    R: FloatArray,
    gate: float,
    distance: FloatArray,
) -> None:
    """Fills squared Mahalanobis distances (m, c), infinite over `gate`.

    Observations z (m, 2) with R (m, 2, 2) are compared with c predicted observations; see
    `expected_observations`.
    """
    for i in range(len(z)):
        for j in range(len(expected)):
            distance[i, j] = inf
            v = z[i, 0] - expected[j, 0]
            a = S[j, 0, 0] + R[i, 0, 0]
            if v * v > gate * a:
                continue
            w = wrapped(z[i, 1] - expected[j, 1])
            c, d = S[j, 0, 1] + R[i, 0, 1], S[j, 1, 1] + R[i, 1, 1]
            if w * w <= gate * d:
                square = squared_distance(v, w, a, c, d)
                if square <= gate:
                    distance[i, j] = square


@kernel()
def squared_distance(v: float, w: float, a: float, c: float, d: float) -> float:
    """Squared Mahalanobis distance of (v, w) by [[a, c], [c, d]]; infinite if that is singular."""
    determinant = a * d - c * c
    return (d * v * v - 2 * c * v * w + a * w * w) / determinant if determinant > 0 else inf


@kernel()
def compare_with_landmarks(
    f: FilterState,
    z: FloatArray,
    R: FloatArray,
    landmark: IntArray,
    nis: FloatArray,
    variance_ratio: FloatArray,
) -> None:
    """Compares each of m observations with a landmark (m,), negative for none.

    Fills the normalized innovation squared, and the ratio of predicted variance to noise, the
    larger of its values for range and bearing. Systematic errors of the ranges count in the first
    only: they are common to all landmarks, and no sign of an uncertain pose.
    """
    expected, S, variance = np.empty(2), np.empty((2, 2)), np.empty(2)
    for i in range(len(z)):
        if landmark[i] >= 0:
            expected_observation(f, landmark[i], expected, S, variance)
            v, u, N = z[i, 0] - expected[0], wrapped(z[i, 1] - expected[1]), R[i]
            a, c, d = S[0, 0] + N[0, 0], S[0, 1] + N[0, 1], S[1, 1] + N[1, 1]
            nis[i] = squared_distance(v, u, a, c, d)
            variance_ratio[i] = max(variance[0] / N[0, 0], variance[1] / N[1, 1])


@kernel()
def prefilter_landmarks(
    f: FilterState, z: FloatArray, R: FloatArray, gate: float, landmark: IntArray
) -> int:
    """Fills in the landmarks that may be inside the gate of an observation; returns their number.

    The standard deviation of a sum is at most the sum of the standard deviations: this bound
    excludes no pair inside the gate, and most others without their covariance.
    """
    r, s, a, P, blocks, count = f.robot_size, f.state, f.heading_lever, f.P, f.blocks, 0
    position_sigma, heading_sigma = sqrt(abs(P[0, 0]) + abs(P[1, 1])), sqrt(abs(P[2, 2]))
    nearest, farthest, range_variance, bearing_variance = inf, -inf, 0.0, 0.0
    for k in range(len(z)):
        nearest, farthest = min(nearest, z[k, 0]), max(farthest, z[k, 0])
        range_variance = max(range_variance, R[k, 0, 0])
        bearing_variance = max(bearing_variance, R[k, 1, 1])
    radius, range_sigma = sqrt(gate) * _SLACK, sqrt(range_variance)
    e, factor, offset, scale_sigma = f.range_errors, 1.0, 0.0, 0.0
    if e > 0:
        factor, offset = 1 + s[e], s[e + 1]
        scale_sigma = sqrt(abs(P[e, e])) / (1.0 if is_relative(f, e) else factor)
        range_sigma += sqrt(abs(P[e + 1, e + 1]))
    for i in range(f.now.landmarks):
        m = r + 2 * i
        dx, dy = s[m] - s[0], s[m + 1] - s[1]
        q = sqrt(dx * dx + dy * dy)
        lever = abs(a[m] - a[0]) + abs(a[m + 1] - a[1])
        sigma = position_sigma + sqrt(abs(blocks[i, 0]) + abs(blocks[i, 2]))
        sigma += lever * (heading_sigma + scale_sigma)
        along = radius * (factor * (sigma + q * scale_sigma) + range_sigma)
        reach = factor * q + offset
        if reach - farthest > along or nearest - reach > along:
            continue
        bearing, across = 0.0, inf
        if q > MIN_RANGE:
            bearing = atan2(dy, dx) - s[2]
            across = radius * sqrt((sigma / q + heading_sigma) ** 2 + bearing_variance)
        for k in range(len(z)):
            if abs(z[k, 0] - reach) <= along and abs(wrapped(z[k, 1] - bearing)) <= across:
                landmark[count] = i
                count += 1
                break
    return count
