"""Pictures of symmetry: the pairs of gradients that face each other across a place."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from saccade.types import Float32Array, FloatArray, Regions, SymmetricPairs
from saccade.viewing.style import BLUE, ORANGE, figure_for, picture_axes

STROKE = 0.12
"""Half the length of the stroke along an edge, by the distance of its pair."""
SHOWN = 0.25
"""Pairs are drawn that have this share of the strength of the strongest of their place."""
THIN, THICK = 0.5, 1.6
"""Points: widths of the line of a pair without strength and of the strongest of its place."""


def pair_figure(image: Float32Array, pairs: Sequence[SymmetricPairs]) -> Figure:
    """The photo with the symmetric pairs of some places.

    Args:
        image: (H, W, 3) in [0, 1].
        pairs: those of each place.
    """
    figure = figure_for(image.shape[1], image.shape[0], columns=1, rows=1, panel=9)
    axes = figure.subplots()
    draw_pairs(axes, image, pairs)
    places = "a place" if len(pairs) == 1 else f"{len(pairs)} places"
    picture_axes(axes, f"what is symmetric about {places}")
    return figure


def region_figure(image: Float32Array, regions: Regions) -> Figure:
    """The photo with the box and the center of each region.

    Args:
        image: (H, W, 3) in [0, 1].
        regions: of that image.
    """
    figure = figure_for(image.shape[1], image.shape[0], columns=1, rows=1, panel=9)
    axes = figure.subplots()
    axes.imshow(image, interpolation="antialiased")
    for left, top, right, bottom in regions.boxes.tolist():
        axes.add_patch(
            Rectangle(
                (left, top), right - left, bottom - top, fill=False, color=ORANGE, linewidth=1.2
            )
        )
    axes.plot(*regions.xy.T, "+", color=BLUE, markersize=7, markeredgewidth=1.5)
    picture_axes(axes, f"{len(regions)} regions: box and center")
    return figure


def draw_pairs(axes: Axes, image: Float32Array, pairs: Sequence[SymmetricPairs]) -> None:
    """The photo in pale grey; each pair as a line between strokes along the two edges.

    Args:
        axes: where.
        image: (H, W, 3) in [0, 1].
        pairs: those of each place; the strong ones are drawn.
    """
    axes.imshow(faded(image), interpolation="antialiased", vmin=0, vmax=1, cmap="gray")
    for each in pairs:
        fraction = each.strength / each.strength.max(initial=1e-30)
        strong, fraction = each[fraction >= SHOWN], fraction[fraction >= SHOWN]
        width = THIN + (THICK - THIN) * fraction
        joined = np.stack([strong.first, strong.second], axis=1)
        length = STROKE * np.hypot(*(strong.first - strong.second).T)
        axes.add_collection(LineCollection(list(joined), colors=ORANGE, linewidths=width))
        for place, angle in (
            (strong.first, strong.first_angle),
            (strong.second, strong.second_angle),
        ):
            strokes = along_edges(place, angle, length)
            axes.add_collection(LineCollection(list(strokes), colors=BLUE, linewidths=1.4 * width))


def along_edges(place: FloatArray, gradient: FloatArray, length: FloatArray) -> FloatArray:
    """(n, 2, 2) the ends of strokes across the direction of gradients.

    Args:
        place: (n, 2) middle of each.
        gradient: (n,) radians.
        length: (n,) pixels.
    """
    half = np.stack([-np.sin(gradient), np.cos(gradient)], axis=1) * length[:, None]
    return np.stack([place - half, place + half], axis=1)


def faded(image: Float32Array) -> Float32Array:
    """(H, W) grey, and pale: what is drawn on it is seen."""
    return np.asarray(0.35 + 0.65 * image.mean(axis=2), np.float32)
