"""Figure of a filter's consistency: normalized innovations and standard deviations."""

from math import gamma

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saccade.types import FloatArray, Trajectory
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, SIGMAS, quiet_axes

MAX_DOTS = 20_000
"""Observations drawn as dots."""


def innovation_figure(
    time: FloatArray,
    nis: FloatArray,
    dof: int,
    window: int,
    band: tuple[float, float],
    trajectory: Trajectory,
) -> Figure:
    """Normalized innovations over time and their distribution; standard deviations of the pose.

    Args:
        time: (k,) of each observation, ascending.
        nis: (k,) normalized innovation squared; NaN for an observation without update.
        dof: degrees of freedom of each.
        window: observations in the running mean.
        band: 95 % interval of the running mean of a consistent filter.
        trajectory: with covariance, for position and heading.
    """
    used = np.isfinite(nis)
    start = trajectory.time[0] if len(trajectory) else 0.0
    time, nis = time[used] - start, nis[used]
    figure = Figure(figsize=(10.5, 6.4), layout="constrained", dpi=110)
    grid = figure.add_gridspec(2, 4, height_ratios=(1.3, 1))
    _draw_nis(figure.add_subplot(grid[0, :3]), time, nis, window, band)
    _draw_distribution(figure.add_subplot(grid[0, 3]), nis, dof)
    covariance = np.empty((0, 3, 3)) if trajectory.covariance is None else trajectory.covariance
    position = np.sqrt(np.linalg.eigvalsh(covariance[:, :2, :2])[:, -1].clip(0))
    heading = np.degrees(np.sqrt(covariance[:, 2, 2].clip(0)))
    elapsed = trajectory.time[: len(covariance)] - start
    for panel, sigma, title in (
        (grid[1, :2], position, f"{SIGMAS:.0f} sigma of the position, along its major axis [m]"),
        (grid[1, 2:], heading, f"{SIGMAS:.0f} sigma of the heading [degrees]"),
    ):
        axes = figure.add_subplot(panel)
        axes.fill_between(elapsed, SIGMAS * sigma, color=ORANGE, alpha=0.3, linewidth=0)
        axes.plot(elapsed, SIGMAS * sigma, color=ORANGE, linewidth=1.0)
        axes.set_ylim(bottom=0)
        axes.set_xlabel("time since the start")
        _finish(axes, title)
    return figure


def running_mean(values: FloatArray, window: int) -> FloatArray:
    """(k - window + 1,) means of `window` successive values (k,); empty where there are fewer."""
    if len(values) < window:
        return np.empty(0)
    return np.convolve(values, np.full(window, 1 / window), "valid")


def chi_square_density(x: FloatArray, dof: int) -> FloatArray:
    """Density of the chi-square distribution with `dof` degrees of freedom at `x` above 0."""
    scale = 2 ** (dof / 2) * gamma(dof / 2)
    return np.asarray(x ** (dof / 2 - 1) * np.exp(-x / 2) / scale)


def _draw_nis(
    axes: Axes, time: FloatArray, nis: FloatArray, window: int, band: tuple[float, float]
) -> None:
    step = len(nis) // MAX_DOTS + 1
    axes.semilogy(time[::step], nis[::step].clip(1e-3), ".", color=GRAY, markersize=2, alpha=0.4)
    axes.axhspan(*band, color=GREEN, alpha=0.35, linewidth=0, label="95 % of a consistent filter")
    if len(mean := running_mean(nis, window)):
        axes.plot(time[window - 1 :], mean, color=BLUE, linewidth=1.4, label=f"mean of {window}")
    axes.minorticks_off()
    axes.set_ylim(1e-3, max(30.0, 2 * float(nis.max(initial=1.0))))
    axes.legend(loc="lower right", ncols=2, frameon=False, fontsize=9)
    _finish(axes, "normalized innovation squared of each observation")


def _draw_distribution(axes: Axes, nis: FloatArray, dof: int) -> None:
    limit = 6.0 * dof
    edges = np.linspace(0, limit, 37)
    if len(nis):
        weights = np.full(len(nis), 1 / len(nis) / (edges[1] - edges[0]))
        axes.hist(nis.clip(max=limit), edges.tolist(), weights=weights, color=GRAY, alpha=0.45)
    x = np.linspace(limit / 400, limit, 200)
    axes.plot(x, chi_square_density(x, dof), color=GREEN, linewidth=1.6, label="consistent")
    axes.legend(loc="upper right", frameon=False, fontsize=9)
    axes.set_yticks([])
    _finish(axes, "their distribution")


def _finish(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left", fontsize=10, color="0.2")
    axes.margins(x=0.01)
    quiet_axes(axes)
