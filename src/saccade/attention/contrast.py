"""The contrast-saliency model: contrast between a center and its surround.

After Itti, Koch & Niebur (1998) and Itti & Koch (2001); equations A.1-A.14.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias, get_args

import numpy.typing as npt

from saccade.attention.channels import CONSPICUITY, Channel, ChannelName, Conspicuity
from saccade.attention.contrast_config import DEFAULT, ContrastConfig
from saccade.attention.contrast_steps import KOOTSTRA2010, MIRRORED, Shape, Steps
from saccade.attention.maps import SaliencyMaps
from saccade.attention.saliencytoolbox2 import SALIENCYTOOLBOX2
from saccade.errors import ImageError
from saccade.io.image import check_image
from saccade.scale.pyramid import FloatMap
from saccade.types import Image

__all__ = [
    "ContrastConfig",
    "ContrastMaps",
    "FeatureMap",
    "contrast_saliency",
]

VARIANTS = {
    "mirrored": MIRRORED,
    "kootstra2010": KOOTSTRA2010,
    "saliencytoolbox2": SALIENCYTOOLBOX2,
}
"""Processing steps of each `ContrastConfig.variant`."""


class Scale(NamedTuple):
    """Center and surround levels of the pyramid, with their weight."""

    center: int
    surround: int
    weight: float


Scales: TypeAlias = dict[ChannelName, list[Scale]]


class FeatureMap(NamedTuple):
    """Contrast of one channel at one scale."""

    channel: Channel
    """Name of the channel, with the angle for orientations."""
    center: int
    """Pyramid level of the center."""
    surround: int
    """Pyramid level of the surround."""
    values: FloatMap
    """(h, w) absolute difference of center and surround (A.7-A.10)."""
    normalized: FloatMap
    """(h, w) difference normalized by N."""


@dataclass(frozen=True, eq=False, repr=False)
class ContrastMaps(SaliencyMaps):
    """Saliency, conspicuity maps and feature maps.

    Maps are float32 (float64 for the presets `kootstra2010` and `saliencytoolbox2`). The saliency
    is in [0, 1] if the normalization uses local maxima (A.14).
    """

    intensity: FloatMap
    """(h, w) conspicuity (A.11), from 0 to the number of scales: 6 with `kootstra2010`."""
    color: FloatMap
    """(h, w) conspicuity (A.12), from 0 to 2; 0 for a gray image."""
    orientation: FloatMap
    """(h, w) conspicuity (A.13), from 0 to the number of orientations, 4."""
    features: tuple[FeatureMap, ...] = ()
    """Feature maps; empty without `keep_features`."""
    pyramids: Mapping[Channel, Mapping[int, FloatMap]] = field(default_factory=dict)
    """Pyramid levels (h, w) in use, by channel and level; level 0 has the size of the image
    (A.1-A.6). Empty without `keep_features`."""

    @property
    def layers(self) -> dict[str, FloatMap]:
        """Saliency and the conspicuity maps by name."""
        return {name: getattr(self, name) for name in ("saliency", *get_args(Conspicuity))}


def contrast_saliency(
    image: Image,
    config: ContrastConfig | None = None,
    *,
    keep_features: bool = False,
    bgr: bool = False,
) -> ContrastMaps:
    """Contrast saliency from intensity, color and orientation.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        config: channels, scales and normalization; the presets cite their sources.
        keep_features: whether the result includes the feature maps and the pyramids.
        bgr: True for an image in OpenCV's channel order, as `cv2.imread` returns it.

    Returns:
        Saliency and the three conspicuity maps, each (h, w) with h = H / 2**map_level rounded up
        (down for the preset `saliencytoolbox2`), where `map_level` is taken from
        `config.at_size((H, W))`.

    Raises:
        ImageError: the input is not an image, not finite, or too small for the finest surround.

    Source: Itti, Koch & Niebur (1998); equations A.1-A.14.
    """
    return contrast_maps(check_image(image, bgr=bgr), config, keep_features=keep_features)


def contrast_maps(
    pixels: npt.NDArray[Any],
    config: ContrastConfig | None = None,
    steps: Steps | None = None,
    *,
    shape: Shape | None = None,
    keep_features: bool = False,
) -> ContrastMaps:
    """Contrast saliency of a validated image; see `contrast_saliency`.

    `steps` defaults to the steps of the configured variant. Steps for another array library
    take `pixels` and return maps (..., h, w) in their own layout, for images of `shape` (H, W).
    """
    shape = shape or pixels.shape[:2]
    config = (config or DEFAULT).at_size(shape)
    steps = steps or VARIANTS[config.variant]
    scales = existing_scales(shape, config, steps)
    map_shape = steps.level_shape(shape, config.map_level)  # (h, w)
    pyramids = channel_pyramids(pixels, scales, config, steps)  # A.1-A.6

    features, sums = [], dict[Channel, FloatMap]()
    for channel, levels in pyramids.items():
        for center, surround, weight in scales[channel.name]:
            values = steps.difference(levels[center], levels[surround], map_shape, config)
            values = steps.smooth(values, config.smoothing)  # A.7-A.10
            normalized = steps.normalize(values, config)
            at_map = weight * steps.resize(normalized, map_shape)
            sums[channel] = sums[channel] + at_map if channel in sums else at_map
            features.append(FeatureMap(channel, center, surround, values, normalized))

    def channel_sums(name: Conspicuity) -> list[FloatMap]:
        """Sums over scales of each channel of a conspicuity map; zeros if it has no channel."""
        found = [each for channel, each in sums.items() if CONSPICUITY[channel.name] == name]
        return found or [0 * next(iter(sums.values()))]

    intensity = steps.conspicuity(channel_sums("intensity"), config)  # A.11
    opponents = [steps.normalize_sum(each, config) for each in channel_sums("color")]
    color = steps.conspicuity(opponents, config)  # A.12
    oriented = [steps.normalize_sum(each, config) for each in channel_sums("orientation")]
    orientation = steps.conspicuity(oriented, config)  # A.13
    saliency = steps.saliency(intensity, color, orientation, config)  # A.14
    return ContrastMaps(
        saliency=steps.sharpen(saliency, config.sharpening),
        intensity=intensity,
        color=color,
        orientation=orientation,
        image_shape=shape,
        features=tuple(features) if keep_features else (),
        pyramids=pyramids if keep_features else {},
    )


def existing_scales(shape: tuple[int, int], config: ContrastConfig, steps: Steps) -> Scales:
    """Available scales for an image of this shape, for channels of nonzero weight."""
    pairs = zip(config.scales, config.scale_weights, strict=True)
    color_scales = [Scale(center, surround, weight) for (center, surround), weight in pairs]
    orientation_scales = [Scale(*levels, 1.0) for levels in config.orientation_scales]
    weights = dict(zip(get_args(Conspicuity), config.weights, strict=True))
    scales: Scales = {
        name: orientation_scales if name == "orientation" else color_scales
        for name, conspicuity in CONSPICUITY.items()
        if weights[conspicuity] > 0
    }
    deepest = steps.deepest_level(shape)
    finest = min(scale.surround for channel in scales.values() for scale in channel)
    if deepest < finest or max(steps.level_shape(shape, config.map_level)) == 1:
        raise ImageError(
            f"image: expected more pixels for surround level {finest} and map level "
            f"{config.map_level}, found {shape[1]} x {shape[0]} px; enlarge it, or set finer scales"
        )
    return {
        name: existing
        for name, channel in scales.items()
        if (existing := [scale for scale in channel if scale.surround <= deepest])
    }


def channel_pyramids(
    pixels: npt.NDArray[Any], scales: Scales, config: ContrastConfig, steps: Steps
) -> dict[Channel, dict[int, FloatMap]]:
    """The pyramid levels needed by the scales, by channel and level (A.1-A.6)."""
    compared = {
        name: sorted({level for scale in channel for level in scale[:2]})
        for name, channel in scales.items()
    }
    finest, coarsest = min(map(min, compared.values())), max(map(max, compared.values()))
    first, planes = steps.split_channels(pixels, config, finest)  # A.1-A.3
    pyramids = dict[Channel, dict[int, FloatMap]]()
    for name, plane in planes.items():
        if name in scales or (name == "intensity" and "orientation" in scales):
            levels = {first: plane}
            for number in range(first, coarsest):
                levels[number + 1] = steps.halve(levels[number])  # A.4-A.5
            pyramids[Channel(name)] = levels
    if "orientation" in scales:
        intensity = pyramids[Channel("intensity")]
        responses = {n: steps.orientations(intensity[n], config) for n in compared["orientation"]}
        for i, angle in enumerate(config.orientations):
            oriented = {n: each[i] for n, each in responses.items()}  # A.6
            pyramids[Channel("orientation", angle)] = oriented
    return {
        channel: {number: levels[number] for number in compared[channel.name]}
        for channel, levels in pyramids.items()
        if channel.name in scales
    }
