"""The steps of EKF-SLAM as ellipses and correlations (appendix C)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from saccade.types import FloatArray
from saccade.viewing.contrast_steps import SIGNED, bare
from saccade.viewing.maps import SIGMAS, bounds, ellipse_outlines, map_axes
from saccade.viewing.style import BLUE, GRAY, ORANGE, RED

LEGIBLE = 0.08
"""The largest ellipse is at least this share of the picture; smaller ones are enlarged."""
MOST_NAMES = 6
"""Landmarks whose rows are named beside a matrix."""


@dataclass(frozen=True)
class Belief:
    """What the filter believes."""

    s: FloatArray
    """(3 + 2N,) pose (x, y, heading) and landmarks."""
    P: FloatArray
    """(3 + 2N, 3 + 2N) covariance."""


def filter_figures(
    steps: Mapping[str, tuple[Belief, Belief, FloatArray | None]],
    scans: Sequence[tuple[str, Belief]],
) -> dict[str, Figure]:
    """The steps of a filter, and how its correlations grow, by name.

    Args:
        steps: what each made of the state before it, and (2,) the place it observed, by name.
        scans: titles and states, which become "state".
    """
    return {"state": _growth(scans), **{name: _step(*step) for name, step in steps.items()}}


def _step(before: Belief, after: Belief, observed: FloatArray | None) -> Figure:
    """The state from above, and the correlations before and after the step."""
    figure = Figure(figsize=(11.5, 4.3), layout="compressed", dpi=110)
    ground, first, second = figure.subplots(1, 3, width_ratios=(1.35, 1, 1))
    scale = _enlargement(before, after, observed)
    grey = _draw_belief(ground, before, GRAY, GRAY, scale)
    colored = _draw_belief(ground, after, BLUE, ORANGE, scale)
    places = [grey, colored] if observed is None else [grey, colored, observed[None]]
    if observed is not None:
        pose = before.s[:2]
        ground.plot(*np.array([pose, observed]).T, "--", color="black", linewidth=1)
        ground.plot(*observed, "x", color="black", markersize=7)
    map_axes(ground, bounds(np.concatenate(places), 0.06))
    larger = "" if scale == 1 else f", drawn {scale} times as large"
    ground.set_title(f"{SIGMAS:.0f} sigma{larger}", fontsize=10)
    size = len(after.s)
    _draw_correlations(first, before.P, size)
    first.set_title("correlations before", fontsize=10, loc="left")
    _draw_correlations(second, after.P, size)
    second.set_title("and after", fontsize=10, loc="left")
    if size > len(before.s):
        low = len(before.s) - 0.5
        new = Rectangle((-0.5, low), size, 2, fill=False, edgecolor=RED, linewidth=2, clip_on=False)
        second.add_patch(new)
    return figure


def _growth(scans: Sequence[tuple[str, Belief]]) -> Figure:
    """The correlations of several states, all on one grid."""
    columns = min(len(scans), 4)
    rows = -(-len(scans) // columns)
    figure = Figure(figsize=(2.9 * columns, 3.1 * rows), layout="compressed", dpi=110)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(scans) :]:
        axes.set_axis_off()
    for axes, (title, belief) in zip(panels, scans, strict=False):
        _draw_correlations(axes, belief.P, max(len(each.s) for _, each in scans))
        axes.set_title(title, fontsize=10, loc="left")
    return figure


def _draw_correlations(axes: Axes, P: FloatArray, size: int) -> None:
    """The correlation matrix of a covariance, in the corner of a size x size grid."""
    sigma = np.sqrt(np.diagonal(P).clip(1e-300))
    correlation = P / sigma / sigma[:, None]
    correlation[:, np.diagonal(P) <= 0] = 0
    axes.imshow(correlation, cmap=SIGNED, vmin=-1, vmax=1, interpolation="nearest")
    axes.set_xlim(-0.5, size - 0.5)
    axes.set_ylim(size - 0.5, -0.5)
    bare(axes)
    axes.add_patch(Rectangle((-0.5, -0.5), len(P), len(P), fill=False, edgecolor="0.3"))
    for line in range(3, len(P), 2):
        axes.plot([line - 0.5] * 2, [-0.5, len(P) - 0.5], color="0.6", linewidth=0.5)
        axes.plot([-0.5, len(P) - 0.5], [line - 0.5] * 2, color="0.6", linewidth=0.5)
    if size <= 3 + 2 * MOST_NAMES:
        landmarks = (len(P) - 3) // 2
        axes.set_yticks([1, *(3.5 + 2 * i for i in range(landmarks))])
        axes.set_yticklabels(["pose", *(f"m{i + 1}" for i in range(landmarks))], fontsize=8)
        axes.tick_params(length=0)


def _draw_belief(axes: Axes, belief: Belief, robot: str, landmark: str, scale: int) -> FloatArray:
    """Pose and landmarks with their ellipses; returns (k, 2) what must be in the picture."""
    places = np.concatenate([belief.s[None, :2], belief.s[3:].reshape(-1, 2)])
    outlines = ellipse_outlines(places, _blocks(belief), SIGMAS * scale)
    for color, own in ((robot, outlines[:1]), (landmark, outlines[1:])):
        style: Any = {"facecolor": (color, 0.15), "edgecolor": (color, 0.95), "linewidth": 1.2}
        axes.add_collection(PolyCollection([*own], **style), autolim=False)
    axes.plot(*places[1:].T, ".", color=landmark, markersize=5)
    heading = belief.s[2]
    axes.plot(*places[0], marker=(3, 0, np.degrees(heading) - 90), color=robot, markersize=11)
    return np.concatenate([places, outlines.reshape(-1, 2)])


def _blocks(belief: Belief) -> FloatArray:
    """(N + 1, 2, 2) covariances of the positions of robot and landmarks."""
    starts = [0, *range(3, len(belief.s), 2)]
    return np.array([belief.P[i : i + 2, i : i + 2] for i in starts])


def _enlargement(before: Belief, after: Belief, observed: FloatArray | None) -> int:
    """How many times ellipses are drawn larger, so that the largest can be seen."""
    places = [belief.s[3:].reshape(-1, 2) for belief in (before, after)]
    places += [before.s[None, :2], after.s[None, :2]]
    places += [] if observed is None else [observed[None]]
    side = float(np.ptp(np.concatenate(places), axis=0).max())
    blocks = np.concatenate([_blocks(before), _blocks(after)])
    largest = 2 * SIGMAS * float(np.sqrt(np.linalg.eigvalsh(blocks).max().clip(1e-300)))
    wanted = LEGIBLE * side / largest
    return next((scale for scale in (1, 2, 5, 10, 20, 50, 100) if scale >= wanted), 100)
