"""Figures of local symmetry: pairs of gradients and regions."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from saccade.types import Float32Array, FloatArray, Regions, SymmetricPairs
from saccade.viewing.style import BLUE, ORANGE, draw_panel, faded, figure_for, picture_axes

STROKE = 0.12
"""Half the length of the stroke along an edge, as a fraction of the distance of its pair."""
MIN_STRENGTH = 0.25
"""Strength of a pair that is drawn, as a fraction of the strongest of its point."""
MIN_WIDTH, MAX_WIDTH = 0.5, 1.6
"""Points: widths of the line of a pair without strength and of the strongest of its point."""


def pair_figure(image: Float32Array, pairs: Sequence[SymmetricPairs]) -> Figure:
    """The image with the symmetric pairs of some points.

    Args:
        image: (H, W, 3) in [0, 1].
        pairs: those of each point.
    """
    figure = figure_for(image.shape[1], image.shape[0], columns=1, rows=1, panel=9)
    axes = figure.subplots()
    draw_pairs(axes, image, pairs)
    points = "a point" if len(pairs) == 1 else f"{len(pairs)} points"
    picture_axes(axes, f"symmetric pairs at {points}")
    return figure


def region_figure(image: Float32Array, regions: Regions) -> Figure:
    """The image with the box and the center of each region.

    Args:
        image: (H, W, 3) in [0, 1].
        regions: of that image.
    """
    figure = figure_for(image.shape[1], image.shape[0], columns=1, rows=1, panel=9)
    axes = figure.subplots()
    title = f"{len(regions)} regions: box and center"
    draw_panel(axes, image, title, interpolation="antialiased")
    for left, top, right, bottom in regions.boxes.tolist():
        size = right - left, bottom - top
        axes.add_patch(Rectangle((left, top), *size, fill=False, color=ORANGE, linewidth=1.2))
    axes.plot(*regions.xy.T, "+", color=BLUE, markersize=7, markeredgewidth=1.5)
    return figure


def draw_pairs(axes: Axes, image: Float32Array, pairs: Sequence[SymmetricPairs]) -> None:
    """The image in pale gray; each pair as a line between strokes along the two edges.

    Args:
        axes: of the figure.
        image: (H, W, 3) in [0, 1].
        pairs: those of each point; the strong ones are drawn.
    """
    axes.imshow(faded(image), interpolation="antialiased", vmin=0, vmax=1, cmap="gray")
    for each in pairs:
        fraction = each.strength / each.strength.max(initial=1e-30)
        strong, fraction = each[fraction >= MIN_STRENGTH], fraction[fraction >= MIN_STRENGTH]
        width = MIN_WIDTH + (MAX_WIDTH - MIN_WIDTH) * fraction
        lines = np.stack([strong.first, strong.second], axis=1)
        length = STROKE * np.hypot(*(strong.first - strong.second).T)
        axes.add_collection(LineCollection(list(lines), colors=ORANGE, linewidths=width))
        for xy, angle in ((strong.first, strong.first_angle), (strong.second, strong.second_angle)):
            strokes = _edge_strokes(xy, angle, length)
            axes.add_collection(LineCollection(list(strokes), colors=BLUE, linewidths=1.4 * width))


def _edge_strokes(xy: FloatArray, gradient: FloatArray, length: FloatArray) -> FloatArray:
    """(n, 2, 2) the ends of strokes perpendicular to gradients.

    Args:
        xy: (n, 2) midpoint of each.
        gradient: (n,) direction in radians.
        length: (n,) half of each, in pixels.
    """
    half = np.stack([-np.sin(gradient), np.cos(gradient)], axis=1) * length[:, None]
    return np.stack([xy - half, xy + half], axis=1)
