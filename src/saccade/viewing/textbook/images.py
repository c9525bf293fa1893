"""Figures of the steps of appendices A and B, and their results in words."""

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

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
    picture_axes,
)

CHANNELS = {
    "intensity": ("intensity", (0.0, 1.0)),
    "red_green": ("green (-1) to red (1)", (-1.0, 1.0)),
    "blue_yellow": ("yellow (-1) to blue (1)", (-1.0, 1.0)),
}
"""Title and range of each channel."""
PERCENTILE = 99.0
"""Percentile of the magnitudes of oriented responses that is drawn as black and white."""


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
MAX_STRONGEST, MIN_ROTATION = 60, 0.5
"""The example is the largest of the strongest keypoints whose patch is inside the image and visibly
rotated: its absolute sine of twice the orientation is larger."""
PATCH = 160
"""Pixels on a side of the rotated patch."""


def sift_figures(image: Image, result: Any) -> dict[str, Figure]:
    """The figures of the steps from an image to its keypoints, by name.

    Without a keypoint there are no figures of a single one.

    Args:
        image: (H, W, 3) in [0, 1].
        result: the `SiftResult` of the textbook.
    """
    figures = {
        "scale-space": _scale_space_figure(result.scale_space, result.differences),
        "candidates": _candidate_figure(image, result),
    }
    point = _example(result)
    if point is not None:
        candidate = result.candidates[point.candidate]
        octave = result.scale_space[candidate.octave]
        scale = round(candidate.i + candidate.offset[2])
        L = octave[min(max(scale, 0), len(octave) - 1)]
        angles = [each.angle for each in result.descriptions if each.candidate == point.candidate]
        spacing = 2**candidate.octave
        figures["orientation"] = _orientation_figure(image, point, L, spacing, angles)
        figures["descriptor"] = _descriptor_figure(point, L)
    return figures


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


def _example(result: Any) -> Any:
    """The description of one keypoint; None where no patch is inside the image."""
    inside = []
    for each in result.descriptions[:MAX_STRONGEST]:
        octave = result.candidates[each.candidate].octave
        height, width = result.scale_space[octave][0].shape
        if (each.grid >= 0).all() and (each.grid <= (width - 1, height - 1)).all():
            rotated = abs(np.sin(2 * each.angle)) > MIN_ROTATION
            inside.append((rotated, each.sigma * 2**octave, each))
    return max(inside, key=lambda each: each[:2])[2] if inside else None


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


def _orientation_figure(
    image: Image, point: Any, L: FloatArray, spacing: int, dominant: Sequence[float]
) -> Figure:
    """The patch of a keypoint, its grid of samples in L, and its histogram of directions."""
    figure = Figure(figsize=(11.5, 3.6), layout="compressed", dpi=110)
    overview, closeup, bars = figure.subplots(1, 3, width_ratios=(1.35, 1, 1.35))
    corners = _corners(point.grid)
    draw_panel(overview, image, "the keypoint and its patch")
    overview.plot(*(corners * spacing).T, color=ORANGE, linewidth=2)
    draw_panel(closeup, L, "16 x 16 samples, rotated", cmap="gray")
    margin = 1.5 * point.sigma
    low, high = corners.min(0) - margin, corners.max(0) + margin
    closeup.set_xlim(low[0], high[0])
    closeup.set_ylim(high[1], low[1])
    closeup.plot(*point.grid.reshape(-1, 2).T, ".", color=BLUE, markersize=3)
    a, b, c, d, _ = corners
    for t in (0, 0.25, 0.5, 0.75, 1):  # the borders of the subregions
        for border in ((a + (b - a) * t, d + (c - d) * t), (a + (d - a) * t, b + (c - b) * t)):
            closeup.plot(*np.array(border).T, color=ORANGE, linewidth=1.2)
    length = 6 * point.sigma
    tip = point.x + length * np.cos(point.angle), point.y + length * np.sin(point.angle)
    arrow = {"color": RED, "width": 2, "headwidth": 9}
    closeup.annotate("", tip, (point.x, point.y), arrowprops=arrow)
    fraction = point.histogram / (float(point.histogram.max()) or 1.0)
    bars.bar(np.arange(36) * 10 + 5, fraction, width=9, color=np.where(fraction > 0.8, BLUE, GRAY))
    bars.axhline(0.8, color="black", linestyle="--", linewidth=1)
    for angle in dominant:
        bars.axvline(np.degrees(angle) % 360, color=RED, linewidth=1.5)
    bars.set_title("36 bins; over 80 % of the highest: blue", fontsize=10)
    bars.set_xlabel("direction, from x towards y [degrees]")
    bars.xaxis.set_major_locator(MultipleLocator(90))
    return figure


