"""Figures of interest points, matches and regions, and of keypoints in their own frames."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple, TypeAlias

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, ConnectionPatch, Rectangle

from saccade.types import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    Keypoints,
    Regions,
    SymmetricPairs,
)
from saccade.viewing.attention import draw_pair_lines
from saccade.viewing.style import (
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    RED,
    draw_panel,
    faded,
    figure_for,
    hide_ticks,
)


def keypoint_figure(image: Float32Array, keypoints: Keypoints) -> Figure:
    """The image with each interest point as a circle of its size and a line along its angle.

    Args:
        image: (H, W, 3) in [0, 1].
        keypoints: of that image.
    """
    figure = figure_for(image.shape[1], image.shape[0], panel=9)
    axes = figure.subplots()
    title = f"{len(keypoints)} interest points: size and direction"
    draw_panel(axes, image, title, interpolation="antialiased")
    draw_keypoints(axes, keypoints)
    return figure


def draw_keypoints(axes: Axes, keypoints: Keypoints) -> None:
    """Circles with a radius along the angle; small circles on top of large ones."""
    points = keypoints[np.argsort(-keypoints.size, kind="stable")]
    direction = np.stack([np.cos(points.angle), np.sin(points.angle)], axis=1)
    ends = points.xy + direction * points.size[:, None] / 2
    axes.add_collection(
        EllipseCollection(
            points.size,
            points.size,
            np.zeros(len(points)),
            units="x",
            offsets=points.xy,
            transOffset=axes.transData,
            facecolors="none",
            edgecolors=ORANGE,
            linewidths=0.8,
        )
    )
    axes.add_collection(
        LineCollection(list(np.stack([points.xy, ends], axis=1)), colors=BLUE, linewidths=0.8)
    )


def region_figure(image: Float32Array, regions: Regions) -> Figure:
    """The image with the box of each region, and its frame as a circle and a line along its angle.

    Args:
        image: (H, W, 3) in [0, 1].
        regions: of that image.
    """
    figure = figure_for(image.shape[1], image.shape[0], panel=9)
    axes = figure.subplots()
    title = f"{len(regions)} regions: box, size and direction"
    draw_panel(axes, image, title, interpolation="antialiased")
    for left, top, right, bottom in regions.boxes.tolist():
        size = right - left, bottom - top
        axes.add_patch(Rectangle((left, top), *size, fill=False, color=GREEN, linewidth=1.2))
    draw_keypoints(axes, regions.keypoints)
    return figure


def match_figure(
    images: tuple[Float32Array, Float32Array],
    keypoints: tuple[Keypoints, Keypoints],
    pairs: IntArray,
    inliers: BoolArray | None = None,
) -> Figure:
    """Two images side by side, matched interest points joined by lines.

    Lines of inliers are green; those of other matches lie beneath, red and dashed.

    Args:
        images: two (H, W, 3) in [0, 1].
        keypoints: of each.
        pairs: (m, 2) indices into the two.
        inliers: (m,) which matches agree with one geometry; None without verification.
    """
    is_inlier = np.ones(len(pairs), np.bool_) if inliers is None else inliers
    counts = f"{len(pairs)} matched"
    if inliers is not None:
        counts += f", {inliers.sum()} inliers"
    height, width = np.max([image.shape[:2] for image in images], axis=0).tolist()
    figure = figure_for(width, height, columns=2, panel=6)
    panels = figure.subplots(1, 2)
    for axes, image, points, index in zip(panels, images, keypoints, pairs.T, strict=True):
        title = f"{len(points)} interest points, {counts}"
        draw_panel(axes, image, title, interpolation="antialiased")
        axes.plot(*points.xy[index].T, "o", color=BLUE, markersize=3)
    for match in np.argsort(is_inlier, kind="stable"):
        first, second = pairs[match]
        figure.add_artist(
            ConnectionPatch(
                xyA=tuple(keypoints[0].xy[first].tolist()),
                xyB=tuple(keypoints[1].xy[second].tolist()),
                coordsA="data",
                coordsB="data",
                axesA=panels[0],
                axesB=panels[1],
                color=GREEN if is_inlier[match] else RED,
                linestyle="-" if is_inlier[match] else "--",
                linewidth=0.6,
                alpha=0.8,
            )
        )
    return figure


Outcome: TypeAlias = Literal["inlier", "outlier", "matched", "rejected"]
"""Outcome of a keypoint of the first view: its match agrees with the geometry of the two
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
