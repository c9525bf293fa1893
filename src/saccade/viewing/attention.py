"""Pictures of attention: where the model looks, and why."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
import numpy.typing as npt
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saccade.types import Float32Array, Image, Scanpath, SymmetricPairs
from saccade.viewing.style import HEAT, ORANGE, figure_for, picture_axes
from saccade.viewing.symmetry import draw_pairs

_OUTLINE = [patheffects.withStroke(linewidth=3, foreground="black")]


def attention_figure(
    image: Float32Array,
    maps: Mapping[str, Float32Array],
    path: Scanpath,
    pairs: Sequence[SymmetricPairs] = (),
) -> Figure:
    """The photo with its scanpath, each map as heat, and the photo lit by the first map.

    Args:
        image: (H, W, 3) in [0, 1].
        maps: by title; each (h, w), the first is the saliency map. Drawn from 0 to its maximum.
        path: fixations in image pixels, numbered in their order.
        pairs: what makes each fixation symmetric; with them comes a panel that shows it.
    """
    height, width = image.shape[:2]
    count = 2 + len(maps) + bool(pairs)
    columns = 2 if count <= 4 else 3
    rows = -(-count // columns)
    figure = figure_for(width, height, columns, rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    panels[0].imshow(image, interpolation="antialiased")
    picture_axes(panels[0], f"scanpath, {len(path)} fixations")
    draw_scanpath(panels[0], path)
    for axes, (title, values) in zip(panels[1:], maps.items(), strict=False):
        extent = (-0.5, width - 0.5, height - 0.5, -0.5)
        axes.imshow(values, cmap=HEAT, vmin=0, extent=extent, interpolation="bilinear")
        picture_axes(axes, title)
    title, salient = next(iter(maps.items()))
    lit = panels[1 + len(maps)]
    lit.imshow(lit_by(image, salient), interpolation="antialiased")
    picture_axes(lit, f"what {title} leaves in the light")
    if pairs:
        draw_pairs(panels[count - 1], image, pairs)
        picture_axes(panels[count - 1], "what is symmetric about the fixations")
    for axes in panels[count:]:
        axes.set_axis_off()
    return figure


def lit_by(image: Float32Array, values: Float32Array) -> Float32Array:
    """The photo, dark where a map is low; (H, W, 3).

    Args:
        image: (H, W, 3) in [0, 1].
        values: (h, w), not negative.
    """
    light = np.sqrt(cv2.resize(values / max(float(values.max()), 1e-12), image.shape[1::-1]))
    return np.asarray(image * (0.15 + 0.85 * light[:, :, None]), np.float32)


def heat_beside(frame: Image, values: Float32Array) -> npt.NDArray[np.uint8]:
    """A frame and its map as heat, side by side: (H, 2 W, 3) RGB.

    Args:
        frame: (H, W, 3) uint8 RGB.
        values: (h, w), not negative.
    """
    levels = values * (255 / max(float(values.max()), 1e-12))
    large = cv2.resize(levels.astype(np.uint8), frame.shape[1::-1])
    heat = cv2.applyColorMap(large, cv2.COLORMAP_CIVIDIS)[:, :, ::-1]
    return np.hstack([frame, heat]).astype(np.uint8)


def draw_scanpath(axes: Axes, path: Scanpath) -> None:
    """Number the fixations in their order and join them."""
    axes.plot(*path.xy.T, color=ORANGE, linewidth=1.5, path_effects=_OUTLINE)
    for number, (x, y) in enumerate(path.xy, start=1):
        first = number == 1
        axes.text(
            x,
            y,
            str(number),
            color="black",
            fontsize=8,
            ha="center",
            va="center",
            bbox={
                "boxstyle": "circle,pad=0.25",
                "facecolor": "white" if first else ORANGE,
                "edgecolor": "black",
            },
            in_layout=False,  # a number at the border is seen whole, and moves no panel
        )
