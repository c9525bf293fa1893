"""The winner-take-all network of `saccade.attention.scanpath`, many time steps at once.

While the conductance is held constant the recurrence has a closed form, so that one stride covers
up to `MAX_STRIDE` steps.
"""

from math import exp
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray

MAX_STRIDE = 100
"""Steps in a stride; the inhibition decays by 1 % meanwhile."""
BOUND_MARGIN = 1.01
"""Factor on the bound on inactive cells: strides are accurate to 0.2 %."""
POLE_DISTANCE = 1e-9
"""Least distance from the poles of the closed form; rates nearer to one are moved here."""


class Network(NamedTuple):
    """Constants of the network per time step."""

    map_rate: float
    """Time step over the time constant of the map layer."""
    winner_rate: float
    """Time step over the time constant of the winner layer."""
    decay_rate: float
    """Time step over the time constant of the inhibition of return."""
    gain: float
    threshold: float
    reset: float
    inhibition: float
    """Increase of the conductance at the winner, per potential of the winner."""
    surround: float
    """Fraction of it that excites the surround."""
    sigma: float
    """Standard deviation of the inhibited disc, in cells."""
    last_step: int


class Cells(NamedTuple):
    """Cells of the map, from the strongest input to the weakest; each array is (n,)."""

    row: IntArray
    column: IntArray
    number: IntArray
    """Counted down the columns of the map: of several over the threshold the lowest wins."""
    current: FloatArray
    """Input to the map layer per time step."""


class Events(NamedTuple):
    """Inhibitions and resets in the order of time; each array has room for all."""

    step: IntArray
    row: IntArray
    column: IntArray
    jump: FloatArray
    """Increase of the conductance at the winner; 0 for a reset of the winner layer."""
    fixation: IntArray
    """Number of the fixation that is inhibited."""


class Stride(NamedTuple):
    """Coefficients of a stride that all cells share, with b = 1 - winner_rate."""

    steps: int
    midpoint: float
    decay_to_midpoint: float
    """Decay of the conductance until the middle of the stride."""
    decay: float
    """Decay of the conductance until the end of the stride."""
    b: float
    b_n: float
    """b to the power of the number of steps."""
    sum_of_one: float
    """The sum of b^(n - 1 - j) over the steps j."""
    sum_of_j: float
    """The sum of j b^(n - 1 - j) over the steps j."""


