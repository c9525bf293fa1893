"""Where the gaze goes in turn: winner-take-all over a saliency map, and inhibition of return.

Two layers of leaky integrators look at the map, with one cell of each per cell of the map:

    map layer      V[t+1] = V + dt ((drive S - V) / tau_V - g V)
    winner layer   W[t+1] = W + dt (gain V[t+1] - W) / tau_W

The first W over its threshold is a fixation. It makes the conductance g jump in a disc around
the winner, which silences the map layer there until g has decayed. In the step after the next
the answer of an interneuron resets the whole winner layer, and the race starts again.

`saccade.attention.winner_take_all` runs it, in leaps of many steps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from saccade.attention.winner_take_all import Network, race
from saccade.errors import ImageError, require
from saccade.pyramid import FloatMap, cell_centers
from saccade.types import FloatArray, IntArray, Scanpath

Region = npt.NDArray[np.bool_]
"""(h, w) cells of a saliency map."""


@dataclass(frozen=True)
class ScanpathConfig:
    """The winner-take-all network; potentials in volts.

    Source: Itti, Koch & Niebur (1998), with the constants published with Walther & Koch (2006).
    """

    peak: float = 2.0
    """What the map's maximum is scaled to; 0 takes the map as it is."""
    time_step: float = 1e-4
    """Of the network, in seconds."""
    time_limit: float = 10.0
    """Seconds after which the gaze rests, whether or not all fixations were made."""
    drive: float = 0.01
    """What the map layer rises to, by the saliency."""
    background: float = 1e-5
    """What drives every candidate besides its saliency, in the same unit."""
    map_time_constant: float = 0.5
    """Of the map layer, in seconds."""
    gain: float = 5.0
    """What the winner layer rises to, by the map layer."""
    winner_time_constant: float = 0.1
    """Of the winner layer, in seconds."""
    threshold: float = 1e-3
    """Potential over which a winner cell spikes."""
    reset: float = -0.02
    """Potential from which the winner layer starts again."""
    inhibition_sigma: float = 0.05
    """Width of the disc of inhibition of return, a Gaussian, as part of the map's longer side.

    At 0.05 it has faded to a ninth where the focus of attention of Itti, Koch & Niebur (1998)
    ends, a sixth of the shorter side of an image of 8:5 from its center; SaliencyToolbox 2 has
    0.025."""
    inhibition_strength: float = 2e6
    """Conductance at its center over capacitance, per second and volt of the winner's V."""
    inhibition_surround: float = 1e-4
    """Part of that strength which excites a surround four times as wide."""
    inhibition_time_constant: float = 1.0
    """With which the inhibition of return decays, in seconds."""

    def __post_init__(self) -> None:
        for name in (
            "time_step",
            "time_limit",
            "drive",
            "map_time_constant",
            "gain",
            "winner_time_constant",
            "threshold",
            "inhibition_sigma",
            "inhibition_strength",
            "inhibition_time_constant",
        ):
            value = getattr(self, name)
            require(0 < value < np.inf, name, "a finite value above 0", value)
        fastest = min(
            self.map_time_constant, self.winner_time_constant, self.inhibition_time_constant
        )
        require(
            self.time_step <= fastest / 10,
            "time_step",
            f"at most a tenth of the shortest time constant, {fastest:g} s",
            self.time_step,
        )
        require(0 <= self.peak < np.inf, "peak", "a finite value of at least 0", self.peak)
        require(self.reset <= 0, "reset", "at most 0", self.reset)
        require(
            0 <= self.inhibition_surround < 1,
            "inhibition_surround",
            "a part in [0, 1)",
            self.inhibition_surround,
        )


def scanpath(
    saliency: FloatMap,
    image_shape: Sequence[int],
    fixations: int = 10,
    config: ScanpathConfig | None = None,
    *,
    region: Callable[[int, int], Region | None] | None = None,
) -> Scanpath:
    """The first fixations on a saliency map.

    Of several cells that reach the threshold in one step the first wins, down the columns and
    then from left to right. Cells with no saliency never win: an empty map has no fixations,
    and one with few places may have fewer than asked for.

    Args:
        saliency: (h, w), finite, not negative; its cells tile the image.
        image_shape: (H, W), or more dimensions, of the image.
        fixations: how many at most.
        config: the network.
        region: what inhibition of return covers around a winning cell (row, column), (h, w), or
            None for the disc; `partial(proto_object, maps)` gives the shape of what was seen.

    Returns:
        Fixations at the centers of the winning cells, see `saccade.pyramid.cell_centers`.

    Raises:
        ImageError: the map is not two-dimensional, is empty, not finite, or negative somewhere;
            or the image has no pixels.
        ConfigError: `fixations` is negative.
    """
    config = config or ScanpathConfig()
    saliency = np.asarray(saliency, dtype=np.float64)
    if saliency.ndim != 2 or saliency.size == 0:
        raise ImageError(f"saliency: expected a map of shape (h, w), found {saliency.shape}")
    low, high = float(saliency.min()), float(saliency.max())
    if not (np.isfinite(low) and np.isfinite(high) and low >= 0):
        raise ImageError(
            f"saliency: expected finite values of at least 0, found {low:g} to {high:g}"
        )
    if len(image_shape) < 2 or min(image_shape[:2]) < 1:
        raise ImageError(f"image_shape: expected (H, W), found {tuple(image_shape)}")
    require(fixations >= 0, "fixations", "0 or more", fixations)
    if high == 0:
        return Scanpath(np.zeros((0, 2)), np.zeros(0), np.zeros(0))

    strength = saliency * (config.peak / high) if config.peak > 0 else saliency
    winners, steps = attend(strength, fixations, config, region)
    columns, rows = np.divmod(winners, saliency.shape[0])
    return Scanpath(
        xy=cell_centers(rows, columns, saliency.shape, image_shape),
        time=steps.astype(np.float64) * config.time_step,
        saliency=saliency[rows, columns],
    )


def attend(
    strength: FloatArray,
    fixations: int,
    config: ScanpathConfig,
    region: Callable[[int, int], Region | None] | None = None,
) -> tuple[IntArray, IntArray]:
    """The winners of a map as indices down its columns, and the steps in which they spike.

    A region depends on who wins: with regions the race is run again from the start for each
    further winner, in which the ones before win as they did.
    """
    dt = config.time_step
    network = Network(
        leak=dt / config.map_time_constant,
        forget=dt / config.winner_time_constant,
        decay=dt / config.inhibition_time_constant,
        gain=config.gain,
        threshold=config.threshold,
        reset=config.reset,
        kick=dt * config.inhibition_strength,
        surround=config.inhibition_surround,
        sigma=config.inhibition_sigma * max(strength.shape),
        last_step=int(config.time_limit / dt),
    )
    down_columns = strength.T.ravel()
    cells = np.argsort(-down_columns)[: np.count_nonzero(down_columns)]  # (n,) strongest first
    column, row = np.divmod(cells, strength.shape[0])
    current = network.leak * config.drive * (down_columns[cells] + config.background)
    regions = np.zeros((0, *strength.shape), np.bool_)
    if region is None:
        return race(network, current, row, column, cells, fixations, regions)
    nothing = np.zeros(strength.shape, np.bool_)
    winners, steps = np.zeros(0, np.int64), np.zeros(0, np.int64)
    for number in range(1, fixations + 1):
        winners, steps = race(network, current, row, column, cells, number, regions)
        if len(winners) < number:
            break
        at_column, at_row = divmod(int(winners[-1]), strength.shape[0])
        found = region(at_row, at_column)
        regions = np.concatenate([regions, [nothing if found is None else found]])
    return winners, steps
