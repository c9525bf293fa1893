"""Comparison of a scan with the landmarks that are expected in view."""

from math import exp, hypot, log2, pi, sqrt

import numpy as np

from saccade._jit import kernel
from saccade.slam.association._kernels import mahalanobis_distances
from saccade.slam.filter._kernels import expected_observations
from saccade.slam.filter._state_kernels import FilterState
from saccade.types import BoolArray, FloatArray, IntArray

RANGE_BINS = 96
"""Bins of the detection rate by range: quarters of an octave from 0.24 mm to 4 km."""
BEARING_BINS = 24
"""Bins of the detection rate by bearing."""
PRIOR_CHECKS = 4.0
"""Initial number of checks without a detection in each bin, so that new bins expect none."""


@kernel()
def detection_rates(
    predicted: FloatArray, counts: FloatArray, cell: IntArray, rate: FloatArray
) -> None:
    """Fills the cell of each predicted observation (n, 2), and the detection rate there.

    `counts` (2, cells) are the detections and the checks in each cell of range and bearing.
    """
    for j in range(len(predicted)):
        octaves = 4 * log2(max(predicted[j, 0], 1e-6)) + RANGE_BINS / 2
        row = min(max(int(octaves), 0), RANGE_BINS - 1)
        sector = int((predicted[j, 1] / (2 * pi) + 0.5) * BEARING_BINS) % BEARING_BINS
        cell[j] = row * BEARING_BINS + sector
        rate[j] = counts[0, cell[j]] / (counts[1, cell[j]] + PRIOR_CHECKS)


@kernel()
def compare_scan(
    f: FilterState,
    z: FloatArray,
    R: FloatArray,
    rows: IntArray,
    confirmed: BoolArray,
    max_range: float,
    gate: float,
    counts: FloatArray,
    rate: FloatArray,
    observed: BoolArray,
    explained: BoolArray,
    sums: FloatArray,
) -> int:
    """Compares observations with landmarks in view that are confirmed (N,) or labeled.

    Args:
        f: the state, with N landmarks.
        z: (k, 2) observations.
        R: (k, 2, 2) their covariances.
        rows: (k,) row of the landmark of each label, negative for none.
        confirmed: (N,) whether a landmark is expected without a label.
        max_range: meters to the most distant landmark in view.
        gate: squared Mahalanobis distance within which an observation may be of a landmark.
        counts: (2, cells) detections and checks in each cell of the view.
        rate: (N,) is filled with the detection rate of each landmark in view.
        observed: (N,) is filled with whether an observation has it as its likeliest landmark.
        explained: (k,) is filled with whether an observation is the likeliest one of its likeliest
            landmark.
        sums: (k, 2) is filled with the sum of densities, and the sum of densities times detection
            rates.

    Returns:
        c, the number of landmarks in view.
    """
    landmark, count = np.empty(len(rate), np.int64), 0
    for i in range(f.now.landmarks):
        m = f.robot_size + 2 * i
        is_near = hypot(f.state[m] - f.state[0], f.state[m + 1] - f.state[1]) <= max_range
        in_view = confirmed[i] and is_near
        for row in rows:
            in_view = in_view or row == i
        if in_view:
            landmark[count] = i
            count += 1
    landmark = landmark[:count]
    predicted, S, square = np.empty((count, 2)), np.empty((count, 2, 2)), np.empty((len(z), count))
    expected_observations(f, landmark, predicted, S)
    mahalanobis_distances(predicted, S, z, R, gate, square)
    detection_rates(predicted, counts, np.empty(count, np.int64), rate)
    observer, likelihood = np.full(count, -1), np.zeros(count)
    for k in range(len(z)):
        sums[k, 0] = sums[k, 1] = 0.0
        likeliest, most = -1, 0.0
        for j in range(count):
            if not square[k, j] <= gate:
                continue
            if rows[k] >= 0 and rows[k] != landmark[j]:
                continue
            a, b, d = (
                S[j, 0, 0] + R[k, 0, 0],
                S[j, 0, 1] + R[k, 0, 1],
                S[j, 1, 1] + R[k, 1, 1],
            )
            area = 2 * pi * min(sqrt(a * d - b * b), max_range)
            density = exp(-square[k, j] / 2) / area
            sums[k, 0] += density
            sums[k, 1] += rate[j] * density
            if density > most:
                likeliest, most = j, density
        if likeliest >= 0 and most > likelihood[likeliest]:
            observer[likeliest], likelihood[likeliest] = k, most
    for j in range(count):
        observed[j] = observer[j] >= 0
        if observed[j]:
            explained[observer[j]] = True
    return count
