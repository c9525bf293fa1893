"""Figure of landmark selections: scores with confidence intervals at several budgets."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saccade.types import FloatArray
from saccade.viewing.style import GRAY, HEAT

ROW_HEIGHT = 0.36
"""Inches, of the row of a selection."""
LEGEND = "landmarks tracked at a time; bars are 95 % intervals of the mean"


class Panel(NamedTuple):
    """One score of all selections."""

    title: str
    table: FloatArray
    """(drives, budgets, selections, 3) mean, lower and upper end of its interval; NaN for none."""
    limit: float = np.inf
    """The largest possible score."""


def selection_figure(
    panels: Sequence[Panel],
    drives: Sequence[str],
    budgets: Sequence[int],
    selections: Sequence[str],
    order: Sequence[int],
    reference: int | None,
) -> Figure:
    """A row of panels for each drive, in each a line for each selection with a dot per budget.

    Args:
        panels: the scores.
        drives: names of the first axis of their tables.
        budgets: of the second.
        selections: of the third.
        order: indices of the selections, from the top.
        reference: index of the selection whose mean over the budgets is marked, if any.
    """
    size = (2.5 + 2.15 * len(panels), 1.1 + len(drives) * (ROW_HEIGHT * len(selections) + 0.5))
    figure = Figure(figsize=size, layout="constrained", dpi=130)
    grid = figure.subplots(len(drives), len(panels), squeeze=False, sharey=True)
    colors = colormaps[HEAT](np.linspace(0.05, 0.9, len(budgets)))
    offsets = 0.6 * ((np.arange(len(budgets)) + 0.5) / len(budgets) - 0.5)
    for (d, p), axes in np.ndenumerate(grid):
        table = panels[p].table[d]
        for scores, offset, budget, color in zip(table, offsets, budgets, colors, strict=True):
            mean, low, high = scores[list(order)].T
            y = np.arange(len(order)) + offset
            axes.hlines(y, low, high, color=color, linewidth=1.6, alpha=0.75)
            axes.plot(mean, y, "o", color=color, markersize=4.2, label=str(budget))
        if reference is not None:
            means = table[:, reference, 0]
            if np.isfinite(means).any():
                style = {"color": GRAY, "linewidth": 1.0, "linestyle": (0, (4, 3)), "zorder": 0.5}
                axes.axvline(np.nanmean(means), **style)
        _finish(axes, panels[p].title if d == 0 else "", len(selections), panels[p].limit)
    for axes, drive in zip(grid[:, 0], drives, strict=True):
        axes.set_yticks(range(len(selections)), [selections[i] for i in order])
        axes.set_ylabel(drive, fontsize=11, fontweight="bold", labelpad=10)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    dashed = "" if reference is None else f"; dashed: {selections[reference]} over all"
    figure.legend(
        handles,
        labels,
        title=LEGEND + dashed,
        loc="outside lower center",
        title_fontsize=10,
        ncols=len(budgets),
        frameon=False,
    )
    return figure


def _finish(axes: Axes, title: str, rows: int, limit: float) -> None:
    low, high = axes.get_xlim()
    if high >= limit:
        axes.set_xlim(min(low, 0.9 * limit), 1.005 * limit)
    finish_panel(axes, title, rows, size=11, ticks=5)


def finish_panel(axes: Axes, title: str, rows: int, *, size: float, ticks: int) -> None:
    """Title, striped rows from the top, and no frame; at most so many ticks."""
    axes.set_title(title, fontsize=size, pad=8)
    axes.set_ylim(rows - 0.5, -0.5)
    for i in range(0, rows, 2):
        axes.axhspan(i - 0.5, i + 0.5, color=GRAY, alpha=0.09, linewidth=0)
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", labelsize=8.5)
    axes.grid(axis="x", color=GRAY, alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.locator_params(axis="x", nbins=ticks)
