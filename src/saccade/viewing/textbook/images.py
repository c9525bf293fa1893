"""Figures of the steps of appendices A and B, and their results in words."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from saccade.types import FloatArray, Image
from saccade.viewing.keypoints import draw_keypoints
from saccade.viewing.style import (
    BLUE,
    DIVERGING,
    GRAY,
    GREEN,
    HEAT,
    ORANGE,
    RED,
    draw_panel,
    faded,
    figure_for,
    hide_ticks,
)

CHANNELS = {
    "intensity": ("intensity", (0.0, 1.0)),
    "red_green": ("green (-1) to red (1)", (-1.0, 1.0)),
    "blue_yellow": ("yellow (-1) to blue (1)", (-1.0, 1.0)),
}
"""Title and range of each channel."""
PERCENTILE = 99.0
"""Percentile of oriented responses that sets the black and white levels."""


def contrast_figures(image: Image, result: Any) -> dict[str, Figure]:
    """The figures of the steps from an image to its saliency, by name.

    Args:
        image: (H, W, 3) in [0, 1].
        result: the `ContrastSaliency` of the textbook.
    """
    return {
        "channels": _channel_figure(image, result.channels),
        "pyramids": _pyramid_figure(result.pyramids),
        "features": _feature_figure(result.features, normalized=False),
        "normalization": _feature_figure(result.features, normalized=True),
        "conspicuity": _conspicuity_figure(image, result),
    }


def contrast_results(result: Any) -> dict[str, dict[str, str]]:
    """The results of the steps of the contrast-saliency model, by step and name."""
    x, y = _maximum_in_image(result.saliency, result.channels["intensity"].shape[1])
    weights = {key: feature.normalized.weight for key, feature in result.features.items()}
    name, c, s = max(weights, key=lambda key: weights[key])
    return {
        "normalization": {
            "mean weight of the 42 maps": f"{np.mean(list(weights.values())):.3f}",
            "largest weight": f"{weights[name, c, s]:.3f}, of {name}, c = {c}, s = {s}",
        },
        "conspicuity": {
            "maximum of the saliency": f"{result.saliency.max():.3f} at x = {x}, y = {y}",
            "mean of the saliency": f"{result.saliency.mean():.3f}",
        },
    }


def _channel_figure(image: Image, channels: Mapping[str, FloatArray]) -> Figure:
    figure = figure_for(image.shape[1], image.shape[0], columns=4, rows=1, panel=3)
    panels = figure.subplots(1, 4)
    draw_panel(panels[0], image, "image")
    for axes, (name, values) in zip(panels[1:], channels.items(), strict=True):
        title, (low, high) = CHANNELS[name]
        draw_panel(axes, values, title, cmap="gray", vmin=low, vmax=high)
    return figure


def _pyramid_figure(pyramids: Mapping[str, Sequence[FloatArray]]) -> Figure:
    height, width = _mosaic(next(iter(pyramids.values()))).shape
    figure = figure_for(width, height, columns=4, rows=2, panel=3)
    panels = figure.subplots(2, 4).ravel()
    panels[3].set_axis_off()
    for axes, (name, levels) in zip(np.delete(panels, 3), pyramids.items(), strict=True):
        magnitudes = np.concatenate([np.abs(level).ravel() for level in levels])
        limit = float(np.percentile(magnitudes, PERCENTILE)) or 1.0
        title, (low, high) = CHANNELS.get(name, (_label(name), (-limit, limit)))
        draw_panel(axes, _mosaic(levels), title, cmap="gray", vmin=low, vmax=high)
    return figure


def _mosaic(levels: Sequence[FloatArray]) -> FloatArray:
    """The first level with the others in a column on its right; NaN between them."""
    height, width = levels[0].shape
    gap = max(2, width // 100)
    column_height = sum(level.shape[0] + gap for level in levels[1:]) - gap
    mosaic = np.full((max(height, column_height), width + gap + levels[1].shape[1]), np.nan)
    mosaic[:height, :width] = levels[0]
    top = 0
    for level in levels[1:]:
        h, w = level.shape
        mosaic[top : top + h, width + gap : width + gap + w] = level
        top += h + gap
    return mosaic


def _feature_figure(features: Mapping[tuple[str, int, int], Any], *, normalized: bool) -> Figure:
    """A row for each channel, a column for each pair of scales; after N all on one scale."""
    scales = list(dict.fromkeys((c, s) for _, c, s in features))
    channels = list(dict.fromkeys(name for name, _, _ in features))
    height, width = next(iter(features.values())).contrast.shape
    figure = figure_for(width, height, len(scales), len(channels), panel=2.0)
    panels = figure.subplots(len(channels), len(scales))
    limit = max(float(each.normalized.map.max()) for each in features.values()) or 1.0
    for (row, column), axes in np.ndenumerate(panels):
        (c, s), name = scales[column], channels[row]
        feature, title = features[name, c, s], f"c = {c}, s = {s}" if row == 0 else ""
        hide_ticks(axes)
        if normalized:
            axes.imshow(feature.normalized.map, cmap=HEAT, vmin=0, vmax=limit)
            maxima = feature.normalized.maxima[:, ::-1].T
            axes.plot(*maxima, "x", color=RED, markersize=2.5, markeredgewidth=0.7)
            title += "\n" + _weight(feature.normalized)
        else:
            axes.imshow(feature.contrast, cmap=HEAT, vmin=0)
        axes.set_title(title.strip(), fontsize=8)
        if column == 0:
            axes.set_ylabel(_label(name), fontsize=9)
    return figure


def _conspicuity_figure(image: Image, result: Any) -> Figure:
    height, width = image.shape[:2]
    figure = figure_for(width, height, columns=5, rows=1, panel=2.8)
    panels = figure.subplots(1, 5)
    for axes, (name, each) in zip(panels, result.conspicuity.items(), strict=False):
        draw_panel(axes, getattr(result, name), f"{name}\n{_weight(each)}", cmap=HEAT, vmin=0)
    saliency = result.saliency
    row, column = np.unravel_index(int(saliency.argmax()), saliency.shape)
    title = f"saliency\n0 to {float(saliency.max()):.2f}"
    draw_panel(panels[3], saliency, title, cmap=HEAT, vmin=0)
    panels[3].plot(column, row, "+", color=RED, markersize=11, markeredgewidth=2)
    draw_panel(panels[4], image, "its maximum\nin the image")
    circle = {"color": ORANGE, "markersize": 16, "markeredgewidth": 2.5, "fillstyle": "none"}
    panels[4].plot(*_maximum_in_image(saliency, width), "o", **circle)
    return figure


def _maximum_in_image(saliency: FloatArray, width: int) -> tuple[int, int]:
    """(x, y) in pixels of the maximum of a map, in an image of that width (A.5)."""
    row, column = np.unravel_index(int(saliency.argmax()), saliency.shape)
    spacing = 2 ** round(np.log2(width / saliency.shape[1]))
    return int(column) * spacing, int(row) * spacing


def _label(channel: str) -> str:
    """The name of a channel beside its maps: red-green, 45°."""
    degrees = channel.removeprefix("orientation_")
    return channel.replace("_", "-") if degrees == channel else f"{degrees}°"


def _weight(normalized: Any) -> str:
    return f"m = {normalized.mean_of_maxima:.2f}, weight {normalized.weight:.2f}"


OUTCOMES = {
    "low contrast": (GRAY, "."),
    "edge": (RED, "x"),
    "unstable": (BLUE, "s"),
    "kept": (GREEN, "o"),
}
"""Color and marker of a candidate by the first test it failed."""


def sift_figures(image: Image, result: Any) -> dict[str, Figure]:
    """The figures of the steps from an image to its keypoints, by name.

    Args:
        image: (H, W, 3) in [0, 1].
        result: the `SiftResult` of the textbook.
    """
    return {
        "scale-space": _scale_space_figure(result.scale_space, result.differences),
        "candidates": _candidate_figure(image, result),
    }


def sift_results(result: Any) -> dict[str, dict[str, str]]:
    """The results of the steps of SIFT, by step and name."""
    outcomes = [candidate.status for candidate in result.candidates]
    kept = outcomes.count("kept")
    ratio = f", {len(result.keypoints) / kept:.2f} for each candidate kept" if kept else ""
    return {
        "candidates": {"candidates": str(len(outcomes))}
        | {name: str(outcomes.count(name)) for name in OUTCOMES},
        "orientation": {"keypoints": f"{len(result.keypoints)}{ratio}"},
    }


def _scale_space_figure(
    gaussians: Sequence[Sequence[FloatArray]], differences: Sequence[Sequence[FloatArray]]
) -> Figure:
    """Two rows for each octave: L, and below it D."""
    height, width = gaussians[0][0].shape
    columns, rows = len(gaussians[0]), 2 * len(gaussians)
    figure = figure_for(width, height, columns, rows, panel=2.1)
    panels = figure.subplots(rows, columns, squeeze=False)
    for octave, (smoothed, subtracted) in enumerate(zip(gaussians, differences, strict=True)):
        upper, lower = panels[2 * octave], panels[2 * octave + 1]
        for i, (axes, L) in enumerate(zip(upper, smoothed, strict=True)):
            axes.imshow(L, cmap="gray", vmin=0, vmax=1)
            axes.set_title(rf"$\sigma = {2**octave if octave else ''} k^{i} \sigma_0$", fontsize=9)
        limit = max(float(np.abs(D).max()) for D in subtracted) or 1.0
        for axes, D in zip(lower, subtracted, strict=False):
            axes.imshow(D, cmap=DIVERGING, vmin=-limit, vmax=limit)
        for axes in (*upper, *lower):
            hide_ticks(axes)
        h, w = smoothed[0].shape
        upper[0].set_ylabel(f"octave {octave + 1}: L\n{w} x {h}", fontsize=9)
        lower[0].set_ylabel(f"D, to ±{limit:.2f}", fontsize=9)
    return figure


def _candidate_figure(image: Image, result: Any) -> Figure:
    """Every candidate by the first test it failed, and the keypoints that remain."""
    height, width = image.shape[:2]
    figure = figure_for(width, height, columns=1, rows=1, panel=11)
    axes = figure.subplots()
    axes.imshow(faded(np.asarray(image, np.float32)), cmap="gray", vmin=0, vmax=1)
    for name, (color, marker) in OUTCOMES.items():
        candidates = [each for each in result.candidates if each.status == name]
        x = [each.column * 2**each.octave for each in candidates]
        y = [each.row * 2**each.octave for each in candidates]
        size = 3 if marker == "." else 5
        label = f"{len(candidates)} {name}"
        axes.plot(x, y, marker, color=color, markersize=size, label=label)
    draw_keypoints(axes, result.keypoints)
    axes.set_axis_off()
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    legend = {"ncols": len(OUTCOMES), "frameon": False, "markerscale": 1.6}
    figure.legend(loc="outside lower center", **legend)
    return figure
