"""Memory layout of the filter, and the kernels that manage it."""

from typing import NamedTuple

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray

STANDARD, INVARIANT, FIRST_ESTIMATES = 0, 1, 2
"""The error parametrizations, see `error_state.Retraction`."""
LANDMARKS, DOWNDATES, UPDATES, CACHED = 0, 1, 2, 3
"""Indices into `FilterState.counts`."""
MAX_HEADING_GROWTH = 0.0025
"""Square radians by which the heading variance may grow before the covariance is spread."""


class FilterState(NamedTuple):
    """A Gaussian over the robot, r numbers of which three are its pose, and N landmarks.

    Capacity: size = r + 2 (N + auxiliary) for the N landmarks for which there is room; n in use,
    see `num_rows`.
    """

    robot_size: int
    """r."""
    error_state: int
    """Error parametrization: `STANDARD`, `INVARIANT` or `FIRST_ESTIMATES`."""
    huber: float
    """Root of the normalized innovation squared beyond which an observation has less weight."""
    auxiliary: int
    """Points behind the landmarks that are corrected with them and never observed, see
    `compressed`; without diagonal blocks."""
    state: FloatArray
    """(size,) x, y, theta, other states of the robot, m1x, m1y, ... (C.3)."""
    heading_lever: FloatArray
    """(size,) a."""
    P: FloatArray
    """(size, size) of eta (C.4): the robot's r rows, and the upper triangle of the landmarks'
    covariance without `downdates` and `updates`."""
    blocks: FloatArray
    """(N, 3) of eta: xx, xy, yy of the diagonal block of each landmark, up to date."""
    downdates: FloatArray
    """(rank, size) rows Y, of which Y^T Y is still to be subtracted from P."""
    updates: FloatArray
    """(rank, size) rows Y, of which Y^T Y is still to be added to P."""
    mergeable_variance: FloatArray
    """(1,) heading variance of the last row of `updates` while no lever has changed, else 0."""
    cached_rows: FloatArray
    """(rank, size) pairs of full rows of P, of landmarks observed since the last flush."""
    cached_pair: IntArray
    """(N,) index of the pair of each landmark in `cached_rows`, -1 if there is none."""
    heading_variance: FloatArray
    """(2,) after observations: the lowest since the covariance was last `spread`, and the last."""
    nonlinearity: FloatArray
    """(2,) sum over the updates of the fraction of the innovation's variance that is of second
    order, and their number."""
    counts: IntArray
    """(4,) of landmarks, of rows of `downdates` and `updates`, and of cached pairs."""


class Scratch(NamedTuple):
    """Memory for the matrices of a step, of r numbers of the robot's state."""

    control: FloatArray
    """(3,) with the odometry bias."""
    pose: FloatArray
    """(r,) predicted state of the robot."""
    Fx: FloatArray
    """(r, r) motion Jacobian by the robot's state (C.8)."""
    Fu: FloatArray
    """(r, 3) motion Jacobian by the control (C.9)."""
    Q: FloatArray
    """(r, r) motion noise."""
    G: FloatArray
    """(r, r) motion Jacobian by eta."""
    Pxx: FloatArray
    """(r, r) covariance of the robot before the motion."""
    rows: FloatArray
    """(r, size) rows of the robot before the motion."""
    heading_row: FloatArray
    """(r,) change of the heading's error in a motion, by eta."""
    heading_covariance: FloatArray
    """(r,) of that change with the robot's state."""
    H: FloatArray
    """(2, r + 2) observation Jacobian (C.14)."""
    R: FloatArray
    """(2, 2) observation noise."""
    Gz: FloatArray
    """(2, 2) Jacobian of the inverse observation by the observation (C.18)."""
    Gx: FloatArray
    """(2, r) Jacobian of the inverse observation by the robot's state (C.18)."""
    xy: FloatArray
    """(2,) position of a new landmark (C.15)."""
    row: FloatArray
    """(r,) a row of Gx, by eta."""
    C: FloatArray
    """(r + 2, r + 2) covariance of eta of the robot and one landmark."""
    D: FloatArray
    """(2, r + 2) whitened observation Jacobian."""
    A: FloatArray
    """(2, 2) inverse root of the innovation covariance."""
    S: FloatArray
    """(2, 2) innovation covariance with Huber's larger noise."""
    second_order: FloatArray
    """(3, 3) covariance of the errors of distance, bearing and heading; its lower triangle."""


@kernel()
def num_rows(f: FilterState) -> int:
    """n: rows of the state in use; with auxiliary points, all of them."""
    return len(f.state) if f.auxiliary > 0 else int(f.robot_size + 2 * f.counts[LANDMARKS])


@kernel(inline=True)
def is_full(f: FilterState) -> bool:
    """Whether there is no room for another step and another landmark."""
    full = len(f.downdates) - f.counts[DOWNDATES] < 3 or f.counts[UPDATES] == len(f.updates)
    return bool(full or f.counts[LANDMARKS] == len(f.blocks))


@kernel(inline=True)
def is_spread_due(f: FilterState) -> bool:
    """Whether the covariance is to be `spread` before the next motion."""
    growth = f.heading_variance[1] - f.heading_variance[0]
    return bool(f.error_state == INVARIANT and growth > MAX_HEADING_GROWTH)


@kernel(inline=True)
def invalidate_cache(f: FilterState) -> None:
    """Invalidate the cached rows of P."""
    for i in range(f.counts[LANDMARKS]):
        f.cached_pair[i] = -1
    f.counts[CACHED] = 0


@kernel()
def gather(P: FloatArray, rows: IntArray) -> None:
    """Move these rows (m,), ascending, and their columns to the beginning of the upper triangle."""
    first = 0
    while first < len(rows) and rows[first] == first:
        first += 1
    for i in range(len(rows)):
        target, source = P[i], P[rows[i]]
        for j in range(max(first, i), len(rows)):
            target[j] = source[rows[j]]
