"""Pictures of interest points and of what they match."""

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch

from saccade.types import Float32Array, IntArray, Keypoints
from saccade.viewing.style import BLUE, GREEN, ORANGE, RED, figure_for, picture_axes


def keypoint_figure(image: Float32Array, keypoints: Keypoints) -> Figure:
    """The photo with each interest point as a circle of its size and a line along its angle.

    Args:
        image: (H, W, 3) in [0, 1].
        keypoints: of that image.
    """
    height, width = image.shape[:2]
    figure = figure_for(width, height, columns=1, rows=1, panel=9)
    axes = figure.subplots()
    axes.imshow(image, interpolation="antialiased")
    picture_axes(axes, f"{len(keypoints)} interest points: size and direction")
    draw_keypoints(axes, keypoints)
    return figure


def draw_keypoints(axes: Axes, keypoints: Keypoints) -> None:
    """Circles with a radius; the big ones under the small ones."""
    points = keypoints[np.argsort(-keypoints.size, kind="stable")]
    heading = np.stack([np.cos(points.angle), np.sin(points.angle)], axis=1)
    ends = points.xy + heading * points.size[:, None] / 2
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


def match_figure(
    images: tuple[Float32Array, Float32Array],
    keypoints: tuple[Keypoints, Keypoints],
    pairs: IntArray,
    inliers: npt.NDArray[np.bool_] | None = None,
) -> Figure:
    """Two photos side by side, matched interest points joined by lines.

    Lines of inliers are green; those of other matches lie beneath, red and dashed.

    Args:
        images: two (H, W, 3) in [0, 1].
        keypoints: of each.
        pairs: (m, 2) indices into the two.
        inliers: (m,) which of them agree with one geometry; None where that was not asked.
    """
    right = np.ones(len(pairs), np.bool_) if inliers is None else inliers
    matched = f"{len(pairs)} matched"
    if inliers is not None:
        matched += f", {right.sum()} inliers"
    height = max(image.shape[0] for image in images)
    width = max(image.shape[1] for image in images)
    figure = figure_for(width, height, columns=2, rows=1, panel=6)
    panels = figure.subplots(1, 2)
    for side, (axes, image) in enumerate(zip(panels, images, strict=True)):
        axes.imshow(image, interpolation="antialiased")
        picture_axes(axes, f"{len(keypoints[side])} interest points, {matched}")
        axes.plot(*keypoints[side].xy[pairs[:, side]].T, "o", color=BLUE, markersize=3)
    for index in np.argsort(right, kind="stable"):
        first, second = pairs[index]
        figure.add_artist(
            ConnectionPatch(
                xyA=tuple(keypoints[0].xy[first].tolist()),
                xyB=tuple(keypoints[1].xy[second].tolist()),
                coordsA="data",
                coordsB="data",
                axesA=panels[0],
                axesB=panels[1],
                color=GREEN if right[index] else RED,
                linestyle="-" if right[index] else "--",
                linewidth=0.6,
                alpha=0.8,
            )
        )
    return figure
