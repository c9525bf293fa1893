"""Pictures of maps: where the robot drove, where the landmarks are, how sure that is."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from saccade.types import FloatArray, LandmarkMap, Trajectory
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED

SIGMAS = 3.0
"""The ellipses enclose this many standard deviations."""
CORNERS = 48
"""Of the polygon that stands for an ellipse."""
LONGER = 8.8
"""Inches, of the map's longer side."""
SHORTEST = 4.2
"""Inches, of its shorter side at least."""
ELLIPSE: dict[str, Any] = {
    "facecolor": (ORANGE, 0.18),
    "edgecolor": (ORANGE, 0.9),
    "linewidth": 0.9,
    "zorder": 3,
}
"""How an ellipse of uncertainty is drawn."""


def map_figure(
    trajectory: Trajectory,
    landmarks: LandmarkMap,
    dead_reckoning: Trajectory | None = None,
    truth: Trajectory | None = None,
    landmark_truth: LandmarkMap | None = None,
    filtered: Trajectory | None = None,
) -> Figure:
    """The map from above; x to the right, y up, in metres.

    The picture is as large as the map; odometry that goes astray leaves it.

    Args:
        trajectory: the estimate.
        landmarks: with covariance, to see their ellipses.
        dead_reckoning: the same drive from odometry alone, for comparison.
        truth: where the robot really was, in the same frame.
        landmark_truth: where the landmarks really are, in the same frame.
        filtered: the drive as it was believed on the way, where the estimate is smoothed.
    """
    outlines = ellipse_outlines(landmarks.xy, landmarks.covariance)
    inside = [trajectory.pose[:, :2], landmarks.xy, outlines.reshape(-1, 2)]
    inside += [] if truth is None else [truth.pose[:, :2]]
    inside += [] if landmark_truth is None else [landmark_truth.xy]
    box = bounds(np.concatenate(inside))
    figure = Figure(figsize=_size(box), layout="constrained", dpi=110)
    axes = figure.subplots()
    map_axes(axes, box)
    if dead_reckoning is not None:
        _draw_drive(axes, dead_reckoning, "odometry alone", GRAY, (0, (4, 3)), 0.8)
    if truth is not None:
        _draw_drive(axes, truth, "truth", GREEN, "-", 2.6, alpha=0.45)
    if filtered is not None:
        _draw_drive(axes, filtered, "filter", BLUE, "-", 0.7, alpha=0.4)
    label = "estimate" if filtered is None else "smoothed"
    _draw_drive(axes, trajectory, label, BLUE, "-", 1.3)
    if len(trajectory):
        axes.plot(*trajectory.pose[0, :2], "s", color=RED, markersize=6, label="start", zorder=4)
    if landmark_truth is not None:
        axes.scatter(
            landmark_truth.xy[:, 0],
            landmark_truth.xy[:, 1],
            s=60,
            facecolors="none",
            edgecolors=GREEN,
            zorder=4,
            label="true landmarks",
        )
    axes.add_collection(PolyCollection([*outlines], **ELLIPSE), autolim=False)
    axes.plot(
        *landmarks.xy.T,
        ".",
        color="black",
        markersize=4,
        zorder=5,
        label=f"{len(landmarks)} landmarks, {SIGMAS:.0f} sigma",
    )
    columns = int(figure.get_figwidth() / 1.85)
    figure.legend(loc="outside lower center", ncols=columns, frameon=False, handlelength=1.6)
    return figure


def ellipse_outlines(
    centers: FloatArray, covariance: FloatArray | None, sigmas: float = SIGMAS
) -> FloatArray:
    """The ellipses of covariances as polygons (n, `CORNERS`, 2); none without covariances.

    Args:
        centers: (n, 2).
        covariance: (n, 2, 2).
        sigmas: standard deviations that they enclose.
    """
    if covariance is None:
        return np.empty((0, CORNERS, 2))
    values, vectors = np.linalg.eigh(covariance)
    roots = vectors * np.sqrt(values.clip(0))[:, None, :]  # (n, 2, 2)
    angle = np.arange(CORNERS) * (2 * np.pi / CORNERS)
    circle = sigmas * np.stack([np.cos(angle), np.sin(angle)])  # (2, CORNERS)
    return np.asarray(centers[:, None] + (roots @ circle).transpose(0, 2, 1))


def bounds(points: FloatArray, margin: float = 0.04) -> FloatArray:
    """The box (2, 2) around points (n, 2), lowest corner first, a margin around it."""
    points = points[np.isfinite(points).all(1)]
    if len(points) == 0:
        return np.array([[-1.0, -1.0], [1.0, 1.0]])
    low, high = points.min(0), points.max(0)
    wide = margin * max(float((high - low).max()), 1.0)
    return np.array([low - wide, high + wide])


def map_axes(axes: Axes, box: FloatArray) -> None:
    """Axes in metres that show a box (2, 2), both directions alike."""
    axes.set_xlim(*box[:, 0])
    axes.set_ylim(*box[:, 1])
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    quiet_axes(axes)


def quiet_axes(axes: Axes) -> None:
    """A light grid behind, and no box around."""
    axes.grid(color="0.92", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(color="0.7", labelcolor="0.3", labelsize=9)
    for side in axes.spines.values():
        side.set_visible(False)


def _size(box: FloatArray) -> tuple[float, float]:
    wide, high = (box[1] - box[0]).tolist()
    scale = LONGER / max(wide, high)
    return max(wide * scale, SHORTEST) + 0.6, max(high * scale, SHORTEST) + 0.9


def _draw_drive(
    axes: Axes,
    drive: Trajectory,
    label: str,
    color: str,
    style: Any,
    width: float,
    alpha: float = 1.0,
) -> None:
    axes.plot(
        *drive.pose[:, :2].T,
        linestyle=style,
        color=color,
        linewidth=width,
        label=label,
        alpha=alpha,
    )
