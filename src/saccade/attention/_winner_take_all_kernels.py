"""The winner-take-all network of `saccade.attention.scanpath`, many time steps at once.

While the conductance is held constant the recurrence has a closed form, so that one stride covers
up to `MAX_STRIDE` steps.
"""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.types import FloatArray

MAX_STRIDE = 100
"""Steps in a stride; the inhibition decays by 1 % meanwhile."""
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
    last_step: int


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
def run_until_spike(
    net: Network,
    current: FloatArray,
    V: FloatArray,
    W: FloatArray,
    g: FloatArray,
    step: int,
    reset_at: int,
) -> tuple[int, int]:
    """Advance V, W and the conductance g of all cells (n,) until a winner cell spikes.

    `current` (n,) is the input to the map layer per time step. The winner layer is reset at the
    step `reset_at`, if that is still to come.

    Returns the first cell over the threshold, -1 for none within the time limit, and the step.
    """
    V_next, W_next = np.empty_like(V), np.empty_like(W)
    steps = MAX_STRIDE
    while step < net.last_step:
        steps = 1 if step < reset_at else min(steps, net.last_step - step)
        resets = step + steps == reset_at
        stride = stride_of(net, steps)
        first = -1
        for i in range(len(V)):
            V_next[i], W_next[i] = advance_cell(net, stride, V[i], W[i], g[i], current[i])
            if net.threshold < W_next[i] and first < 0:
                first = i
                if steps > 1:
                    break
        if first >= 0 and steps > 1:
            steps = max(1, steps // 4)
            continue
        step += steps
        for i in range(len(V)):
            V[i], W[i] = V_next[i], net.reset if resets else W_next[i]
            g[i] *= stride.decay
        if resets:
            steps = MAX_STRIDE
        elif first >= 0:
            return first, step
    return -1, step


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