def _descriptor_figure(point: Any, L: FloatArray) -> Figure:
    """The gradients in the rotated patch, and the descriptor as stars and as bars."""
    figure = Figure(figsize=(11.5, 3.6), layout="compressed", dpi=110)
    left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1, 1.6))
    x, y = np.meshgrid(np.arange(16) + 0.5, np.arange(16) + 0.5)
    lengths = point.magnitudes * point.weights
    _draw_patch(left, point.grid, L)
    _draw_arrows(left, (x, y), lengths, point.orientations, 1.4, width=0.007)
    picture_axes(left, "gradients, weighted")
    row, column, direction = (each.ravel() for each in np.indices((4, 4, 8)))
    centers, angles = (4 * column + 2, 4 * row + 2), direction * np.pi / 4
    rays = {"width": 0.012, "headwidth": 1, "headlength": 0}
    _draw_patch(middle, point.grid, L)
    _draw_arrows(middle, centers, point.vector, angles, 2.2, **rays)
    picture_axes(middle, "4 x 4 histograms of 8 directions")
    right.bar(np.arange(128), point.vector, width=1.0, color=BLUE)
    right.set_xlim(-0.5, 127.5)
    right.xaxis.set_major_locator(MultipleLocator(32))
    right.set_xlabel("four subregions of 8 bins between two ticks: a row of the patch")
    right.set_title("128 values of unit length", fontsize=10)
    return figure


def _draw_patch(axes: Axes, grid: FloatArray, L: FloatArray) -> None:
    """L in the frame of the keypoint, 16 samples on a side, pale, with its subregions."""
    along_x, along_y = grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]
    u = (np.arange(PATCH) + 0.5) * (16 / PATCH) - 0.5  # in samples from the first
    xy = grid[0, 0] + u[:, None, None] * along_y + u[:, None] * along_x  # (PATCH, PATCH, 2)
    x, y = (np.ascontiguousarray(xy[..., i], np.float32) for i in (0, 1))
    border = cv2.BORDER_REPLICATE
    patch = cv2.remap(np.asarray(L, np.float32), x, y, cv2.INTER_LINEAR, borderMode=border)
    low, high = float(patch.min()), float(patch.max())
    axes.imshow(patch, cmap="gray", vmin=low - 1.2 * (high - low), vmax=high, extent=(0, 16, 16, 0))
    for line in (4, 8, 12):
        axes.axhline(line, color=ORANGE, linewidth=1.2)
        axes.axvline(line, color=ORANGE, linewidth=1.2)
    axes.set_xlim(0, 16)
    axes.set_ylim(16, 0)


def _draw_arrows(
    axes: Axes, tails: Any, length: FloatArray, angle: Any, max_length: float, **style: float
) -> None:
    """Arrows of these lengths and angles, scaled so that the longest has `max_length`."""
    scaled = length * (max_length / (float(length.max()) or 1.0))
    options: Any = {"angles": "xy", "scale_units": "xy", "scale": 1, "color": BLUE, **style}
    axes.quiver(*tails, scaled * np.cos(angle), scaled * np.sin(angle), **options)


def _corners(grid: FloatArray) -> FloatArray:
    """(5, 2) the closed outline of the samples, half a spacing beyond the outermost."""
    along_x, along_y = grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)])
    center = grid.reshape(-1, 2).mean(0)
    return np.asarray(center + 8 * (signs[:, :1] * along_x + signs[:, 1:] * along_y))
