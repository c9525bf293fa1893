"""Figures of evaluations: scores of models, distributions of scanpaths, errors of trajectories."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saccade.types import FloatArray
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED, grid_axes

COLUMN_WIDTH = 3.5
"""Inches: 89 mm, a single column of most journals."""
LONGEST = 24
"""Characters of a model's name for which there is room; of a longer one the end is kept."""
GROUP_COLORS = ("black", GRAY, BLUE, GREEN, ORANGE, RED)
"""Colors of the groups of scanpaths, in their order."""
DIRECTIONS = 16
"""Bins of directions."""
ESTIMATE_COLORS = (BLUE, ORANGE, RED, GRAY)
"""Colors of estimated trajectories, in turn."""


class Bar(NamedTuple):
    """A score of a model with its interval."""

    mean: float
    low: float
    high: float


def fixation_score_figure(
    scores: Mapping[str, Mapping[str, Bar]], references: Sequence[str] = ()
) -> Figure:
    """Each score in a panel of its own, a point with its interval for each model.

    Args:
        scores: by title of the score and name of the model; the first model is on top.
        references: names of the models that are drawn in gray.
    """
    models = list(dict.fromkeys(name for of_models in scores.values() for name in of_models))
    labels = [n if len(n) <= LONGEST else f"...{n[3 - LONGEST :]}" for n in models]
    rows = -(-len(scores) // 2)
    height = rows * (0.55 + 0.17 * len(models))
    figure = Figure(figsize=(COLUMN_WIDTH, height), layout="constrained", dpi=300)
    panels = figure.subplots(rows, 2, squeeze=False, sharey=True).ravel()
    for axes, (title, of_models) in zip(panels, scores.items(), strict=False):
        grid_axes(axes)
        for y, name in enumerate(models):
            if name in of_models:
                mean, low, high = of_models[name]
                color = GRAY if name in references else BLUE
                axes.plot([low, high], [y, y], color=color, linewidth=1.2)
                axes.plot([mean], [y], "o", color=color, markersize=3)
        axes.set_title(title, fontsize=7, pad=2)
        axes.set_yticks(range(len(models)), labels)
        axes.set_ylim(len(models) - 0.4, -0.6)
        axes.tick_params(labelsize=6, length=0)
    for axes in panels[len(scores) :]:
        axes.set_axis_off()
    return figure


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
        durations: by name, seconds; values that are not finite are omitted.
        pixels_per_degree: unit of the amplitudes.
    """
    figure = Figure(figsize=(9.6, 3.2), layout="constrained")
    amplitude, duration = figure.add_subplot(1, 3, 1), figure.add_subplot(1, 3, 3)
    steps = {name: saccades(group) for name, group in paths.items()}
    lengths = {name: np.hypot(*each.T) / pixels_per_degree for name, each in steps.items()}
    draw_distributions(amplitude, lengths, "amplitude of saccades [degrees]")
    draw_directions(figure.add_subplot(1, 3, 2, projection="polar"), steps)
    known = {name: 1000 * values[np.isfinite(values)] for name, values in durations.items()}
    draw_distributions(duration, known, "duration [ms]")
    handles, labels = amplitude.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return figure


def draw_distributions(axes: Axes, groups: Mapping[str, FloatArray], label: str) -> None:
    """Frequency polygons on the same bins, from 0 to where the last group has all but 1 %."""
    tails = [np.quantile(values, 0.99) for values in groups.values() if len(values)]
    edges = np.linspace(0, max(tails, default=1.0), 25)
    for color, (name, values) in zip(GROUP_COLORS, groups.items(), strict=False):
        if len(values):
            fraction = np.histogram(values, edges)[0] / len(values)
            axes.plot((edges[1:] + edges[:-1]) / 2, fraction, color=color, label=name, lw=1.4)
    axes.set(xlabel=label, ylabel="fraction", ylim=(0, None))
    grid_axes(axes)


def draw_directions(axes: Axes, groups: Mapping[str, FloatArray]) -> None:
    """Fraction of saccades (n, 2) by direction, on polar axes; up is up on the screen."""
    width = 2 * np.pi / DIRECTIONS
    for color, steps in zip(GROUP_COLORS, groups.values(), strict=False):
        if len(steps):
            angle = np.arctan2(-steps[:, 1], steps[:, 0])
            bins = np.floor(angle / width + 0.5).astype(np.int64) % DIRECTIONS
            fraction = np.bincount(bins, minlength=DIRECTIONS) / len(steps)
            closed = np.append(fraction, fraction[0])
            axes.plot(width * np.arange(DIRECTIONS + 1), closed, color=color, linewidth=1.4)
    axes.set_title("direction", fontsize=10)
    axes.set_yticklabels([])
    axes.tick_params(labelsize=8, labelcolor="0.3")


@dataclass(frozen=True, eq=False)
class ComparedTrajectory:
    """An estimate of n positions beside the truth."""

    name: str
    """Name in the legend."""
    time: FloatArray
    """(n,) seconds."""
    position: FloatArray
    """(n, 3) meters, aligned with the truth."""
    truth: FloatArray
    """(n, 3) meters, at the same times."""
    errors: Mapping[str, FloatArray]
    """(n,) meters, by the name of the alignment."""


def trajectory_figure(trajectories: Sequence[ComparedTrajectory]) -> Figure:
    """Trajectories from above, and one panel for each kind of error over time.

    Args:
        trajectories: at least one; all with the same kinds of errors.
    """
    kinds = list(trajectories[0].errors)
    figure = Figure(figsize=(12.0, 5.2), layout="constrained", dpi=110)
    grid = figure.add_gridspec(len(kinds), 2)
    above = figure.add_subplot(grid[:, 0], xlabel="x [m]", ylabel="y [m]")
    above.set_aspect("equal", adjustable="datalim")
    longest = max(trajectories, key=lambda each: len(each.time))
    above.plot(*longest.truth[:, :2].T, color=GREEN, lw=2.6, alpha=0.45, label="truth")
    panels = [figure.add_subplot(grid[row, 1]) for row in range(len(kinds))]
    start = min(float(each.time[0]) for each in trajectories)
    for each, color in zip(trajectories, cycle(ESTIMATE_COLORS), strict=False):
        above.plot(*each.position[:, :2].T, color=color, lw=1.1, label=each.name)
        for axes, kind in zip(panels, kinds, strict=True):
            axes.plot(each.time - start, each.errors[kind], color=color, lw=0.9)
    for axes, kind in zip(panels, kinds, strict=True):
        axes.set_title(f"position error, {kind} [m]", loc="left", fontsize=10, color="0.2")
        axes.set(xlabel="seconds since the start", ylim=(0, None))
    for axes in (above, *panels):
        grid_axes(axes)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, handlelength=1.6)
    return figure
