"""Scanpaths: winner-take-all over a saliency map, with inhibition of return.

Two layers of leaky integrators have one cell each per cell of the map:

    map layer      V[t+1] = V + dt ((drive S - V) / tau_V - g V)
    winner layer   W[t+1] = W + dt (gain V[t+1] - W) / tau_W

The first W to exceed the threshold becomes a fixation. It raises the conductance g in a disc around
the winner, which suppresses the map layer there until g has decayed. Two steps later an interneuron
resets the whole winner layer, and the competition starts again.

Instead of a disc, the region of the attended proto-object may be inhibited: Walther & Koch (2006),
*Modeling attention to salient proto-objects*.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self, get_args

import cv2
import numpy as np

from saccade.attention.channels import CONSPICUITY, Conspicuity
from saccade.attention.contrast import ContrastMaps
from saccade.attention.maps import SaliencyMaps
from saccade.attention.winner_take_all import Network, run_network
from saccade.errors import ImageError, Settings, require, setting
from saccade.scale.pyramid import FloatMap, cell_centers, resize
from saccade.types import BoolArray, FloatArray, Scanpath

_logger = logging.getLogger(__name__)

REGION_HEIGHT = 0.05
"""Minimum height of a proto-object's cells, as a fraction of the winner's height."""
REGION_AREA = 0.1
"""Maximum area of a proto-object, as a fraction of the map; larger regions are background."""
REGION_MARGIN = 2
"""Radius of the dilation of a proto-object, in cells."""


@dataclass(frozen=True)
class ScanpathConfig(Settings):
    """Settings of the winner-take-all network; potentials are in volts.

    The default disc was chosen by the similarity of scanpaths to human scanpaths, see
    docs/scanpaths.md; the presets follow their sources.

    Source: Itti, Koch & Niebur (1998), with the constants published with Walther & Koch (2006).
    """

    peak: float | None = setting(2.0, above=0)
    """Maximum of the map after scaling; None disables scaling."""
    time_step: float = setting(1e-4, above=0)
    """Time step of the network, in seconds."""
    time_limit: float = setting(10.0, above=0)
    """Maximum duration of the scanpath, in seconds."""
    drive: float = setting(0.01, above=0)
    """Equilibrium potential of the map layer per unit of saliency."""
    background: float = setting(1e-5)
    """Saliency added to every cell with nonzero saliency."""
    map_time_constant: float = setting(0.5, above=0)
    """Time constant of the map layer, in seconds."""
    gain: float = setting(5.0, above=0)
    """Equilibrium potential of the winner layer per potential of the map layer."""
    winner_time_constant: float = setting(0.1, above=0)
    """Time constant of the winner layer, in seconds."""
    threshold: float = setting(1e-3, above=0)
    """Firing threshold of a winner cell."""
    reset: float = setting(-0.02, maximum=0)
    """Potential of the winner layer after a reset."""
    inhibition_sigma: float = setting(0.015, above=0)
    """Standard deviation of the Gaussian disc of inhibition of return, as a fraction of the longer
    side of the map."""
    inhibition_strength: float = setting(2e6, above=0)
    """Conductance over capacitance at the center of the disc, per second and volt of V."""
    inhibition_surround: float = setting(1e-4, 0, below=1)
    """Strength of the excitatory surround, four times as wide as the disc, as a fraction of the
    strength of inhibition."""
    inhibition_time_constant: float = setting(1.0, above=0)
    """Time constant of the inhibition of return, in seconds."""

    def __post_init__(self) -> None:
        super().__post_init__()
        times = self.map_time_constant, self.winner_time_constant, self.inhibition_time_constant
        expected = f"at most a tenth of the shortest time constant, {min(times):g} s"
        require(self.time_step <= min(times) / 10, "time_step", expected, self.time_step)

    @classmethod
    def itti1998(cls) -> Self:
        """Inhibition of return as in Itti, Koch & Niebur (1998).

        The radius of the disc is a sixth of the shorter side; in an 8:5 image the Gaussian falls to
        a ninth at its edge.
        """
        return cls(inhibition_sigma=0.05)

    @classmethod
    def saliencytoolbox2(cls) -> Self:
        """SaliencyToolbox 2 (Walther & Koch 2006): a narrower disc and an unscaled map.

        For the maps of `ContrastConfig.saliencytoolbox2`, which have the toolbox's range.
        """
        return cls(peak=None, inhibition_sigma=0.025)


def scanpath(
    maps: SaliencyMaps,
    config: ScanpathConfig | None = None,
    *,
    fixations: int = 10,
    region: Callable[[int, int], BoolArray | None] | None = None,
) -> Scanpath:
    """The first fixations on a saliency map.

    If several cells reach the threshold in one step, the first in column-major order wins. Cells
    without saliency never win, so that an empty map has no fixations and a sparse map may have
    fewer than `fixations`.

    Args:
        maps: result of a model, or `SaliencyMaps(saliency, image.shape)` for any other map.
        config: settings of the network.
        fixations: maximum number of fixations.
        region: function that returns the (h, w) mask of cells to inhibit after cell (row, column)
            has won, or None for the disc; `partial(proto_object, maps)` inhibits the attended
            object.

    Returns:
        Fixations at the centers of the winning cells, see `saccade.scale.pyramid.cell_centers`.

    Raises:
        ImageError: the map is not two-dimensional, is empty, not finite or negative; or the image
            has no pixels, or height and width appear swapped.
        ConfigError: `fixations` is negative.
    """
    config = config or ScanpathConfig()
    saliency = checked_map(maps.saliency, maps.image_shape)
    require(fixations >= 0, "fixations", "0 or more", fixations)
    high = float(saliency.max())
    if high == 0:
        return Scanpath(np.zeros((0, 2)), np.zeros(0), np.zeros(0))

    strength = saliency if config.peak is None else saliency * (config.peak / high)
    network = network_of(config, saliency.shape)
    driven = np.where(strength > 0, strength + config.background, 0)
    current = network.map_rate * config.drive * driven
    rows, columns, steps = run_network(network, current, fixations, region)
    if len(rows) < fixations:
        _logger.warning(
            "scanpath: %d of %d fixations within the time limit of %g s; raise time_limit for more",
            *(len(rows), fixations, config.time_limit),
        )
    return Scanpath(
        xy=cell_centers(rows, columns, saliency.shape, maps.image_shape),
        time=steps.astype(np.float64) * config.time_step,
        saliency=saliency[rows, columns],
    )


def checked_map(saliency: FloatMap, image_shape: tuple[int, int]) -> FloatArray:
    """Validates a saliency map and converts it to double precision.

    Raises:
        ImageError: as `scanpath`.
    """
    saliency = np.asarray(saliency, dtype=np.float64)
    if saliency.ndim != 2 or saliency.size == 0:
        raise ImageError(f"saliency: expected a map of shape (h, w), found {saliency.shape}")
    low, high = float(saliency.min()), float(saliency.max())
    if not (np.isfinite(low) and np.isfinite(high) and low >= 0):
        raise ImageError(
            f"saliency: expected finite values of at least 0, found {low:g} to {high:g}"
        )
    if len(image_shape) < 2 or min(image_shape) < 1:
        raise ImageError(f"image_shape: expected (H, W), found {image_shape}")
    (h, w), (height, width) = saliency.shape, image_shape
    if _covers(h, w, width, height) and not _covers(h, w, height, width):
        raise ImageError(
            f"image_shape: expected (H, W) = ({width}, {height}) for a map of ({h}, {w}), "
            f"found ({height}, {width}): height and width are swapped"
        )
    return saliency


def _covers(h: int, w: int, height: int, width: int) -> bool:
    """Whether the map's shape is the image's shape divided by a factor, rounded up or down."""
    return (w - 1) * height < (h + 1) * width and (h - 1) * width < (w + 1) * height


def network_of(config: ScanpathConfig, shape: tuple[int, ...]) -> Network:
    """Constants of the network per time step, for a map of a given shape."""
    dt = config.time_step
    return Network(
        map_rate=dt / config.map_time_constant,
        winner_rate=dt / config.winner_time_constant,
        decay_rate=dt / config.inhibition_time_constant,
        gain=config.gain,
        threshold=config.threshold,
        reset=config.reset,
        inhibition=dt * config.inhibition_strength,
        surround=config.inhibition_surround,
        sigma=config.inhibition_sigma * max(shape),
        last_step=int(config.time_limit / dt),
    )


def proto_object(maps: ContrastMaps, row: int, column: int) -> BoolArray | None:
    """Region of the proto-object at a cell (Walther & Koch 2006).

    The region is taken from the strongest feature map at the cell, within the strongest conspicuity
    map: the connected component of at least 5 % of the height at the cell, dilated by a disc.

    Args:
        maps: contrast maps with features, from `contrast_saliency(..., keep_features=True)`.
        row: row of the cell in the saliency map.
        column: column of the cell.

    Returns:
        (h, w) mask; None if the region is empty or larger than a tenth of the map.

    Raises:
        ImageError: the maps hold no features, or the cell lies outside.
    """
    shape = maps.saliency.shape
    if not maps.features:
        raise ImageError("maps: expected features; compute them with keep_features=True")
    if not (0 <= row < shape[0] and 0 <= column < shape[1]):
        raise ImageError(f"cell: expected one of {shape[0]} x {shape[1]}, found {row}, {column}")
    winner = max(get_args(Conspicuity), key=lambda name: float(getattr(maps, name)[row, column]))
    features = [
        resize(feature.normalized, shape)
        for feature in maps.features
        if CONSPICUITY[feature.channel.name] == winner
    ]
    strongest = max(features, key=lambda values: float(values[row, column]))
    return region_around(strongest, row, column)


def region_around(values: FloatMap, row: int, column: int) -> BoolArray | None:
    """Dilated connected component around a cell, above a fraction of its height.

    The fraction starts at 5 % and doubles while the region covers a tenth of the map or more;
    returns None if the region stays too large.
    """
    height = float(values[row, column])
    fraction = REGION_HEIGHT
    while height > 0 and fraction <= 1:
        above = (values >= fraction * height).astype(np.uint8)
        _, label = cv2.connectedComponents(above, connectivity=4)
        region = label == label[row, column]
        if region.sum() < REGION_AREA * region.size:
            y, x = np.ogrid[-REGION_MARGIN : REGION_MARGIN + 1, -REGION_MARGIN : REGION_MARGIN + 1]
            disc = (x**2 + y**2 <= REGION_MARGIN**2).astype(np.uint8)
            return np.asarray(cv2.dilate(region.astype(np.uint8), disc) > 0)
        fraction *= 2
    return None
