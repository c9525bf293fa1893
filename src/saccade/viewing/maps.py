"""Figures of maps: trajectory, landmarks and their uncertainty."""

from math import sqrt
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from saccade.types import THREE_SIGMA_2D, FloatArray, LandmarkMap, Trajectory
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED, quiet_axes

ELLIPSE_SCALE = sqrt(THREE_SIGMA_2D)
"""Semi-axes of an ellipse that holds 99.73 %, in standard deviations."""
ELLIPSE_LABEL = "3 sigma (99.7 %)"
CORNERS = 48
"""Of the polygon that approximates an ellipse."""
LONG_SIDE = 8.8
"""Inches, of the map's longer side."""
MIN_SHORT_SIDE = 4.2
"""Inches, of its shorter side at least."""
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
    """
    outlines = ellipse_outlines(landmarks.xy, landmarks.covariance)
    enclosed = [trajectory.pose[:, :2], landmarks.xy, outlines.reshape(-1, 2)]
    enclosed += [] if truth is None else [truth.pose[:, :2]]
    enclosed += [] if landmark_truth is None else [landmark_truth.xy]
    box = bounds(np.concatenate(enclosed))
    figure = Figure(figsize=_size(box), layout="constrained", dpi=110)
    axes = figure.subplots()
    map_axes(axes, box)
    dashed = (0, (4, 3))
    _draw(axes, dead_reckoning, "odometry alone", color=GRAY, linestyle=dashed, linewidth=0.8)
    _draw(axes, truth, "truth", color=GREEN, linewidth=2.6, alpha=0.45)
    _draw(axes, filtered, "filter", color=BLUE, linewidth=0.7, alpha=0.4)
    label = "estimate" if filtered is None else "smoothed"
    _draw(axes, trajectory, label, color=BLUE, linewidth=1.3)
    if len(trajectory):
        axes.plot(*trajectory.pose[0, :2], "s", color=RED, markersize=6, label="start", zorder=4)
    if landmark_truth is not None:
        circle: dict[str, Any] = {"facecolors": "none", "edgecolors": GREEN, "s": 60, "zorder": 4}
        axes.scatter(*landmark_truth.xy.T, **circle, label="true landmarks")
    axes.add_collection(PolyCollection([*outlines], **ELLIPSE), autolim=False)
    label = f"{len(landmarks)} landmarks, {ELLIPSE_LABEL}"
    axes.plot(*landmarks.xy.T, ".", color="black", markersize=4, zorder=5, label=label)
    columns = int(figure.get_figwidth() / 1.85)
    figure.legend(loc="outside lower center", ncols=columns, frameon=False, handlelength=1.6)
    return figure


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
    """The box (2, 2) around points (n, 2), lowest corner first, a margin around it."""
    points = points[np.isfinite(points).all(1)]
    if len(points) == 0:
        return np.array([[-1.0, -1.0], [1.0, 1.0]])
    low, high = points.min(0), points.max(0)
    border = margin * max(float((high - low).max()), 1.0)
    return np.array([low - border, high + border])


def map_axes(axes: Axes, box: FloatArray) -> None:
    """Axes in metres that show a box (2, 2) at equal scales."""
    axes.set_xlim(*box[:, 0])
    axes.set_ylim(*box[:, 1])
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    quiet_axes(axes)


def _size(box: FloatArray) -> tuple[float, float]:
    width, height = (box[1] - box[0]).tolist()
    scale = LONG_SIDE / max(width, height)
    return max(width * scale, MIN_SHORT_SIDE) + 0.6, max(height * scale, MIN_SHORT_SIDE) + 0.9


def _draw(axes: Axes, trajectory: Trajectory | None, label: str, **style: Any) -> None:
    if trajectory is not None:
        axes.plot(*trajectory.pose[:, :2].T, label=label, **style)
