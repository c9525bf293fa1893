"""Pictures of maps: where the robot drove, where the landmarks are, how sure that is."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from saccade.types import FloatArray, LandmarkMap, Trajectory
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED

SIGMAS = 3.0
"""The ellipses enclose this many standard deviations."""


def map_figure(
    trajectory: Trajectory,
    landmarks: LandmarkMap,
    dead_reckoning: Trajectory | None = None,
    truth: Trajectory | None = None,
) -> Figure:
    """The map from above; x to the right, y up, in metres.

    Args:
        trajectory: the estimate.
        landmarks: with covariance, to see their ellipses.
        dead_reckoning: the same drive from odometry alone, for comparison.
        truth: where the robot really was, in the same frame.
    """
    figure = Figure(figsize=(8.6, 7.6), layout="constrained", dpi=110)
    axes = figure.subplots()
    if dead_reckoning is not None:
        _draw_drive(axes, dead_reckoning, "odometry alone", GRAY, "--")
    if truth is not None:
        axes.plot(*truth.pose[:, :2].T, ".", color=GREEN, markersize=2, label="truth")
    _draw_drive(axes, trajectory, "estimate", BLUE, "-")
    if len(trajectory):
        axes.plot(*trajectory.pose[0, :2], "s", color=RED, markersize=6, label="start")
    axes.plot(
        *landmarks.xy.T,
        "+",
        color="black",
        markersize=5,
        label=f"{len(landmarks)} landmarks, {SIGMAS:.0f} sigma",
    )
    if landmarks.covariance is not None and len(landmarks):
        _draw_ellipses(axes, landmarks.xy, landmarks.covariance)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(color="0.9", linewidth=0.5)
    axes.set_axisbelow(True)
    axes.legend(loc="best", framealpha=0.9)
    return figure


def _draw_drive(axes: Axes, drive: Trajectory, label: str, color: str, style: str) -> None:
    axes.plot(*drive.pose[:, :2].T, style, color=color, linewidth=1.1, label=label)


def _draw_ellipses(axes: Axes, centers: FloatArray, covariance: FloatArray) -> None:
    variances, directions = np.linalg.eigh(covariance)
    lengths = 2 * SIGMAS * np.sqrt(variances.clip(0))
    angles = np.degrees(np.arctan2(directions[:, 1, 1], directions[:, 0, 1]))
    axes.add_collection(
        EllipseCollection(
            lengths[:, 1],
            lengths[:, 0],
            angles,
            units="xy",
            offsets=centers,
            transOffset=axes.transData,
            facecolors="none",
            edgecolors=ORANGE,
            linewidths=0.9,
        )
    )
