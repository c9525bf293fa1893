"""The winner-take-all network of `saccade.attention.scanpath`, many time steps at once.

While the conductance is held constant the recurrence has a closed form, so that one stride covers
up to `MAX_STRIDE` steps. A stride in which a cell reaches the threshold is repeated in shorter ones
until it is a single step.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from saccade.types import BoolArray, FloatArray, IntArray

MAX_STRIDE = 100
"""Largest number of steps in a stride; the inhibition decays by 1 % meanwhile."""
STRONGEST = 256
"""Number of cells that are simulated at first: weaker ones rarely win."""
BOUND_MARGIN = 1.01
"""Factor on the bound of the cells that are not simulated: strides are accurate to 0.2 %."""
POLE_DISTANCE = 1e-9
"""Smallest distance from the poles of the closed form; rates nearer to one are moved here."""
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
    """Equilibrium of the winner layer per potential of the map layer."""
    threshold: float
    """Potential over which a winner cell spikes."""
    reset: float
    """Potential to which the winner layer is reset."""
    inhibition: float
    """Increase of the conductance at the winner, per potential of the winner."""
    surround: float
    """Fraction of it that excites the surround."""
    sigma: float
    """Standard deviation of the inhibited disc, in cells."""
    last_step: int
    """Number of steps after which the network stops."""


class Cells(NamedTuple):
    """Cells that can win, from the strongest input to the weakest; each array is (n,)."""

    row: IntArray
    """Row of each cell in the map."""
    column: IntArray
    """Column of each cell in the map."""
    number: IntArray
    """Position down the columns of the map: of several over the threshold the lowest wins."""
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
        net: constants.
        current: (h, w) input to the map layer per time step; a cell of 0 never wins.
        fixations: maximum number of winners.
        region: the (h, w) cells that are inhibited after the cell (row, column) has won; None, or
            a result of None, for a disc.

    Returns:
        (n,) rows, (n,) columns and (n,) steps.
    """
    column, row = np.nonzero(current.T)  # down the columns: of several winners the first counts
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
    """Indices of the winning cells and their steps; None if a cell that is left out might win.

    The cells that are left out are bounded by one of the highest current and the lowest conductance
    of them, which stands last.
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
    """(n,) increase of the conductance of each cell as a fraction of that of a winner."""
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

    With the conductance of the middle step throughout, `a = 1 - map_rate - g` and
    `b = 1 - winner_rate`, the potential is `V[j] = P + Q j + (V - P) a^j`, and W is its sum
    weighted by powers of b. P + Q j is the equilibrium of V; Q is its slope while a strong
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
