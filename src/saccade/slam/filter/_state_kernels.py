"""The state of the filter, and the kernels that manage its memory."""

from ctypes import Structure, c_double, c_int64
from typing import Any

from saccade._jit import kernel, structure
from saccade.types import FloatArray, IntArray

STANDARD = 0
"""Errors along the axes of the map, see `state.ERRORS`."""
INVARIANT = 1
"""Right-invariant errors, see `state.ERRORS`."""
MAX_HEADING_GROWTH = 0.0025
"""Square radians by which the heading variance may grow before the covariance is inflated."""


class Scalars(Structure):
    """Numbers of a `FilterState` that change from step to step."""

    _fields_ = (
        ("landmarks", c_int64),  # N
        ("next_id", c_int64),  # id of the landmark that is augmented next
        ("auxiliary", c_int64),  # auxiliary points in use
        ("downdates", c_int64),  # rows of `FilterState.downdates` in use
        ("updates", c_int64),  # rows of `FilterState.updates` in use
        ("flushed", c_int64),  # rows of P with `updates` and `downdates`, while others are without
        ("mergeable_variance", c_double),  # heading's, of the last row of `updates` while no lever
        # has changed, else 0
        ("heading_variance", c_double),  # after the last observation
        (
            "lowest_heading_variance",
            c_double,
        ),  # the lowest since the last inflation
        ("nonlinearity", c_double),  # sum over the updates of the fraction of the innovation's
        # variance that is of second order
        ("nonlinear_updates", c_int64),  # their number
    )


@structure
class FilterState:
    """A Gaussian over the robot, r numbers of which three are its pose, and N landmarks.

    Capacity: size = r + 2 (c + auxiliary) for the c landmarks for which there is room; n in use,
    see `num_rows`.
    """

    robot_size: int
    """r."""
    errors: int
    """Error parametrization: `STANDARD` or `INVARIANT`."""
    huber: float
    """Root of the normalized innovation squared beyond which an observation has less weight."""
    range_errors: int
    """First row of the scale error and the offset of the ranges, which are the robot's last states;
    0 where they are not estimated."""
    auxiliary: int
    """Capacity for points behind the landmarks that are corrected with them and never observed, see
    `submaps`; without diagonal blocks."""
    ids: IntArray
    """(c,) id of the landmark in each row, ascending; it never changes and is never used again."""
    state: FloatArray
    """(size,) x, y, theta, other states of the robot, m1x, m1y, ... (C.3)."""
    heading_lever: FloatArray
    """(size,) a."""
    P: FloatArray
    """(size, size) of eta (C.4): the robot's r rows, and the upper triangle of the landmarks'
    covariance without `downdates` and `updates`."""
    blocks: FloatArray
    """(c, 3) of eta: xx, xy, yy of the diagonal block of each landmark, up to date."""
    downdates: FloatArray
    """(rank, size) rows Y, of which Y^T Y is still to be subtracted from P."""
    updates: FloatArray
    """(rank, size) rows Y, of which Y^T Y is still to be added to P."""
    now: Scalars
    """Numbers that change from step to step."""


@kernel()
def bind_state(fields: tuple[Any, ...]) -> FilterState:
    """A state of these fields, in their order, see `_compiler.share`."""
    return FilterState(*fields)


@kernel(inline=True)
def num_rows(f: FilterState) -> int:
    """n: number of rows of the state in use, which end with the last auxiliary point if any."""
    if f.auxiliary > 0:
        return len(f.state) - 2 * int(f.auxiliary - f.now.auxiliary)
    return f.robot_size + 2 * int(f.now.landmarks)


@kernel()
def find_rows(f: FilterState, landmarks: IntArray, rows: IntArray) -> None:
    """Fill the rows (k,) of landmarks by their ids, -1 for landmarks outside of the state.

    Negative ids stay, and ids of landmarks that are yet to be added have the rows behind.
    """
    ids, N, next_id = f.ids, int(f.now.landmarks), int(f.now.next_id)
    for k in range(len(landmarks)):
        wanted = landmarks[k]
        if wanted < 0:
            rows[k] = wanted
        elif wanted >= next_id:
            rows[k] = N + wanted - next_id
        else:
            start, end = 0, N  # the row is in [start, end)
            while start < end:
                middle = (start + end) // 2
                if ids[middle] < wanted:
                    start = middle + 1
                else:
                    end = middle
            rows[k] = start if start < N and ids[start] == wanted else -1


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
