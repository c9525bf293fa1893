"""The winner-take-all network, run in leaps: the kernels of `saccade.attention.scanpath`.

The network is defined by its steps, but is not run step by step: with the conductance held the
recurrence has a closed form, so that it leaps over many steps at once.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray

LEAP = 100
"""The most steps at once; the inhibition decays by 1 % meanwhile."""
SAFETY = 1.01
"""By how much the bound on cells that have not joined is raised: leaps are good to 0.2 %."""
POLE = 1e-9
"""How near to its poles the closed form is used; nearer ones are moved here."""


class Network(NamedTuple):
    """The network's constants per step."""

    leak: float
    forget: float
    decay: float
    gain: float
    threshold: float
    reset: float
    kick: float
    """How far the conductance jumps at the winner, by its potential."""
    surround: float
    sigma: float
    """Of the disc, in cells."""
    last_step: int


class Leap(NamedTuple):
    """What all cells share in a leap of some steps."""

    steps: int
    middle: float
    decay_to_middle: float
    """Of the conductance, until the middle of the leap."""
    decay: float
    """The same until its end."""
    b: float
    b_n: float
    """What is left of W."""
    sum_of_one: float
    """The sum of 1 over the steps, fading with b."""
    sum_of_j: float
    """The same of the number of the step."""