@kernel()
def run_network(
    net: Network, cells: Cells, fixations: int, regions: npt.NDArray[np.bool_]
) -> tuple[IntArray, IntArray]:
    """Numbers of the winning cells, and the steps in which they spike.

    `regions` (r, h, w) are inhibited at the first r winners; a disc is where a region is empty,
    and at later winners.

    Only the strongest cells are simulated. A weaker one becomes active when it might win: until
    then it is below `free_W + current * bound_W`, where `free_W` is what remains of the reset, and
    the bound is a cell of unit current with the lowest conductance of the inactive cells.
    """
    current = cells.current
    V, W, g = np.empty_like(current), np.empty_like(current), np.zeros_like(current)
    V_next, W_next = np.empty_like(current), np.empty_like(current)
    bound_V, bound_W, lowest_g, free_W = 1.0, 0.0, 0.0, net.reset
    winner, spike = np.empty(fixations, np.int64), np.empty(fixations, np.int64)
    size = 2 * fixations
    events = Events(
        np.zeros(size, np.int64),
        np.zeros(size, np.int64),
        np.zeros(size, np.int64),
        np.zeros(size),
        np.zeros(size, np.int64),
    )
    count, reset_at, steps = 0, 0, MAX_STRIDE
    step: int = np.int64(0)  # type: ignore[assignment]  # a literal has another type
    num_events: int = step
    active: int = step
    while count < fixations and step < net.last_step:
        steps = 1 if step < reset_at else min(steps, net.last_step - step)
        resets = step + steps == reset_at
        stride = stride_of(net, steps)
        first = _advance(net, stride, active, cells, V, W, g, V_next, W_next)
        if first >= 0 and steps > 1:
            steps = max(1, steps // 4)
            continue
        next_V, next_W = advance_cell(net, stride, bound_V, bound_W, lowest_g, 1.0)
        next_free = free_W * stride.b_n
        known = active
        while (
            not resets
            and active < len(current)
            and next_free + BOUND_MARGIN * current[active] * next_W > net.threshold
        ):
            active += 1
        if active > known:
            new = slice(known, active)
            activated = Cells(cells.row[new], cells.column[new], cells.number[new], current[new])
            _replay(net, step, events, num_events, regions, activated, V[new], W[new])
            continue
        step += steps
        V, V_next, W, W_next = V_next, V, W_next, W
        for i in range(len(g)):
            g[i] *= stride.decay
        bound_V, bound_W, free_W = next_V, next_W, next_free
        lowest_g *= stride.decay
        if resets:
            for i in range(active):
                W[i] = net.reset
            bound_W, free_W = 0.0, net.reset
            events.step[num_events], events.jump[num_events] = step, 0
            num_events += 1
            steps = MAX_STRIDE
        elif first >= 0:
            winner[count], spike[count] = cells.number[first], step
            events.step[num_events], events.fixation[num_events] = step, count
            events.row[num_events] = cells.row[first]
            events.column[num_events] = cells.column[first]
            events.jump[num_events] = net.inhibition * V[first]
            count += 1
            for i in range(active):
                if net.threshold < W[i]:
                    W[i] = 0
            inhibit(net, events, num_events, regions, cells, g)
            num_events += 1
            lowest_g = g[active] if active < len(g) else 0.0
            for i in range(active, len(g)):
                lowest_g = min(lowest_g, g[i])
            if reset_at <= step:
                reset_at = step + 2
    return winner[:count], spike[:count]


@kernel()
def _advance(
    net: Network,
    stride: Stride,
    count: int,
    cells: Cells,
    V: FloatArray,
    W: FloatArray,
    g: FloatArray,
    V_next: FloatArray,
    W_next: FloatArray,
) -> int:
    """Fill V and W of the first `count` cells after a stride.

    Returns the index of the one over the threshold, of several the lowest by `Cells.number`; -1
    for none.
    """
    first = -1
    for i in range(count):
        V_next[i], W_next[i] = advance_cell(net, stride, V[i], W[i], g[i], cells.current[i])
        if net.threshold < W_next[i] and (first < 0 or cells.number[i] < cells.number[first]):
            first = i
    return first


@kernel(inline=True)
def _replay(
    net: Network,
    step: int,
    events: Events,
    num_events: int,
    regions: npt.NDArray[np.bool_],
    cells: Cells,
    V: FloatArray,
    W: FloatArray,
) -> None:
    """Fill V and W of newly active cells at a step, from the onset through all events."""
    g, at = np.zeros(len(V)), 0
    for i in range(len(V)):
        V[i], W[i] = cells.current[i], net.reset
    for event in range(num_events + 1):
        until = events.step[event] if event < num_events else step
        while at < until:
            stride = stride_of(net, min(MAX_STRIDE, until - at))
            _advance(net, stride, len(V), cells, V, W, g, V, W)
            for i in range(len(g)):
                g[i] *= stride.decay
            at += stride.steps
        if event < num_events:
            if events.jump[event] > 0:
                inhibit(net, events, event, regions, cells, g)
            else:
                for i in range(len(W)):
                    W[i] = net.reset


@kernel()
def inhibit(
    net: Network,
    events: Events,
    event: int,
    regions: npt.NDArray[np.bool_],
    cells: Cells,
    g: FloatArray,
) -> None:
    """Raise the conductance in a region, or in a disc less a little in its surround."""
    jump, fixation = events.jump[event], events.fixation[event]
    if fixation < len(regions) and regions[fixation].any():
        region = regions[fixation]
        for i in range(len(g)):
            if region[cells.row[i], cells.column[i]]:
                g[i] += jump
        return
    vertical = _gaussian(cells.row, events.row[event], 4 * net.sigma)
    horizontal = _gaussian(cells.column, events.column[event], 4 * net.sigma)
    for i in range(len(g)):
        wide = vertical[cells.row[i]] * horizontal[cells.column[i]]
        narrow = wide**16
        g[i] += jump * (narrow - net.surround * wide)


@kernel()
def _gaussian(number: IntArray, center: int, sigma: float) -> FloatArray:
    """Gaussian about the row or column `center`, at all up to the last in `number` (n,)."""
    last, width = 0, 2 * sigma * sigma
    for i in range(len(number)):
        last = max(last, number[i])
    values = np.empty(last + 1)
    for k in range(last + 1):
        values[k] = exp(-((k - center) * (k - center)) / width)
    return values


@kernel(inline=True)
def stride_of(net: Network, steps: int) -> Stride:
    """Coefficients of a stride of some steps."""
    b = 1 - net.winner_rate
    b_n = b**steps
    sum_of_one = (1 - b_n) / net.winner_rate
    sum_of_j = (steps - b * sum_of_one) / net.winner_rate
    midpoint = (steps - 1) / 2
    decay_to_midpoint = (1 - net.decay_rate) ** midpoint
    decay = (1 - net.decay_rate) ** steps
    return Stride(steps, midpoint, decay_to_midpoint, decay, b, b_n, sum_of_one, sum_of_j)


@kernel()
def advance_cell(
    net: Network, stride: Stride, V: float, W: float, g: float, current: float
) -> tuple[float, float]:
    """V and W of one cell after a stride.

    With the conductance of the middle step throughout, `a = 1 - map_rate - g` and
    `b = 1 - winner_rate`, the potential is `V[j] = P + Q j + (V - P) a^j`, and W is its sum
    weighted by powers of b. P + Q j is the equilibrium of V; Q is its slope while a strong
    inhibition decays.
    """
    g *= stride.decay_to_midpoint
    rate = net.map_rate + g
    if abs(rate) < POLE_DISTANCE:
        rate = POLE_DISTANCE
    a = max(0.0, 1 - rate)
    if abs(a - stride.b) < POLE_DISTANCE:
        a = stride.b + POLE_DISTANCE
    a_n = a**stride.steps
    per_rate = 1 / rate
    equilibrium = current * per_rate
    Q = equilibrium * net.decay_rate * g * per_rate if g > net.map_rate else 0.0
    P = equilibrium - Q * (stride.midpoint + per_rate)
    sum_of_a = a * (a_n - stride.b_n) / (a - stride.b)
    V_n = P + Q * stride.steps + (V - P) * a_n
    driven = P * stride.sum_of_one + Q * stride.sum_of_j + (V - P) * sum_of_a
    return V_n, stride.b_n * W + net.winner_rate * net.gain * driven
