"""Figures of a map and a trajectory, seen from above."""

from math import sqrt
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from saccade.types import THREE_SIGMA_2D, BoolArray, FloatArray, LandmarkMap, Trajectory
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED, grid_axes

ELLIPSE_SCALE = sqrt(THREE_SIGMA_2D)
"""Semi-axes of a 99.73 % ellipse, in standard deviations."""
ELLIPSE_LABEL = "3 sigma (99.7 %)"
"""Name of such an ellipse in legends."""
ELLIPSE_CORNERS = 48
"""Corners of the polygon that approximates an ellipse."""
LONG_SIDE = 8.8
"""Longer side of the map in inches."""
MIN_SHORT_SIDE = 4.2
"""Minimum length of the shorter side of the map, in inches."""
ELLIPSE: dict[str, Any] = {
    "facecolor": (ORANGE, 0.18),
    "edgecolor": (ORANGE, 0.9),
    "linewidth": 0.9,
    "zorder": 3,
}
"""Style of the covariance ellipses of landmarks."""


def map_figure(
    trajectory: Trajectory,
    landmarks: LandmarkMap,
    dead_reckoning: Trajectory | None = None,
    truth: Trajectory | None = None,
    landmark_truth: LandmarkMap | None = None,
    filtered: Trajectory | None = None,
    lost: BoolArray | None = None,
) -> Figure:
    """The map from above; x to the right, y up, in meters.

    The axes enclose everything except dead reckoning.

    Args:
        trajectory: the estimate.
        landmarks: drawn with ellipses where they have covariances.
        dead_reckoning: from odometry alone, for comparison.
        truth: of the trajectory, in the same frame.
        landmark_truth: of the landmarks, in the same frame.
        filtered: the trajectory of the filter, where the estimate is smoothed.
        lost: (t,) True for poses of a lost robot; the start and the end are marked.
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
    """Marks the first pose of each lost period, and the first pose after it."""
    before = np.concatenate([[False], lost[:-1]])
    for changed, label, marker in ((lost & ~before, "lost", "x"), (before & ~lost, "found", "+")):
        style: dict[str, Any] = {"color": RED, "markersize": 9, "mew": 2, "zorder": 6}
        axes.plot(*trajectory.pose[changed, :2].T, marker, label=label, **style)


def ellipse_outlines(
    centers: FloatArray, covariance: FloatArray | None, magnification: float = 1
) -> FloatArray:
    """Covariance ellipses as polygons (n, `ELLIPSE_CORNERS`, 2); none without covariances.

    Args:
        centers: (n, 2).
        covariance: (n, 2, 2).
        magnification: factor on the axes.
    """
    if covariance is None:
        return np.empty((0, ELLIPSE_CORNERS, 2))
    values, vectors = np.linalg.eigh(covariance)
    roots = vectors * np.sqrt(values.clip(0))[:, None, :]  # (n, 2, 2)
    angle = np.arange(ELLIPSE_CORNERS) * (2 * np.pi / ELLIPSE_CORNERS)
    scale = ELLIPSE_SCALE * magnification
    circle = scale * np.stack([np.cos(angle), np.sin(angle)])  # (2, ELLIPSE_CORNERS)
    return np.asarray(centers[:, None] + (roots @ circle).transpose(0, 2, 1))


def bounds(points: FloatArray, margin: float = 0.04) -> FloatArray:
    """The box (2, 2) around points (n, 2), lowest corner first.

    Args:
        points: points that are not finite are ignored.
        margin: around them, as a fraction of the longer side.
    """
    points = points[np.isfinite(points).all(1)]
    if len(points) == 0:
        return np.array([[-1.0, -1.0], [1.0, 1.0]])
    low, high = points.min(0), points.max(0)
    border = margin * max(float((high - low).max()), 1.0)
    return np.array([low - border, high + border])


def map_axes(axes: Axes, box: FloatArray) -> None:
    """Axes in meters that show a box (2, 2) at equal scales."""
    axes.set(xlim=box[:, 0], ylim=box[:, 1], xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="box")
    grid_axes(axes)
