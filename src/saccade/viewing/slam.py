"""Figures of a SLAM run: its map, and the consistency of its filter."""

from math import gamma, sqrt
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from saccade.types import THREE_SIGMA_2D, BoolArray, FloatArray, LandmarkMap, Trajectory
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED, SIGMAS, grid_axes

ELLIPSE_SCALE, ELLIPSE_LABEL = sqrt(THREE_SIGMA_2D), "3 sigma (99.7 %)"
"""Semi-axes of an ellipse that holds 99.73 %, in standard deviations, and its name in legends."""
CORNERS = 48
"""Corners of the polygon that approximates an ellipse."""
LONG_SIDE, MIN_SHORT_SIDE = 8.8, 4.2
"""Inches: the longer side of the map, and the least of its shorter side."""
ELLIPSE: dict[str, Any] = {
    "facecolor": (ORANGE, 0.18),
    "edgecolor": (ORANGE, 0.9),
    "linewidth": 0.9,
    "zorder": 3,
}
"""Style of the covariance ellipses of landmarks."""
MAX_DOTS = 20_000
"""Observations drawn as dots."""


def map_figure(
    trajectory: Trajectory,
    landmarks: LandmarkMap,
    dead_reckoning: Trajectory | None = None,
    truth: Trajectory | None = None,
    landmark_truth: LandmarkMap | None = None,
    filtered: Trajectory | None = None,
    lost: BoolArray | None = None,
) -> Figure:
    """The map from above; x to the right, y up, in metres.

    The axes enclose everything but dead reckoning, which may leave them.

    Args:
        trajectory: the estimate.
        landmarks: drawn with ellipses where they have covariances.
        dead_reckoning: from odometry alone, for comparison.
        truth: of the trajectory, in the same frame.
        landmark_truth: of the landmarks, in the same frame.
        filtered: the trajectory of the filter, where the estimate is smoothed.
        lost: (t,) at which poses the robot was lost: where that began and ended is marked.
    """
    outlines = ellipse_outlines(landmarks.xy, landmarks.covariance)
    enclosed = [trajectory.pose[:, :2], landmarks.xy, outlines.reshape(-1, 2)]
    enclosed += [] if truth is None else [truth.pose[:, :2]]
    enclosed += [] if landmark_truth is None else [landmark_truth.xy]
    box = bounds(np.concatenate(enclosed))
    width, height = (box[1] - box[0]).tolist()
    scale = LONG_SIDE / max(width, height)
    size = max(width * scale, MIN_SHORT_SIDE) + 0.6, max(height * scale, MIN_SHORT_SIDE) + 0.9
    figure = Figure(figsize=size, layout="constrained", dpi=110)
    axes = figure.subplots()
    map_axes(axes, box)
    lines: tuple[tuple[Trajectory | None, str, dict[str, Any]], ...] = (
        (dead_reckoning, "odometry alone", {"color": GRAY, "ls": (0, (4, 3)), "lw": 0.8}),
        (truth, "truth", {"color": GREEN, "lw": 2.6, "alpha": 0.45}),
        (filtered, "filter", {"color": BLUE, "lw": 0.7, "alpha": 0.4}),
        (trajectory, "estimate" if filtered is None else "smoothed", {"color": BLUE, "lw": 1.3}),
    )
    for each, label, style in lines:
        if each is not None:
            axes.plot(*each.pose[:, :2].T, label=label, **style)
    if len(trajectory):
        axes.plot(*trajectory.pose[0, :2], "s", color=RED, markersize=6, label="start", zorder=4)
    if lost is not None and lost.any():
        _mark_lost(axes, trajectory, lost)
    if landmark_truth is not None:
        circle: dict[str, Any] = {"facecolors": "none", "edgecolors": GREEN, "s": 60, "zorder": 4}
        axes.scatter(*landmark_truth.xy.T, **circle, label="true landmarks")
    if len(outlines):
        ellipses = PolyCollection([*outlines], **ELLIPSE, label=ELLIPSE_LABEL)
        axes.add_collection(ellipses, autolim=False)
    label = f"{len(landmarks)} landmarks"
    axes.plot(*landmarks.xy.T, ".", color="black", markersize=4, zorder=5, label=label)
    columns = int(figure.get_figwidth() / 1.85)
    figure.legend(loc="outside lower center", ncols=columns, frameon=False, handlelength=1.6)
    return figure


