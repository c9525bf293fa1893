"""Pyramids, center-surround maps and conspicuity maps of a photograph, as pictures for the page."""

from typing import Any

from saccade.attention.channels import Channel
from saccade.attention.contrast import (
    ContrastConfig,
    FeatureMap,
    contrast_pyramids,
    contrast_saliency,
)
from saccade.scale.pyramid import FloatMap
from saccade.types import Image
from saccade.viewing.embedding import heat, shrunk

LEVEL_SIDE = 200
"""Pixels of the longer side of a pyramid level on the page."""


def feature_data(image: Image, config: ContrastConfig) -> list[dict[str, Any]]:
    """What the contrast model computes, by channel, as the page reads it.

    Args:
        image: (H, W, 3).
        config: of the model.

    Returns:
        For each channel its name, the levels of its pyramid (A.1-A.6), its center-surround maps
        (A.7-A.10) and the same after normalization; last the conspicuity maps (A.11-A.13) and the
        saliency (A.14).
    """
    maps = contrast_saliency(image, config, keep_features=True)
    channels = [
        {"name": channel_name(channel), "rows": _rows(levels, maps.features, channel)}
        for channel, levels in contrast_pyramids(image, config).items()
    ]
    sums = [{"name": name, "address": heat(values)} for name, values in maps.layers.items()]
    return [*channels, {"name": "all channels", "rows": [{"name": "conspicuity", "maps": sums}]}]


def channel_name(channel: Channel) -> str:
    """The name of a channel, with the angle of an orientation."""
    return (
        channel.name
        if channel.angle is None
        else f"{channel.name} {channel.angle:g}\N{DEGREE SIGN}"
    )


def _rows(
    levels: dict[int, FloatMap], features: tuple[FeatureMap, ...], channel: Channel
) -> list[dict[str, Any]]:
    own = [each for each in features if each.channel == channel]
    pyramid = [
        {"name": f"level {number}", "address": _level(level)}
        for number, level in sorted(levels.items())
    ]
    differences, normalized = (
        [
            {"name": f"{each.center} against {each.surround}", "address": heat(values)}
            for each, values in zip(own, maps, strict=True)
        ]
        for maps in ([each.values for each in own], [each.normalized for each in own])
    )
    return [
        {"name": "pyramid", "maps": pyramid},
        {"name": "center against surround", "maps": differences},
        {"name": "normalized", "maps": normalized},
    ]


def _level(level: FloatMap) -> str:
    """A level from its smallest value to its largest: those of opponent colors have signs."""
    small = shrunk(level, LEVEL_SIDE / max(level.shape))
    return heat(small - small.min())
