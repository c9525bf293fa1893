"""The steps of the contrast-saliency model as pictures (appendix A)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saccade.types import FloatArray, Image
from saccade.viewing.style import HEAT, ORANGE, RED, figure_for, picture_axes

SIGNED = "PuOr_r"
"""Colors of what is negative, zero and positive."""
PANELS = {
    "intensity": ("intensity", (0.0, 1.0)),
    "red_green": ("green (-1) to red (1)", (-1.0, 1.0)),
    "blue_yellow": ("yellow (-1) to blue (1)", (-1.0, 1.0)),
}
"""What the channels are called in pictures, and their range."""
SHOWN = 99.0
"""Percent of the responses to bars whose size fits between black and white."""


def contrast_figures(image: Image, result: Any) -> dict[str, Figure]:
    """The steps from an image to its saliency, by name.

    Args:
        image: (H, W, 3) in [0, 1].
        result: the `ContrastSaliency` of the textbook.
    """
    return {
        "channels": _channels(image, result.channels),
        "pyramids": _pyramids(result.pyramids),
        "features": _features(result.features, normalized=False),
        "normalization": _features(result.features, normalized=True),
        "conspicuity": _conspicuity(image, result),
    }


def place_in_image(saliency: FloatArray, width: int) -> tuple[int, int]:
    """Where the maximum of a map is in the image: (x, y) in pixels.

    Args:
        saliency: (h, w), of every second sample of every second sample, and so on (A.5).
        width: of the image.
    """
    row, column = np.unravel_index(int(saliency.argmax()), saliency.shape)
    spacing = 2 ** round(np.log2(width / saliency.shape[1]))
    return int(column) * spacing, int(row) * spacing


def bare(axes: Axes) -> None:
    """Axes without ticks and frame that can still have a label at their side."""
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(False)


def _channels(image: Image, channels: Mapping[str, FloatArray]) -> Figure:
    figure = figure_for(image.shape[1], image.shape[0], columns=4, rows=1, panel=3)
    panels = figure.subplots(1, 4)
    panels[0].imshow(image)
    picture_axes(panels[0], "image")
    for axes, (name, values) in zip(panels[1:], channels.items(), strict=True):
        title, (low, high) = PANELS[name]
        axes.imshow(values, cmap="gray", vmin=low, vmax=high)
        picture_axes(axes, title)
    return figure


def _pyramids(pyramids: Mapping[str, Sequence[FloatArray]]) -> Figure:
    height, width = _mosaic(next(iter(pyramids.values()))).shape
    figure = figure_for(width, height, columns=4, rows=2, panel=3)
    panels = figure.subplots(2, 4).ravel()
    panels[3].set_axis_off()
    for axes, (name, levels) in zip(np.delete(panels, 3), pyramids.items(), strict=True):
        values = np.concatenate([np.abs(level).ravel() for level in levels])
        most = float(np.percentile(values, SHOWN)) or 1.0
        title, (low, high) = PANELS.get(name, (_label(name), (-most, most)))
        axes.imshow(_mosaic(levels), cmap="gray", vmin=low, vmax=high)
        picture_axes(axes, title)
    return figure


def _mosaic(levels: Sequence[FloatArray]) -> FloatArray:
    """The first level with the others in a column on its right; NaN between them."""
    height, width = levels[0].shape
    gap = max(2, width // 100)
    beside = sum(level.shape[0] + gap for level in levels[1:]) - gap
    sheet = np.full((max(height, beside), width + gap + levels[1].shape[1]), np.nan)
    sheet[:height, :width] = levels[0]
    top = 0
    for level in levels[1:]:
        h, w = level.shape
        sheet[top : top + h, width + gap : width + gap + w] = level
        top += h + gap
    return sheet


def _features(features: Mapping[tuple[str, int, int], Any], *, normalized: bool) -> Figure:
    """A row for each channel, a column for each pair of scales; after N all on one scale."""
    pairs = list(dict.fromkeys((c, s) for _, c, s in features))
    channels = list(dict.fromkeys(name for name, _, _ in features))
    height, width = next(iter(features.values())).contrast.shape
    figure = figure_for(width, height, len(pairs), len(channels), panel=2.0)
    panels = figure.subplots(len(channels), len(pairs))
    largest = max(float(each.normalized.map.max()) for each in features.values()) or 1.0
    for (row, column), axes in np.ndenumerate(panels):
        (c, s), name = pairs[column], channels[row]
        feature, title = features[name, c, s], f"c = {c}, s = {s}" if row == 0 else ""
        bare(axes)
        if normalized:
            axes.imshow(feature.normalized.map, cmap=HEAT, vmin=0, vmax=largest)
            maxima = feature.normalized.maxima[:, ::-1].T
            axes.plot(*maxima, "x", color=RED, markersize=2.5, markeredgewidth=0.7)
            title += "\n" + _weight(feature.normalized)
        else:
            axes.imshow(feature.contrast, cmap=HEAT, vmin=0)
        axes.set_title(title.strip(), fontsize=8)
        if column == 0:
            axes.set_ylabel(_label(name), fontsize=9)
    return figure


def _conspicuity(image: Image, result: Any) -> Figure:
    height, width = image.shape[:2]
    figure = figure_for(width, height, columns=5, rows=1, panel=2.8)
    panels = figure.subplots(1, 5)
    for axes, (name, each) in zip(panels, result.conspicuity.items(), strict=False):
        axes.imshow(getattr(result, name), cmap=HEAT, vmin=0)
        picture_axes(axes, f"{name}\n{_weight(each)}")
    saliency = result.saliency
    row, column = np.unravel_index(int(saliency.argmax()), saliency.shape)
    panels[3].imshow(saliency, cmap=HEAT, vmin=0)
    panels[3].plot(column, row, "+", color=RED, markersize=11, markeredgewidth=2)
    picture_axes(panels[3], f"saliency\n0 to {float(saliency.max()):.2f}")
    circle = {"color": ORANGE, "markersize": 16, "markeredgewidth": 2.5, "fillstyle": "none"}
    panels[4].imshow(image)
    panels[4].plot(*place_in_image(saliency, width), "o", **circle)
    picture_axes(panels[4], "its maximum\nin the image")
    return figure


def _label(name: str) -> str:
    """What a channel is called beside its maps: red-green, 45°."""
    degrees = name.removeprefix("orientation_")
    return name.replace("_", "-") if degrees == name else f"{degrees}°"


def _weight(normalized: Any) -> str:
    return f"m = {normalized.mean_of_maxima:.2f}, weight {normalized.weight:.2f}"
