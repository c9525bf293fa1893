"""Figure of gaze policies: scores with confidence intervals, and the entropy of the pose."""

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saccade.types import FloatArray
from saccade.viewing.selection import Panel, finish_panel
from saccade.viewing.style import GRAY

ROW_HEIGHT = 0.34
"""Inches, of the row of a policy."""


def gaze_figure(
    panels: Sequence[Panel], worlds: Sequence[str], policies: Sequence[str], entropy: FloatArray
) -> Figure:
    """A row of panels for each world, in each a dot with its interval for each policy.

    The last panel of a row shows the entropy of the pose over the drive.

    Args:
        panels: the scores; their tables are (worlds, policies, 3).
        worlds: names of the first axis.
        policies: of the second.
        entropy: (worlds, policies, seeds, times) in nats.
    """
    size = (4.5 + 1.7 * len(panels), 1.2 + len(worlds) * (ROW_HEIGHT * len(policies) + 0.6))
    figure = Figure(figsize=size, layout="constrained", dpi=130)
    columns = len(panels) + 1
    widths = [*([1.0] * len(panels)), 1.9]
    grid = figure.subplots(len(worlds), columns, squeeze=False, width_ratios=widths)
    colors = colormaps["tab10"](np.arange(len(policies)) % 10)
    for w, world in enumerate(worlds):
        for p, panel in enumerate(panels):
            axes = grid[w, p]
            mean, low, high = panel.table[w].T
            rows = np.arange(len(policies))
            axes.hlines(rows, low, high, color=colors, linewidth=1.8, alpha=0.75)
            axes.scatter(mean, rows, color=colors, s=22, zorder=3)
            names = policies if p == 0 else [""] * len(policies)
            axes.set_yticks(rows, names)
            finish_panel(axes, panel.title if w == 0 else "", len(policies), size=10.5, ticks=4)
        grid[w, 0].set_ylabel(world, fontsize=11, fontweight="bold", labelpad=10)
        _draw_entropy(grid[w, -1], entropy[w], policies, colors)
    grid[0, -1].set_title("entropy of the pose over the drive", fontsize=10.5, pad=8)
    grid[-1, -1].set_xlabel("share of the frames [%]", fontsize=9)
    figure.supxlabel("dots: means over the seeds; bars: their 95 % intervals", fontsize=9.5)
    return figure


def _draw_entropy(
    axes: Axes, entropy: FloatArray, policies: Sequence[str], colors: FloatArray
) -> None:
    """Mean over the seeds of each policy."""
    share = np.linspace(0, 100, entropy.shape[2])
    for series, policy, color in zip(entropy, policies, colors, strict=True):
        axes.plot(share[1:], np.nanmean(series, axis=0)[1:], color=color, label=policy)
    axes.set_ylabel("nats", fontsize=9)
    axes.tick_params(labelsize=8.5)
    axes.grid(color=GRAY, alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
