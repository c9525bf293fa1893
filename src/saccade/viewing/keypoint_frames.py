"""Figures of keypoints in their own frames: the same keypoint in two views, and what made it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple, TypeAlias

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from saccade.types import Float32Array, FloatArray, Keypoints, SymmetricPairs
from saccade.viewing.attention import draw_pair_lines
from saccade.viewing.style import BLUE, GRAY, GREEN, RED, faded, hide_ticks

Outcome: TypeAlias = Literal["inlier", "outlier", "matched", "rejected"]
"""What became of a keypoint of the first view: its match agrees with the geometry of the two
views, disagrees, or was not verified; or the nearest descriptor of the second view failed the ratio
or the mutual test."""

PATCH_SIDE = 120
"""Pixels to a side of a drawn patch."""
WINDOW = 6.0
"""Sizes of a keypoint that a patch covers: the window of its descriptor, 12 scales."""
COLORS: dict[Outcome, str] = {"inlier": GREEN, "outlier": RED, "matched": BLUE, "rejected": GRAY}
COLUMNS = 6


class KeypointView(NamedTuple):
    """A keypoint in one view."""

    image: Float32Array
    """(H, W, 3) in [0, 1]."""
    keypoint: Keypoints
    """One row."""
    pairs: SymmetricPairs | None = None
    """The edge pairs that contribute most to its symmetry; None if it has none."""


def keypoint_frame_figure(
    views: Sequence[tuple[KeypointView, KeypointView]], outcomes: Sequence[Outcome]
) -> Figure:
    """Keypoints of the first view above their nearest neighbors of the second.

    Each patch is turned and scaled to the frame of its keypoint, so that the two of a good match
    look alike. A circle has the keypoint's size, a line points in its direction; the pairs that
    contribute to its symmetry are drawn as in `pair_figure`.

    Args:
        views: a keypoint of the first view, and the one of the second with the nearest descriptor.
        outcomes: what became of each.
    """
    columns = min(COLUMNS, max(len(views), 1))
    bands = max(-(-len(views) // columns), 1)
    figure = Figure(figsize=(1.7 * columns, 3.6 * bands), layout="compressed", dpi=110)
    panels = figure.subplots(2 * bands, columns, squeeze=False)
    for axes in panels.ravel():
        hide_ticks(axes)
    for number, (pair, outcome) in enumerate(zip(views, outcomes, strict=True)):
        band, column = divmod(number, columns)
        for row, view in enumerate(pair):
            axes = panels[2 * band + row, column]
            _draw(axes, view)
            axes.spines[:].set(visible=True, color=COLORS[outcome], linewidth=2)
            if column == 0:
                axes.set_ylabel(f"{('first', 'second')[row]} view", fontsize=9)
        panels[2 * band, column].set_title(f"{number + 1}: {outcome}", fontsize=10)
    return figure


def _draw(axes: Axes, view: KeypointView) -> None:
    size, angle = float(view.keypoint.size[0]), float(view.keypoint.angle[0])
    scale = PATCH_SIDE / (WINDOW * size)
    cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    middle = (PATCH_SIDE - 1) / 2
    affine = np.column_stack([turn, middle - turn @ view.keypoint.xy[0]])
    side = (PATCH_SIDE, PATCH_SIDE)
    flags = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    blurred = cv2.GaussianBlur(view.image, (0, 0), 0.5 / scale) if scale < 1 else view.image
    patch = cv2.warpAffine(blurred, affine, side, flags=flags, borderValue=(1.0, 1.0, 1.0))
    patch = patch.clip(0, 1)
    radius = scale * size / 2
    axes.set(xlim=(-0.5, PATCH_SIDE - 0.5), ylim=(PATCH_SIDE - 0.5, -0.5))
    if view.pairs is None:
        axes.imshow(patch)
    else:
        axes.imshow(faded(patch), cmap="gray", vmin=0, vmax=1)
        draw_pair_lines(axes, _in_frame(view.pairs, affine, angle))
    axes.add_patch(Circle((middle, middle), radius, fill=False, color=GREEN, linewidth=1.2))
    axes.plot([middle, middle + radius], [middle, middle], color=GREEN, linewidth=1.2)


def _in_frame(pairs: SymmetricPairs, affine: FloatArray, angle: float) -> SymmetricPairs:
    """Pairs in the pixels of a patch."""
    linear, offset = affine[:, :2], affine[:, 2]
    return replace(
        pairs,
        first=pairs.first @ linear.T + offset,
        second=pairs.second @ linear.T + offset,
        first_angle=pairs.first_angle - angle,
        second_angle=pairs.second_angle - angle,
    )