def _mark_lost(axes: Axes, trajectory: Trajectory, lost: BoolArray) -> None:
    """Mark the first pose of each time that the robot was lost, and the first one after it."""
    before = np.concatenate([[False], lost[:-1]])
    for changed, label, marker in ((lost & ~before, "lost", "x"), (before & ~lost, "found", "+")):
        style: dict[str, Any] = {"color": RED, "markersize": 9, "mew": 2, "zorder": 6}
        axes.plot(*trajectory.pose[changed, :2].T, marker, label=label, **style)


def ellipse_outlines(
    centers: FloatArray, covariance: FloatArray | None, magnification: float = 1
) -> FloatArray:
    """Covariance ellipses as polygons (n, `CORNERS`, 2); none without covariances.

    Args:
        centers: (n, 2).
        covariance: (n, 2, 2).
        magnification: factor on the axes.
    """
    if covariance is None:
        return np.empty((0, CORNERS, 2))
    values, vectors = np.linalg.eigh(covariance)
    roots = vectors * np.sqrt(values.clip(0))[:, None, :]  # (n, 2, 2)
    angle = np.arange(CORNERS) * (2 * np.pi / CORNERS)
    scale = ELLIPSE_SCALE * magnification
    circle = scale * np.stack([np.cos(angle), np.sin(angle)])  # (2, CORNERS)
    return np.asarray(centers[:, None] + (roots @ circle).transpose(0, 2, 1))


def bounds(points: FloatArray, margin: float = 0.04) -> FloatArray:
    """The box (2, 2) around points (n, 2), lowest corner first.

    Args:
        points: those that are not finite are left out.
        margin: around them, as a fraction of the longer side.
    """
    points = points[np.isfinite(points).all(1)]
    if len(points) == 0:
        return np.array([[-1.0, -1.0], [1.0, 1.0]])
    low, high = points.min(0), points.max(0)
    border = margin * max(float((high - low).max()), 1.0)
    return np.array([low - border, high + border])


def map_axes(axes: Axes, box: FloatArray) -> None:
    """Axes in metres that show a box (2, 2) at equal scales."""
    axes.set(xlim=box[:, 0], ylim=box[:, 1], xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="box")
    grid_axes(axes)


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
    clocked = not np.array_equal(trajectory.time, np.arange(len(trajectory)))
    elapsed_label = "time since the start [s]" if clocked else "poses since the start"
    nis_axes = figure.add_subplot(grid[0, :3])
    _draw_nis(nis_axes, time, nis, window, band)
    nis_axes.set_xlabel(elapsed_label)
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
        axes.set_xlabel(elapsed_label)
        _finish(axes, title)
    return figure


def running_mean(values: FloatArray, window: int) -> FloatArray:
    """(k - window + 1,) means of `window` successive values (k,); empty where there are fewer."""
    if len(values) < window:
        return np.empty(0)
    return np.convolve(values, np.full(window, 1 / window), "valid")


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
    axes.set_ylabel("NIS (no unit)")
    axes.legend(loc="lower right", ncols=2, frameon=False, fontsize=9)
    _finish(axes, "normalized innovation squared of each observation")


def _draw_distribution(axes: Axes, nis: FloatArray, dof: int) -> None:
    """Histogram of the NIS, and the chi-square density of a consistent filter."""
    limit = 6.0 * dof
    edges = np.linspace(0, limit, 37)
    if len(nis):
        weights = np.full(len(nis), 1 / len(nis) / (edges[1] - edges[0]))
        axes.hist(nis.clip(max=limit), edges.tolist(), weights=weights, color=GRAY, alpha=0.45)
    x = np.linspace(limit / 400, limit, 200)
    density = x ** (dof / 2 - 1) * np.exp(-x / 2) / (2 ** (dof / 2) * gamma(dof / 2))
    axes.plot(x, density, color=GREEN, linewidth=1.6, label="consistent")
    axes.legend(loc="upper right", frameon=False, fontsize=9)
    axes.set_yticks([])
    axes.set_xlabel("normalized innovation squared")
    axes.set_ylabel("density")
    _finish(axes, "their distribution")


def _finish(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left", fontsize=10, color="0.2")
    axes.margins(x=0.01)
    grid_axes(axes)
