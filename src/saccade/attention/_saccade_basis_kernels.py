"""The logits of the next fixation of a fitted model."""

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray

EARLY = 6
"""Number of the factor that falls with the number of the fixation."""


@kernel()
def fill_logits(
    fields: FloatArray, tables: FloatArray, anchors: IntArray, factors: FloatArray, out: FloatArray
) -> None:
    """Fill `out` (h, w) by the fields and the tables about their anchors (T, 2), row and column."""
    h, w = out.shape
    for i in range(h):
        for j in range(w):
            out[i, j] = fields[0, i, j] + factors[EARLY] * fields[1, i, j]
        for t in range(len(factors)):
            factor = factors[t]
            if factor != 0:
                row = i - anchors[t, 0] + h - 1
                first = w - 1 - anchors[t, 1]
                for j in range(w):
                    out[i, j] += factor * tables[t, row, first + j]
