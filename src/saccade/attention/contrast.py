"""The contrast-saliency model: what differs from its surround draws the eye.

After Itti, Koch & Niebur (1998) and Itti & Koch (2001); equations A.1-A.14.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from itertools import count
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.kootstra2010 import PrintedSteps
from saccade.attention.mirrored import MirroredSteps
from saccade.attention.normalize import sharpen, smooth
from saccade.attention.saliencytoolbox2 import SaliencyToolbox2Steps
from saccade.errors import ImageError
from saccade.image import check_image
from saccade.pyramid import (
    FloatMap,
)
from saccade.types import Image

__all__ = ["ContrastConfig", "ContrastMaps", "FeatureMap", "contrast_saliency"]


class FeatureMap(NamedTuple):
    """One of the maps that the conspicuity maps are made of."""

    channel: str
    """"intensity", "red-green", "blue-yellow", or "orientation" and its angle in degrees."""
    center: int
    """Pyramid level of the center."""
    surround: int
    """Pyramid level of the surround."""
    values: FloatMap
    """(h, w) absolute difference of center and surround (A.7-A.10)."""
    normalized: FloatMap
    """(h, w) the same after N."""


@dataclass(frozen=True, eq=False, repr=False)
class ContrastMaps:
    """Saliency and what it is made of.

    Maps are float32 (float64 for the preset `saliencytoolbox2`), and their cells tile the
    image: see `saccade.pyramid.cell_centers`.
    """

    saliency: FloatMap
    """(h, w), not negative; in [0, 1] for the normalizations by local maxima (A.14)."""
    intensity: FloatMap
    """(h, w) conspicuity (A.11), from 0 to the number of scales: 6 with `kootstra2010`."""
    color: FloatMap
    """(h, w) conspicuity (A.12), from 0 to 2; 0 for a grey image."""
    orientation: FloatMap
    """(h, w) conspicuity (A.13), from 0 to the number of orientations, 4."""
    image_shape: tuple[int, int]
    """(H, W) of the image."""
    features: tuple[FeatureMap, ...] = ()
    """The feature maps, where they were asked for."""

    def __repr__(self) -> str:
        height, width = self.saliency.shape
        rows, columns = self.image_shape
        return f"ContrastMaps({width} x {height} cells of a {columns} x {rows} image)"


def contrast_saliency(
    image: Image, config: ContrastConfig | None = None, *, keep_features: bool = False
) -> ContrastMaps:
    """Where contrast in intensity, color and orientation draws the eye.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        config: channels, scales and normalization; presets name their source.
        keep_features: whether the result holds the feature maps.

    Returns:
        Saliency and the three conspicuity maps, each (h, w), h = H / 2**map_level rounded up
        (down for the preset `saliencytoolbox2`), with the level of `config.at_size((H, W))`.

    Raises:
        ImageError: not an image, not finite, or too small for the finest surround.

    Source: Itti, Koch & Niebur (1998); equations A.1-A.14.
    """
    pixels = check_image(image)  # (H, W), (H, W, 3) or (H, W, 4)
    config = (config or ContrastConfig()).at_size(pixels.shape[:2])
    steps = steps_of(config)
    scales = existing_scales(pixels.shape[:2], config, steps)
    nothing = np.zeros(steps.level_shape(pixels.shape[:2], config.map_level), steps.dtype)  # (h, w)

    pyramids = channel_pyramids(pixels, scales, config, steps)  # A.1-A.6
    across_scales = dict.fromkeys(("intensity", "red-green", "blue-yellow", *pyramids), nothing)
    features = []
    for channel, levels in pyramids.items():
        for center, surround, weight in scales[channel.partition(" ")[0]]:
            values = steps.contrast(levels[center], levels[surround], nothing.shape)  # A.7-A.10
            values = smooth(values, config.smoothing)
            normalized = steps.normalize(values)
            at_map = steps.resize(normalized, nothing.shape)
            across_scales[channel] = across_scales[channel] + weight * at_map
            if keep_features:
                features.append(FeatureMap(channel, center, surround, values, normalized))

    N = steps.normalize_sum
    oriented = [N(m) for name, m in across_scales.items() if name.startswith("orientation")]
    intensity = steps.conspicuity([across_scales["intensity"]])  # A.11
    color = steps.conspicuity(
        [N(across_scales["red-green"]), N(across_scales["blue-yellow"])]
    )  # A.12
    orientation = steps.conspicuity(oriented or [nothing])  # A.13
    saliency = steps.saliency(intensity, color, orientation)  # A.14
    return ContrastMaps(
        saliency=weigh_center(sharpen(saliency, config.sharpening), config.center_prior),
        intensity=intensity,
        color=color,
        orientation=orientation,
        image_shape=pixels.shape[:2],
        features=tuple(features),
    )


def existing_scales(
    shape: tuple[int, int], config: ContrastConfig, steps: Steps
) -> dict[str, list[tuple[int, int, float]]]:
    """Center, surround and weight of the pairs that an image of this shape has, by channel."""
    deepest = steps.deepest_level(shape)
    wanted: dict[str, list[tuple[int, int, float]]] = {}
    colors = [
        (center, surround, weight)
        for (center, surround), weight in zip(config.scales, config.scale_weights, strict=True)
    ]
    if config.intensity_weight > 0:
        wanted["intensity"] = colors
    if config.color_weight > 0:
        wanted["red-green"] = wanted["blue-yellow"] = colors
    if config.orientation_weight > 0:
        wanted["orientation"] = [(*pair, 1.0) for pair in config.orientation_scales]
    existing = {
        channel: [scale for scale in pairs if scale[1] <= deepest]
        for channel, pairs in wanted.items()
    }
    finest = min(surround for pairs in wanted.values() for _, surround, _ in pairs)
    cells = max(steps.level_shape(shape, config.map_level))
    if deepest < finest or cells == 1:
        shorter = next(n for n in count(1) if steps.deepest_level((n, n)) >= finest)
        longer = next(n for n in count(1) if steps.level_shape((n, n), config.map_level)[0] > 1)
        raise ImageError(
            f"image: expected at least {shorter} px on the shorter side for surround level "
            f"{finest}, and {longer} px on the longer for a map at level {config.map_level}, "
            f"found {shape[1]} x {shape[0]} px; enlarge it, or set finer scales"
        )
    return existing


def channel_pyramids(
    pixels: npt.NDArray[Any],
    scales: dict[str, list[tuple[int, int, float]]],
    config: ContrastConfig,
    steps: Steps,
) -> dict[str, dict[int, FloatMap]]:
    """The levels that the scales need, by channel and level number (A.1-A.6)."""
    needed = {
        channel: sorted({level for scale in pairs for level in scale[:2]})
        for channel, pairs in scales.items()
        if pairs
    }
    finest = min(levels[0] for levels in needed.values())
    finest, brightness, opponents = steps.channels(pixels, finest)  # A.1-A.3
    levels_of_intensity = {*needed.get("intensity", ()), *needed.get("orientation", ())}

    def pyramid(level: FloatMap, wanted: Collection[int]) -> dict[int, FloatMap]:
        levels = {}
        for number in range(finest, max(wanted) + 1):
            if number > finest:
                level = steps.halve(level)
            if number in wanted:
                levels[number] = level
        return levels

    pyramids = {}
    if levels_of_intensity:
        intensities = pyramid(brightness, levels_of_intensity)  # A.4-A.5
    if "intensity" in needed:
        pyramids["intensity"] = intensities
    for channel, opponent in opponents.items():
        if channel in needed:
            pyramids[channel] = pyramid(opponent, needed[channel])  # A.4-A.5
    if "orientation" in needed:
        energies = {level: steps.oriented(intensities[level]) for level in needed["orientation"]}
        for i, angle in enumerate(config.orientations):
            pyramids[f"orientation {angle:g}"] = {
                level: energy[i] for level, energy in energies.items()
            }  # A.6
    return pyramids


def steps_of(config: ContrastConfig) -> Steps:
    """The arithmetic that the configuration names."""
    if config.arithmetic == "saliencytoolbox2":
        return SaliencyToolbox2Steps(config)
    if config.arithmetic == "kootstra2010":
        return PrintedSteps(config)
    return MirroredSteps(config)


Steps: TypeAlias = MirroredSteps | PrintedSteps | SaliencyToolbox2Steps


def weigh_center(saliency: FloatMap, sigma: float) -> FloatMap:
    """The map times a Gaussian in its middle, whose width is a part of its sides; 0 for none."""
    if sigma == 0:
        return saliency
    y, x = (np.exp(-((((np.arange(n) + 0.5) / n - 0.5) / sigma) ** 2) / 2) for n in saliency.shape)
    weighted: FloatMap = saliency * np.outer(y, x).astype(saliency.dtype)
    return weighted