@kernel()
def race(
    net: Network,
    current: FloatArray,
    row: IntArray,
    column: IntArray,
    cells: IntArray,
    fixations: int,
    regions: npt.NDArray[np.bool_],
) -> tuple[IntArray, IntArray]:
    """The winners and their steps, from cells in falling order of what drives them.

    `regions` (r, h, w) are what the inhibition covers at the first r winners; a disc where a
    region is empty, and at later winners.

    Weak cells join when they might win. Until then none of them is over
    `free + current * bound_W`: `free` is what the reset has left, and the bound is a cell of unit
    current and the least conductance of theirs, `low`.
    """
    V, W, g = np.empty_like(current), np.empty_like(current), np.zeros_like(current)
    V_next, W_next = np.empty_like(current), np.empty_like(current)
    bound_V, bound_W, low, free, joined = 1.0, 0.0, 0.0, net.reset, 0
    winner, spike = np.empty(fixations, np.int64), np.empty(fixations, np.int64)
    event_step = np.empty(2 * fixations, np.int64)
    event_jump = np.empty((2 * fixations, 4))  # row, column, height; 0 for a reset; winner
    found, events, step, reset_at, stride = 0, 0, 0, 0, LEAP
    while found < fixations and step < net.last_step:
        stride = 1 if step < reset_at else min(stride, net.last_step - step)
        resets = step + stride == reset_at
        over = leap_of(net, stride)
        first = leap(net, over, joined, current, cells, V, W, g, V_next, W_next)
        if first >= 0 and stride > 1:
            stride = max(1, stride // 4)
            continue
        next_V, next_W = leap_cell(net, over, bound_V, bound_W, low, 1.0)
        next_free = free * over.b_n
        known = joined
        while (
            not resets
            and joined < len(current)
            and next_free + SAFETY * current[joined] * next_W > net.threshold
        ):
            joined += 1
        if joined > known:
            new = slice(known, joined)
            catch_up(
                net,
                step,
                event_step[:events],
                event_jump,
                regions,
                row[new],
                column[new],
                current[new],
                cells[new],
                V[new],
                W[new],
            )
            continue
        step += stride
        V, V_next, W, W_next = V_next, V, W_next, W
        g *= over.decay
        bound_V, bound_W, low, free = next_V, next_W, low * over.decay, next_free
        if resets:
            W[:joined] = net.reset
            bound_W, free = 0.0, net.reset
            event_step[events], event_jump[events] = step, 0
            events += 1
            stride = LEAP
        elif first >= 0:
            winner[found], spike[found] = cells[first], step
            found += 1
            event_step[events] = step
            jump = np.array([row[first], column[first], net.kick * V[first], found - 1.0])
            event_jump[events] = jump
            for i in range(joined):
                if net.threshold < W[i]:
                    W[i] = 0
            inhibit(net, jump, regions, row, column, g)
            events += 1
            low = g[joined:].min() if joined < len(g) else 0.0
            if reset_at <= step:
                reset_at = step + 2
    return winner[:found], spike[:found]


@kernel()
def leap(
    net: Network,
    over: Leap,
    count: int,
    current: FloatArray,
    cells: IntArray,
    V: FloatArray,
    W: FloatArray,
    g: FloatArray,
    V_next: FloatArray,
    W_next: FloatArray,
) -> int:
    """The first cells after a leap; which is over the threshold, -1 for none.

    Of several the one that comes first down the columns of the map.
    """
    first = -1
    for i in range(count):
        V_next[i], W_next[i] = leap_cell(net, over, V[i], W[i], g[i], current[i])
        if net.threshold < W_next[i] and (first < 0 or cells[i] < cells[first]):
            first = i
    return first


@kernel()
def catch_up(
    net: Network,
    step: int,
    event_step: IntArray,
    event_jump: FloatArray,
    regions: npt.NDArray[np.bool_],
    row: IntArray,
    column: IntArray,
    current: FloatArray,
    cells: IntArray,
    V: FloatArray,
    W: FloatArray,
) -> None:
    """Fill V and W of cells at a step, through all that has happened until then."""
    V[:], W[:] = current, net.reset
    g, at = np.zeros_like(current), 0
    for event in range(len(event_step) + 1):
        until = event_step[event] if event < len(event_step) else step
        while at < until:
            over = leap_of(net, min(LEAP, until - at))
            leap(net, over, len(V), current, cells, V, W, g, V, W)
            g *= over.decay
            at += over.steps
        if event < len(event_step):
            if event_jump[event, 2] > 0:
                inhibit(net, event_jump[event], regions, row, column, g)
            else:
                W[:] = net.reset


@kernel()
def inhibit(
    net: Network,
    jump: FloatArray,
    regions: npt.NDArray[np.bool_],
    row: IntArray,
    column: IntArray,
    g: FloatArray,
) -> None:
    """Raise the conductance in a region, or in a disc with a little less in its surround."""
    y, x, height, winner = jump
    if winner < len(regions) and regions[int(winner)].any():
        region = regions[int(winner)]
        for i in range(len(g)):
            if region[row[i], column[i]]:
                g[i] += height
        return
    width = 2 * (4 * net.sigma) ** 2
    down = np.exp(-((np.arange(row.max() + 1) - y) ** 2) / width)
    along = np.exp(-((np.arange(column.max() + 1) - x) ** 2) / width)
    for i in range(len(g)):
        wide = down[row[i]] * along[column[i]]
        narrow = wide**16
        g[i] += height * (narrow - net.surround * wide)


@kernel()
def leap_of(net: Network, steps: int) -> Leap:
    """What every cell needs for a leap of some steps."""
    b = 1 - net.forget
    b_n = b**steps
    sum_of_one = (1 - b_n) / net.forget
    sum_of_j = (steps - b * sum_of_one) / net.forget
    middle = (steps - 1) / 2
    return Leap(
        steps,
        middle,
        (1 - net.decay) ** middle,
        (1 - net.decay) ** steps,
        b,
        b_n,
        sum_of_one,
        sum_of_j,
    )


@kernel()
def leap_cell(
    net: Network, over: Leap, V: float, W: float, g: float, current: float
) -> tuple[float, float]:
    """V and W of one cell after a leap.

    With the conductance of the middle step throughout, `a = 1 - leak - g` and `b = 1 - forget`,
    the potential is `V[j] = P + Q j + (V - P) a^j`, and W sums it, fading with b. P + Q j is
    the equilibrium that V is drawn to; Q is how it rises as a strong inhibition decays.
    """
    g *= over.decay_to_middle
    rate = net.leak + g
    if abs(rate) < POLE:
        rate = POLE
    a = max(0.0, 1 - rate)
    if abs(a - over.b) < POLE:
        a = over.b + POLE
    a_n = a**over.steps
    per_rate = 1 / rate
    level = current * per_rate
    Q = level * net.decay * g * per_rate if g > net.leak else 0.0
    P = level - Q * (over.middle + per_rate)
    sum_of_a = a * (a_n - over.b_n) / (a - over.b)
    V_n = P + Q * over.steps + (V - P) * a_n
    driven = P * over.sum_of_one + Q * over.sum_of_j + (V - P) * sum_of_a
    return V_n, over.b_n * W + net.forget * net.gain * driven
