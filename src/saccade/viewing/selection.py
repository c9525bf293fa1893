"""Choices compared side by side: each score of each, with its interval, at several budgets."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saccade.types import FloatArray
from saccade.viewing.style import GRAY, HEAT

ROW = 0.36
"""Inches of a choice."""
LEGEND = "new landmarks per frame; bars are 95 % intervals of the mean"


class Panel(NamedTuple):
    """One score of all choices."""

    title: str
    table: FloatArray
    """(worlds, budgets, choices, 3) mean, lower and upper end of its interval; NaN for none."""
    most: float = np.inf
    """The largest that the score can be."""


def choice_figure(
    panels: Sequence[Panel],
    worlds: Sequence[str],
    budgets: Sequence[int],
    choices: Sequence[str],
    order: Sequence[int],
    reference: int | None,
) -> Figure:
    """A row of panels for each world, in each a line for each choice, on it a dot per budget.

    Args:
        panels: the scores.
        worlds: names of the first axis of their tables.
        budgets: of the second.
        choices: of the third.
        order: indices of the choices, from the top.
        reference: index of the choice whose mean over the budgets is marked, if any.
    """
    size = (2.5 + 2.15 * len(panels), 1.1 + len(worlds) * (ROW * len(choices) + 0.5))
    figure = Figure(figsize=size, layout="constrained", dpi=130)
    grid = figure.subplots(len(worlds), len(panels), squeeze=False, sharey=True)
    colors = colormaps[HEAT](np.linspace(0.05, 0.9, len(budgets)))
    for w, world in enumerate(worlds):
        for p, panel in enumerate(panels):
            axes: Axes = grid[w, p]
            for b, color in enumerate(colors):
                _draw_dots(axes, panel.table[w, b, list(order)], b, len(budgets), tuple(color))
            if reference is not None:
                _draw_usual(axes, panel.table[w, :, reference, 0])
            _limit(axes, panel.most)
            _finish(axes, panel.title if w == 0 else "", len(choices))
        grid[w, 0].set_yticks(range(len(choices)), [choices[i] for i in order])
        grid[w, 0].set_ylabel(world, fontsize=11, fontweight="bold", labelpad=10)
    handles, _ = grid[0, 0].get_legend_handles_labels()
    figure.legend(
        handles,
        list(map(str, budgets)),
        title=LEGEND if reference is None else f"{LEGEND}; dashed: {choices[reference]} over all",
        loc="outside lower center",
        title_fontsize=10,
        ncols=len(budgets),
        frameon=False,
    )
    return figure


def _draw_dots(
    axes: Axes, scores: FloatArray, budget: int, budgets: int, color: tuple[float, ...]
) -> None:
    """Scores (choices, 3) at one budget."""
    offset = 0.6 * ((budget + 0.5) / budgets - 0.5)
    y = np.arange(len(scores)) + offset
    mean, low, high = scores.T
    axes.hlines(y, low, high, color=color, linewidth=1.6, alpha=0.75)
    axes.plot(mean, y, "o", color=color, markersize=4.2, label=str(budget))


def _draw_usual(axes: Axes, scores: FloatArray) -> None:
    """A line at the mean of the scores (budgets,)."""
    found = scores[np.isfinite(scores)]
    if len(found):
        axes.axvline(found.mean(), color=GRAY, linewidth=1.0, linestyle=(0, (4, 3)), zorder=0.5)


def _limit(axes: Axes, most: float) -> None:
    """Show nothing beyond the largest value that there can be, and not too little before it."""
    low, high = axes.get_xlim()
    if high >= most:
        axes.set_xlim(min(low, 0.9 * most), 1.005 * most)


def _finish(axes: Axes, title: str, choices: int) -> None:
    axes.set_title(title, fontsize=11, pad=8)
    axes.set_ylim(choices - 0.5, -0.5)
    for i in range(0, choices, 2):
        axes.axhspan(i - 0.5, i + 0.5, color=GRAY, alpha=0.09, linewidth=0)
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", labelsize=8.5)
    axes.grid(axis="x", color=GRAY, alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.locator_params(axis="x", nbins=5)
