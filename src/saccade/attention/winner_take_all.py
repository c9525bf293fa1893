"""The winner-take-all network of `saccade.attention.scanpath`, in strides of many time steps.

With constant conductance the recurrence has a closed form, so that one stride covers up to
`MAX_STRIDE` steps. If a cell reaches the threshold, the stride is repeated in shorter strides, down
to a single step.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from saccade.types import BoolArray, FloatArray, IntArray

MAX_STRIDE = 100
"""Maximum number of steps in a stride, in which the inhibition decays by 1 %."""
STRONGEST = 256
"""Number of cells simulated at first; weaker cells rarely win."""
BOUND_MARGIN = 1.01
"""Safety factor on the bound of the cells left out; strides are accurate to 0.2 %."""
POLE_DISTANCE = 1e-9
"""Minimum distance from the poles of the closed form; closer rates are moved to this distance."""
RESET_DELAY = 2
"""Steps from a spike to the reset of the winner layer."""


class Network(NamedTuple):
    """Constants of the network per time step."""

    map_rate: float
    """Time step over the time constant of the map layer."""
    winner_rate: float
    """Time step over the time constant of the winner layer."""
    decay_rate: float
    """Time step over the time constant of the inhibition of return."""
    gain: float
    """Equilibrium potential of the winner layer per potential of the map layer."""
    threshold: float
    """Firing threshold of a winner cell."""
    reset: float
    """Potential of the winner layer after a reset."""
    inhibition: float
    """Increase of the conductance at the winner, per potential of the winner."""
    surround: float
    """Excitation of the surround, as a fraction of `inhibition`."""
    sigma: float
    """Standard deviation of the inhibited disc, in cells."""
    last_step: int
    """Maximum number of steps."""


class Cells(NamedTuple):
    """Cells that can win, from the strongest input to the weakest; each array is (n,)."""

    row: IntArray
    """Row of each cell in the map."""
    column: IntArray
    """Column of each cell in the map."""
    number: IntArray
    """Column-major index in the map; if several cells exceed the threshold, the lowest index
    wins."""
    current: FloatArray
    """Input to the map layer per time step."""


def run_network(
    net: Network,
    current: FloatArray,
    fixations: int,
    region: Callable[[int, int], BoolArray | None] | None = None,
) -> tuple[IntArray, IntArray, IntArray]:
    """The winning cells, and the steps in which they spike.

    Args:
        net: constants of the network.
        current: (h, w) input to the map layer per time step; a cell of 0 never wins.
        fixations: maximum number of winners.
        region: function that returns the (h, w) mask of cells to inhibit after cell (row, column)
            has won; None, or a result of None, for a disc.

    Returns:
        (n,) rows, (n,) columns and (n,) steps.
    """
    column, row = np.nonzero(current.T)  # column-major: the first of several winners counts
    order = np.argsort(-current[row, column], kind="stable")
    cells = Cells(row[order], column[order], order, current[row, column][order])
    simulated, found = STRONGEST, None
    while found is None:
        found = run_strongest(net, cells, simulated, fixations, region)
        simulated *= 8
    winners, spikes = found
    return cells.row[winners], cells.column[winners], np.array(spikes, np.int64)


def run_strongest(
    net: Network,
    cells: Cells,
    simulated: int,
    fixations: int,
    region: Callable[[int, int], BoolArray | None] | None,
) -> tuple[list[int], list[int]] | None:
    """Indices of the winning cells and their steps; None if a cell left out might win.

    The last cell bounds the cells left out: it has their highest current and their lowest
    conductance.
    """
    current = np.append(cells.current[:simulated], BOUND_MARGIN * cells.current[simulated:][:1])
    V, W, g = current.copy(), np.full(len(current), net.reset), np.zeros(len(cells.row))
    winners, spikes = list[int](), list[int]()
    step, reset_at, steps = 0, 0, MAX_STRIDE
    while len(winners) < fixations and step < net.last_step:
        steps = 1 if step < reset_at else min(steps, net.last_step - step)
        lowest = g[simulated:].min(initial=np.inf)
        conductance = np.append(g[:simulated], lowest)[: len(current)]
        next_V, next_W = advance(net, steps, V, W, conductance, current)
        over = np.flatnonzero(next_W > net.threshold)
        if len(over) and steps > 1:
            steps = max(1, steps // 4)
            continue
        step += steps
        V, W = next_V, next_W
        g *= (1 - net.decay_rate) ** steps
        if step == reset_at:
            W[:] = net.reset
            steps = MAX_STRIDE
        elif len(over):
            if over[-1] == simulated:
                return None
            winner = int(over[cells.number[over].argmin()])
            winners.append(winner)
            spikes.append(step)
            W[over] = 0
            g += net.inhibition * V[winner] * inhibition_by(net, cells, winner, region)
            reset_at = step + RESET_DELAY if reset_at <= step else reset_at
    return winners, spikes


def inhibition_by(
    net: Network,
    cells: Cells,
    winner: int,
    region: Callable[[int, int], BoolArray | None] | None,
) -> FloatArray:
    """(n,) increase of each cell's conductance, as a fraction of the winner's increase."""
    row, column = int(cells.row[winner]), int(cells.column[winner])
    inhibited = None if region is None else region(row, column)
    if inhibited is not None:
        return inhibited[cells.row, cells.column].astype(np.float64)
    squared = (cells.row - row) ** 2 + (cells.column - column) ** 2
    wide = np.exp(-squared / (2 * (4 * net.sigma) ** 2))
    return np.asarray(wide**16 - net.surround * wide)


def advance(
    net: Network, steps: int, V: FloatArray, W: FloatArray, g: FloatArray, current: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """V and W of the cells (n,) after a stride.

    The conductance is held at its value in the middle of the stride. With `a = 1 - map_rate - g`
    and `b = 1 - winner_rate`, the potential is `V[j] = P + Q j + (V - P) a^j`, and W is its sum
    weighted by powers of b. P + Q j is the equilibrium of V, and Q its slope while a strong
    inhibition decays.
    """
    midpoint, b = (steps - 1) / 2, 1 - net.winner_rate
    b_n = b**steps
    sum_of_one = (1 - b_n) / net.winner_rate  # of b^(n - 1 - j) over the steps j
    sum_of_j = (steps - b * sum_of_one) / net.winner_rate  # of j b^(n - 1 - j)
    g = g * (1 - net.decay_rate) ** midpoint
    rate = net.map_rate + g
    rate[np.abs(rate) < POLE_DISTANCE] = POLE_DISTANCE
    a = np.maximum(0.0, 1 - rate)
    a[np.abs(a - b) < POLE_DISTANCE] = b + POLE_DISTANCE
    a_n = a**steps
    equilibrium = current / rate
    Q = np.where(g > net.map_rate, equilibrium * net.decay_rate * g / rate, 0.0)
    P = equilibrium - Q * (midpoint + 1 / rate)
    sum_of_a = a * (a_n - b_n) / (a - b)
    driven = P * sum_of_one + Q * sum_of_j + (V - P) * sum_of_a
    return P + Q * steps + (V - P) * a_n, b_n * W + net.winner_rate * net.gain * driven
