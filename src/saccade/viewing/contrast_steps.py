"""The steps of the contrast-saliency model as pictures (appendix A)."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saccade.types import FloatArray, Image
from saccade.viewing.style import HEAT, ORANGE, RED, figure_for, picture_axes

NAMES = {
    "intensity": "intensity",
    "red_green": "red-green",
    "blue_yellow": "blue-yellow",
    "orientation_0": "0°",
    "orientation_45": "45°",
    "orientation_90": "90°",
    "orientation_135": "135°",
}
"""What the channels are called in pictures."""
SIGNED = "PuOr_r"
"""Colors of what is negative, zero and positive."""


def channel_figure(image: Image, channels: Mapping[str, FloatArray]) -> Figure:
    """The image, its intensity, and its opponencies on a scale of -1 to 1.

    Args:
        image: (H, W, 3) in [0, 1].
        channels: "intensity", "red_green" and "blue_yellow", each (H, W).
    """
    figure = figure_for(image.shape[1], image.shape[0], columns=4, rows=1, panel=3)
    panels = figure.subplots(1, 4)
    panels[0].imshow(image)
    picture_axes(panels[0], "image")
    ends = {"red_green": "green (-1) to red (1)", "blue_yellow": "yellow (-1) to blue (1)"}
    for axes, (name, values) in zip(panels[1:], channels.items(), strict=True):
        if name == "intensity":
            axes.imshow(values, cmap="gray", vmin=0, vmax=1)
            picture_axes(axes, "I: intensity")
        else:
            axes.imshow(values, cmap="gray", vmin=-1, vmax=1)
            picture_axes(axes, f"{'RG' if name == 'red_green' else 'BY'}: {ends[name]}")
    return figure


def pyramid_figure(pyramids: Mapping[str, Sequence[FloatArray]]) -> Figure:
    """Every pyramid, its levels in their true proportions.

    Args:
        pyramids: by the names of `NAMES`; levels 0, 1, ..., each half as large as the last.
    """
    height, width = mosaic(next(iter(pyramids.values()))).shape
    figure = figure_for(width, height, columns=4, rows=2, panel=3)
    panels = figure.subplots(2, 4).ravel()
    panels[3].set_axis_off()
    for axes, (name, levels) in zip(np.delete(panels, 3), pyramids.items(), strict=True):
        signed = name != "intensity"
        largest = max(float(np.abs(level).max()) for level in levels) or 1.0
        low, high = (-largest, largest) if signed else (0.0, 1.0)
        axes.imshow(mosaic(levels), cmap="gray", vmin=low, vmax=high)
        picture_axes(axes, NAMES[name])
    return figure


def mosaic(levels: Sequence[FloatArray]) -> FloatArray:
    """The first level with the others in a column on its right; NaN between them."""
    height, width = levels[0].shape
    gap = max(2, width // 100)
    sheet = np.full((height, width + gap + levels[1].shape[1]), np.nan)
    sheet[:, :width] = levels[0]
    top = 0
    for level in levels[1:]:
        h, w = min(level.shape[0], height - top), level.shape[1]
        sheet[top : top + h, width + gap : width + gap + w] = level[:h]
        top += h + gap
        if top >= height:
            break
    return sheet


def feature_figure(
    maps: Mapping[tuple[str, int, int], FloatArray],
    titles: Mapping[tuple[str, int, int], str] | None = None,
    maxima: Mapping[tuple[str, int, int], FloatArray] | None = None,
) -> Figure:
    """The feature maps, a row for each channel and a column for each pair of scales.

    Args:
        maps: by channel, center and surround level.
        titles: of each; with them all maps are drawn on one scale, else each on its own.
        maxima: (k, 2) rows and columns that are marked.
    """
    pairs = list(dict.fromkeys((c, s) for _, c, s in maps))
    channels = list(dict.fromkeys(name for name, _, _ in maps))
    height, width = next(iter(maps.values())).shape
    figure = figure_for(width, height, len(pairs), len(channels), panel=2.0)
    panels = figure.subplots(len(channels), len(pairs))
    largest = max(float(each.max()) for each in maps.values()) if titles else None
    for row, name in enumerate(channels):
        for column, (c, s) in enumerate(pairs):
            axes, key = panels[row, column], (name, c, s)
            own = float(maps[key].max()) or 1.0
            axes.imshow(maps[key], cmap=HEAT, vmin=0, vmax=largest or own)
            bare(axes)
            if maxima is not None:
                axes.plot(*maxima[key][:, ::-1].T, "x", color=RED, markersize=2.5, markeredgewidth=0.7)
            if titles:
                axes.set_title(titles[key], fontsize=8)
            if row == 0:
                scales = f"c = {c}, s = {s}"
                axes.set_title(f"{scales}\n{titles[key]}" if titles else scales, fontsize=8)
            if column == 0:
                axes.set_ylabel(NAMES[name], fontsize=9)
    return figure


def conspicuity_figure(
    image: Image, conspicuity: Mapping[str, tuple[FloatArray, str]], saliency: FloatArray
) -> Figure:
    """The conspicuity maps, and the saliency map with its maximum on the image.

    Args:
        image: (H, W, 3) in [0, 1].
        conspicuity: maps (h, w) and what is said of each, by name.
        saliency: (h, w).
    """
    height, width = image.shape[:2]
    figure = figure_for(width, height, columns=len(conspicuity) + 2, rows=1, panel=2.8)
    panels = figure.subplots(1, len(conspicuity) + 2)
    for axes, (name, (values, words)) in zip(panels, conspicuity.items(), strict=False):
        axes.imshow(values, cmap=HEAT, vmin=0)
        picture_axes(axes, f"{name}\n{words}")
    row, column = np.unravel_index(int(saliency.argmax()), saliency.shape)
    panels[-2].imshow(saliency, cmap=HEAT, vmin=0)
    panels[-2].plot(column, row, "+", color=RED, markersize=11, markeredgewidth=2)
    picture_axes(panels[-2], f"saliency\n0 to {float(saliency.max()):.2f}")
    x, y = place_in_image(saliency, width)
    panels[-1].imshow(image)
    panels[-1].plot(x, y, "o", color=ORANGE, markersize=16, markeredgewidth=2.5, fillstyle="none")
    picture_axes(panels[-1], "its maximum\nin the image")
    return figure


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
