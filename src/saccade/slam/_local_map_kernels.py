"""Blocks of a covariance of which the upper triangle is stored."""

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray


@kernel()
def read_block(P: FloatArray, rows: IntArray, columns: IntArray, block: FloatArray) -> None:
    """Fill block (m, k) with the elements at these rows and columns of the symmetric P."""
    for i in range(len(rows)):
        row = rows[i]
        for j in range(len(columns)):
            column = columns[j]
            block[i, j] = P[row, column] if row <= column else P[column, row]


@kernel()
def write_block(
    P: FloatArray, rows: IntArray, columns: IntArray, block: FloatArray, keep: float
) -> None:
    """Set the elements at these rows and columns of the upper triangle to keep P + block (m, k).

    With rows among the columns, the block is symmetric and `keep` zero.
    """
    for i in range(len(rows)):
        row = rows[i]
        for j in range(len(columns)):
            column = columns[j]
            if row <= column:
                P[row, column] = keep * P[row, column] + block[i, j]
            else:
                P[column, row] = keep * P[column, row] + block[i, j]
