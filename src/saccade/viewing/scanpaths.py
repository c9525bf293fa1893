"""Figures of many scanpaths: distributions of amplitudes, directions and durations."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saccade.types import FloatArray
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED, grid_axes

COLORS = ("black", GRAY, BLUE, GREEN, ORANGE, RED)
"""Of the groups, in their order."""
DIRECTIONS = 16
"""Bins of directions."""


def saccades(paths: Sequence[FloatArray]) -> FloatArray:
    """(n, 2) the vectors of all saccades of paths (k, 2) of fixations."""
    return np.vstack([np.zeros((0, 2)), *(np.diff(path, axis=0) for path in paths)])


def scanpath_figure(
    paths: Mapping[str, Sequence[FloatArray]],
    durations: Mapping[str, FloatArray],
    pixels_per_degree: float,
) -> Figure:
    """Distributions of amplitude, direction and duration, a line for each group of scanpaths.

    Args:
        paths: by the name of the group, fixations (k, 2) in image pixels.
        durations: by name, seconds; those that are not finite are left out.
        pixels_per_degree: unit of the amplitudes.
    """
    figure = Figure(figsize=(9.6, 3.2), layout="constrained")
    amplitude, duration = figure.add_subplot(1, 3, 1), figure.add_subplot(1, 3, 3)
    direction = figure.add_subplot(1, 3, 2, projection="polar")
    steps = {name: saccades(group) for name, group in paths.items()}
    lengths = {name: np.hypot(*each.T) / pixels_per_degree for name, each in steps.items()}
    draw_distributions(amplitude, lengths, "amplitude of saccades [degrees]")
    draw_directions(direction, steps)
    known = {name: values[np.isfinite(values)] for name, values in durations.items()}
    draw_distributions(
        duration, {name: 1000 * values for name, values in known.items()}, "duration [ms]"
    )
    handles, labels = amplitude.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return figure


def draw_distributions(axes: Axes, groups: Mapping[str, FloatArray], label: str) -> None:
    """Frequency polygons on the same bins, from 0 to where the last group has all but 1 %."""
    tails = [np.quantile(values, 0.99) for values in groups.values() if len(values)]
    edges = np.linspace(0, max(tails, default=1.0), 25)
    for color, (name, values) in zip(COLORS, groups.items(), strict=False):
        if len(values):
            share = np.histogram(values, edges)[0] / len(values)
            axes.plot((edges[1:] + edges[:-1]) / 2, share, color=color, label=name, linewidth=1.4)
    axes.set_xlabel(label)
    axes.set_ylabel("fraction")
    axes.set_ylim(bottom=0)
    grid_axes(axes)


def draw_directions(axes: Axes, groups: Mapping[str, FloatArray]) -> None:
    """Fraction of saccades (n, 2) by direction, on polar axes; up is up on the screen."""
    width = 2 * np.pi / DIRECTIONS
    centers = width * np.arange(DIRECTIONS + 1)
    for color, steps in zip(COLORS, groups.values(), strict=False):
        if len(steps):
            angle = np.arctan2(-steps[:, 1], steps[:, 0])
            bins = np.floor(angle / width + 0.5).astype(np.int64) % DIRECTIONS
            share = np.bincount(bins, minlength=DIRECTIONS) / len(steps)
            axes.plot(centers, np.append(share, share[0]), color=color, linewidth=1.4)
    axes.set_title("direction", fontsize=10)
    axes.set_yticklabels([])
    axes.tick_params(labelsize=8, labelcolor="0.3")
