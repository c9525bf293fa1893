"""The likelihood of fixations given those before, and its gradient."""

from math import exp, log

import numpy as np

from saccade._jit import kernel
from saccade.attention._scanpath_model_kernels import EARLY, fill_logits
from saccade.types import FloatArray, IntArray


@kernel()
def add_likelihood(
    fields: FloatArray,
    tables: FloatArray,
    anchors: IntArray,
    factors: FloatArray,
    cells: IntArray,
    fields_gradient: FloatArray,
    table_gradient: FloatArray,
) -> float:
    """Returns the negative log-likelihood of the fixations and accumulates its gradient.

    Args:
        fields: (2, h, w) logits added for every fixation, and logits scaled by the factor `EARLY`.
        tables: (T, 2 h - 1, 2 w - 1) logits by offset from the anchor.
        anchors: (n, T, 2) row and column of the fixation about which each table is centered.
        factors: (n, T) factor of each table.
        cells: (n, 2) row and column of the fixations.
        fields_gradient: gradient with respect to `fields`, accumulated in place.
        table_gradient: gradient with respect to `tables`, accumulated in place.
    """
    h, w = fields.shape[1:]
    p = np.empty((h, w))
    total = 0.0
    for n in range(len(cells)):
        fill_logits(fields, tables, anchors[n], factors[n], p)
        largest = p.max()
        at = p[cells[n, 0], cells[n, 1]] - largest
        norm = 0.0
        for i in range(h):
            for j in range(w):
                p[i, j] = exp(p[i, j] - largest)
                norm += p[i, j]
        total += log(norm) - at
        for i in range(h):
            for j in range(w):
                p[i, j] /= norm
        p[cells[n, 0], cells[n, 1]] -= 1
        for i in range(h):
            for j in range(w):
                fields_gradient[0, i, j] += p[i, j]
                fields_gradient[1, i, j] += factors[n, EARLY] * p[i, j]
            for t in range(factors.shape[1]):
                factor = factors[n, t]
                if factor != 0:
                    row = i - anchors[n, t, 0] + h - 1
                    first = w - 1 - anchors[n, t, 1]
                    for j in range(w):
                        table_gradient[t, row, first + j] += factor * p[i, j]
    return total
