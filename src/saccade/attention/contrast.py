"""The contrast-saliency model: saliency is the contrast between a center and its surround.

After Itti, Koch & Niebur (1998) and Itti & Koch (2001); equations A.1-A.14.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from saccade.attention.channels import CONSPICUITY, Channel, ChannelName, Conspicuity
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.contrast_steps import Kootstra2010Arithmetic, MirroredArithmetic
from saccade.attention.maps import SaliencyMaps
from saccade.attention.normalize import sharpen, smooth
from saccade.attention.saliencytoolbox2 import SaliencyToolbox2Arithmetic
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

ARITHMETICS = {
    "mirrored": MirroredArithmetic,
    "kootstra2010": Kootstra2010Arithmetic,
    "saliencytoolbox2": SaliencyToolbox2Arithmetic,
}


class Scale(NamedTuple):
    """Pyramid levels that are compared, and their weight."""

    center: int
    surround: int
    weight: float


Scales: TypeAlias = dict[ChannelName, list[Scale]]


class FeatureMap(NamedTuple):
    """Contrast of one channel at one scale."""

    channel: Channel
    """Name of the channel, and the angle of an orientation."""
    center: int
    """Pyramid level of the center."""
    surround: int
    """Pyramid level of the surround."""
    values: FloatMap
    """(h, w) absolute difference of center and surround (A.7-A.10)."""
    normalized: FloatMap
    """(h, w) the same after N."""


@dataclass(frozen=True, eq=False, repr=False)
class ContrastMaps(SaliencyMaps):
    """Saliency, conspicuity maps and feature maps.

    Maps are float32 (float64 for the presets `kootstra2010` and `saliencytoolbox2`); the saliency
    is in [0, 1] for the normalizations by local maxima (A.14).
    """

    intensity: FloatMap
    """(h, w) conspicuity (A.11), from 0 to the number of scales: 6 with `kootstra2010`."""
    color: FloatMap
    """(h, w) conspicuity (A.12), from 0 to 2; 0 for a gray image."""
    orientation: FloatMap
    """(h, w) conspicuity (A.13), from 0 to the number of orientations, 4."""
    features: tuple[FeatureMap, ...] = ()
    """The feature maps; empty without `keep_features`."""
    pyramids: Mapping[Channel, Mapping[int, FloatMap]] = field(default_factory=dict)
    """By channel and number of the level, 0 for the size of the image: the levels (h, w) that are
    compared (A.1-A.6); empty without `keep_features`."""

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
        config: channels, scales and normalization; presets name their source.
        keep_features: whether the result holds the feature maps and the pyramids.
        bgr: whether the image has OpenCV's order of colors, as `cv2.imread` returns it.

    Returns:
        Saliency and the three conspicuity maps, each (h, w), h = H / 2**map_level rounded up
        (down for the preset `saliencytoolbox2`), with the level of `config.at_size((H, W))`.

    Raises:
        ImageError: not an image, not finite, or too small for the finest surround.

    Source: Itti, Koch & Niebur (1998); equations A.1-A.14.
    """
    pixels = check_image(image, bgr=bgr)
    shape = pixels.shape[:2]
    config = (config or ContrastConfig()).at_size(shape)
    arithmetic = ARITHMETICS[config.arithmetic](config)
    scales = existing_scales(shape, config, arithmetic)
    zeros = np.zeros(arithmetic.level_shape(shape, config.map_level), arithmetic.dtype)  # (h, w)

    pyramids = channel_pyramids(pixels, scales, arithmetic)  # A.1-A.6
    sums = {Channel(name): zeros for name in CONSPICUITY} | dict.fromkeys(pyramids, zeros)
    features = []
    for channel, levels in pyramids.items():
        for center, surround, weight in scales[channel.name]:
            values = arithmetic.center_surround(levels[center], levels[surround], zeros.shape)
            values = smooth(values, config.smoothing)  # A.7-A.10
            normalized = arithmetic.normalize(values)
            at_map = arithmetic.resize(normalized, zeros.shape)
            sums[channel] = sums[channel] + weight * at_map
            if keep_features:
                features.append(FeatureMap(channel, center, surround, values, normalized))

    N = arithmetic.normalize_sum
    oriented = [N(sums[channel]) for channel in pyramids if channel.name == "orientation"]
    opponents = [N(sums[Channel("red-green")]), N(sums[Channel("blue-yellow")])]
    intensity = arithmetic.conspicuity([sums[Channel("intensity")]])  # A.11
    color = arithmetic.conspicuity(opponents)  # A.12
    orientation = arithmetic.conspicuity(oriented or [zeros])  # A.13
    saliency = arithmetic.saliency(intensity, color, orientation)  # A.14
    return ContrastMaps(
        saliency=sharpen(saliency, config.sharpening),
        intensity=intensity,
        color=color,
        orientation=orientation,
        image_shape=shape,
        features=tuple(features),
        pyramids=pyramids if keep_features else {},
    )


def existing_scales(
    shape: tuple[int, int], config: ContrastConfig, arithmetic: MirroredArithmetic
) -> Scales:
    """The scales of each channel that an image of this shape has; none of one without weight."""
    pairs = zip(config.scales, config.scale_weights, strict=True)
    color_scales = [Scale(center, surround, weight) for (center, surround), weight in pairs]
    orientation_scales = [Scale(*levels, 1.0) for levels in config.orientation_scales]
    weights = dict(zip(get_args(Conspicuity), config.weights, strict=True))
    scales: Scales = {
        name: orientation_scales if name == "orientation" else color_scales
        for name, conspicuity in CONSPICUITY.items()
        if weights[conspicuity] > 0
    }
    deepest = arithmetic.deepest_level(shape)
    finest = min(scale.surround for channel in scales.values() for scale in channel)
    if deepest < finest or max(arithmetic.level_shape(shape, config.map_level)) == 1:
        raise ImageError(
            f"image: expected more pixels for surround level {finest} and map level "
            f"{config.map_level}, found {shape[1]} x {shape[0]} px; enlarge it, or set finer scales"
        )
    return {
        name: [scale for scale in channel if scale.surround <= deepest]
        for name, channel in scales.items()
    }


def channel_pyramids(
    pixels: npt.NDArray[Any], scales: Scales, arithmetic: MirroredArithmetic
) -> dict[Channel, dict[int, FloatMap]]:
    """The levels that the scales compare, by channel and level number (A.1-A.6)."""
    compared = {
        name: {level for scale in channel for level in (scale.center, scale.surround)}
        for name, channel in scales.items()
    }
    numbers = set[int]().union(*compared.values())
    first, planes = arithmetic.split_channels(pixels, min(numbers))  # A.1-A.3
    levels = dict[ChannelName, dict[int, FloatMap]]()
    for name, plane in planes.items():
        if name in scales or name == "intensity":
            levels[name] = {first: plane}
            for number in range(first + 1, max(numbers) + 1):  # A.4-A.5
                levels[name][number] = arithmetic.halve(levels[name][number - 1])
    oriented = compared.pop("orientation", set())
    pyramids = {
        Channel(name): {number: levels[name][number] for number in compared[name]}
        for name in compared
    }
    responses = {n: arithmetic.orientation_responses(levels["intensity"][n]) for n in oriented}
    for i, angle in enumerate(arithmetic.config.orientations if oriented else ()):
        pyramids[Channel("orientation", angle)] = {
            n: each[i] for n, each in responses.items()
        }  # A.6
    return pyramids
