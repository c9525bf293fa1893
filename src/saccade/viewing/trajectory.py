"""Figure of estimated trajectories, the truth, and the errors over time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from saccade.types import FloatArray
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED, grid_axes

COLORS = (BLUE, ORANGE, RED, GRAY)
"""Of the estimates, in turn."""


@dataclass(frozen=True, eq=False)
class ComparedTrajectory:
    """An estimate of n positions beside the truth."""

    name: str
    """For the legend."""
    time: FloatArray
    """(n,) seconds."""
    position: FloatArray
    """(n, 3) metres, aligned with the truth."""
    truth: FloatArray
    """(n, 3) metres, at the same times."""
    errors: Mapping[str, FloatArray]
    """(n,) metres, by the name of the alignment."""


def trajectory_figure(trajectories: Sequence[ComparedTrajectory]) -> Figure:
    """Trajectories from above, and one panel for each kind of error over time.

    Args:
        trajectories: at least one; all with the same kinds of errors.
    """
    kinds = list(trajectories[0].errors)
    figure = Figure(figsize=(12.0, 5.2), layout="constrained", dpi=110)
    grid = figure.add_gridspec(len(kinds), 2)
    above = figure.add_subplot(grid[:, 0])
    above.set(xlabel="x [m]", ylabel="y [m]")
    above.set_aspect("equal", adjustable="datalim")
    longest = max(trajectories, key=lambda each: len(each.time))
    above.plot(*longest.truth[:, :2].T, color=GREEN, lw=2.6, alpha=0.45, label="truth")
    for number, each in enumerate(trajectories):
        color = COLORS[number % len(COLORS)]
        above.plot(*each.position[:, :2].T, color=color, lw=1.1, label=each.name)
    grid_axes(above)
    start = min(float(each.time[0]) for each in trajectories)
    for row, kind in enumerate(kinds):
        axes = figure.add_subplot(grid[row, 1])
        for number, each in enumerate(trajectories):
            axes.plot(
                each.time - start, each.errors[kind], color=COLORS[number % len(COLORS)], lw=0.9
            )
        axes.set_title(f"position error, {kind} [m]", loc="left", fontsize=10, color="0.2")
        axes.set_xlabel("seconds since the start")
        axes.set_ylim(bottom=0)
        grid_axes(axes)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, handlelength=1.6)
    return figure
