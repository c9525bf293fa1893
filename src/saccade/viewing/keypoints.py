"""Figures of interest points, matches and regions."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch, Rectangle

from saccade.types import BoolArray, Float32Array, IntArray, Keypoints, Regions
from saccade.viewing.style import BLUE, GREEN, ORANGE, RED, draw_panel, figure_for


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

    Inliers are green lines; the other matches lie beneath as red dashed lines.

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
