"""Figures of attention: saliency maps, scanpaths and symmetric pairs."""

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from saccade.types import Float32Array, FloatArray, Image, Scanpath, SymmetricPairs
from saccade.viewing.style import (
    BLUE,
    HEAT,
    ORANGE,
    draw_panel,
    faded,
    figure_for,
    picture_axes,
    rgb_levels,
)

STROKE = 0.12
"""Half length of the stroke along an edge, as a fraction of the pair's distance."""
MIN_STRENGTH = 0.25
"""Minimum strength of a drawn pair, as a fraction of the strongest pair at its point."""
MIN_CONCENTRATION = 0.3
"""Minimum resultant length for a mean direction: 0 is uniform, 1 means equal directions."""
AXIS_REACH = 0.8
"""Half length of an axis, as a fraction of its longest pair."""
MIN_WIDTH = 0.5
"""Line width of a pair of strength 0, in points."""
MAX_LINE_WIDTH = 1.6
"""Line width of the strongest pair at a point, in points."""


def attention_figure(
    image: Float32Array,
    maps: Any,
    path: Scanpath | None = None,
    pairs: Sequence[SymmetricPairs] = (),
    fixations: FloatArray | None = None,
    sigma: float = 24.0,
    dpi: float = 110.0,
) -> Figure:
    """The image with its scanpath, each map as a heat map, and the image weighted by the first map.

    Every map has a color bar from 0 to its own maximum.

    Args:
        image: (H, W, 3) in [0, 1].
        maps: the result of a model, or maps (h, w) by title, the saliency map first. Each
            is drawn from 0 to its own maximum.
        path: fixations in image pixels, numbered in their order, the first in white; None for the
            image alone.
        pairs: symmetric pairs of each fixation, drawn in a separate panel.
        fixations: (n, 2) human fixations in image pixels, drawn on the image, with their density
            before the maps; None for none.
        sigma: standard deviation of the density in pixels.
        dpi: resolution in pixels per inch.
    """
    layers: Mapping[str, Float32Array] = getattr(maps, "layers", maps)
    height, width = image.shape[:2]
    if fixations is not None:
        density = blurred_counts(fixations, (height, width), sigma)
        layers = {f"{len(fixations)} fixations, blurred by {sigma:g} px": density, **layers}
    count = 1 + len(layers) + bool(layers) + bool(pairs)
    columns = 2 if count == 4 else min(count, 3)
    rows = -(-count // columns)
    figure = figure_for(width, height, columns, rows, dpi=dpi)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    title = "image" if path is None else f"scanpath, {len(path)} fixations"
    draw_panel(panels[0], image, title, interpolation="antialiased")
    if fixations is not None:
        dots = {"color": BLUE, "markersize": 5, "markeredgecolor": "white", "markeredgewidth": 0.5}
        panels[0].plot(*fixations.T, "o", **dots)
        panels[0].set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    if path is not None:
        draw_scanpath(panels[0], path)
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    options: dict[str, Any] = {"cmap": HEAT, "extent": extent, "interpolation": "bilinear"}
    for axes, (title, values) in zip(panels[1:], layers.items(), strict=False):
        draw_panel(axes, values, title, vmin=0, **options)
        add_color_bar(axes, float(np.max(values, initial=0)))
    if layers:
        title, saliency = [*layers.items()][int(fixations is not None and len(layers) > 1)]
        weighted, title = weighted_by(image, saliency), f"image weighted by {title}"
        draw_panel(panels[1 + len(layers)], weighted, title, interpolation="antialiased")
    if pairs:
        draw_pairs(panels[count - 1], image, pairs, "symmetric pairs at the fixations")
    for axes in panels[count:]:
        axes.set_axis_off()
    return figure


def pair_figure(image: Float32Array, pairs: Sequence[SymmetricPairs]) -> Figure:
    """The image with the symmetric pairs of some points.

    Args:
        image: (H, W, 3) in [0, 1].
        pairs: symmetric pairs of each point.
    """
    figure = figure_for(image.shape[1], image.shape[0], panel=9)
    points = "a point" if len(pairs) == 1 else f"{len(pairs)} points"
    draw_pairs(figure.subplots(), image, pairs, f"symmetric pairs at {points}")
    return figure


def draw_pairs(
    axes: Axes, image: Float32Array, pairs: Sequence[SymmetricPairs], title: str
) -> None:
    """The image in pale gray; each strong pair as a line between strokes along its two edges."""
    axes.imshow(faded(image), interpolation="antialiased", vmin=0, vmax=1, cmap="gray")
    for each in pairs:
        draw_pair_lines(axes, each)
    picture_axes(axes, title)


def draw_pair_lines(axes: Axes, pairs: SymmetricPairs) -> None:
    """The strong pairs of a point as lines between strokes along their two edges.

    Their axis of symmetry is dashed, if they have one.
    """
    fraction = pairs.strength / pairs.strength.max(initial=1e-30)
    strong, fraction = pairs[fraction >= MIN_STRENGTH], fraction[fraction >= MIN_STRENGTH]
    width = MIN_WIDTH + (MAX_LINE_WIDTH - MIN_WIDTH) * fraction
    lines = np.stack([strong.first, strong.second], axis=1)
    length = STROKE * np.hypot(*(strong.first - strong.second).T)
    axes.add_collection(LineCollection(list(lines), colors=ORANGE, linewidths=width))
    for xy, angle in ((strong.first, strong.first_angle), (strong.second, strong.second_angle)):
        half = np.stack([-np.sin(angle), np.cos(angle)], axis=1) * length[:, None]
        strokes = np.stack([xy - half, xy + half], axis=1)  # perpendicular to the gradients
        axes.add_collection(LineCollection(list(strokes), colors=BLUE, linewidths=1.4 * width))
    direction = axis_of(strong)
    if direction is not None:
        middle = (strong.first + strong.second).mean(axis=0) / 2
        reach = AXIS_REACH * np.hypot(*(strong.first - strong.second).T).max()
        offset = reach * np.array([np.cos(direction), np.sin(direction)])
        axes.plot(*np.stack([middle - offset, middle + offset], 1), "--k", linewidth=0.8)


def axis_of(pairs: SymmetricPairs) -> float | None:
    """Direction of the axis of symmetry in radians, modulo pi; None if the pairs share no axis.

    The axis of a pair is its perpendicular bisector. The mean is taken over doubled angles,
    weighted by strength.
    """
    dx, dy = (pairs.second - pairs.first).T
    doubled = np.sum(pairs.strength * np.exp(2j * np.arctan2(dy, dx)))
    if abs(doubled) <= MIN_CONCENTRATION * pairs.strength.sum():
        return None
    return float(np.angle(doubled) / 2 + np.pi / 2)


def add_color_bar(axes: Axes, top: float) -> None:
    """A color bar of the map in a panel, labeled at 0 and at its maximum."""
    if top <= 0 or axes.figure is None:
        return
    bar = axes.figure.colorbar(axes.images[0], ax=axes, fraction=0.04, pad=0.02, ticks=[0, top])
    bar.ax.set_yticklabels(["0", f"{top:.2g}"], fontsize=7)
    bar.outline.set_visible(False)


def blurred_counts(xy: FloatArray, shape: tuple[int, int], sigma: float) -> Float32Array:
    """(H, W) density of fixations (n, 2) per square pixel; those outside are left out."""
    counts = np.zeros(shape, np.float32)
    columns, rows = np.floor(np.asarray(xy, np.float64).reshape(-1, 2) + 0.5).astype(np.int64).T
    inside = (columns >= 0) & (columns < shape[1]) & (rows >= 0) & (rows < shape[0])
    np.add.at(counts, (rows[inside], columns[inside]), 1.0)
    blurred = cv2.GaussianBlur(counts, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(blurred, np.float32)


def draw_scanpath(axes: Axes, path: Scanpath) -> None:
    """Fixations numbered in order, the first in white, joined by lines.

    Fixations at the same position share a label with all their numbers. Labels that would hide each
    other are moved apart, each with a line to its fixation.
    """
    outline = [patheffects.withStroke(linewidth=3, foreground="black")]
    axes.plot(*path.xy.T, color=ORANGE, linewidth=1.5, path_effects=outline)
    places: dict[tuple[float, ...], list[int]] = {}
    for number, xy in enumerate(path.xy.tolist(), start=1):
        places.setdefault(tuple(xy), []).append(number)
    texts = [", ".join(map(str, numbers)) for numbers in places.values()]
    if not texts:
        return
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    size = np.abs([right - left, bottom - top])
    point = float(size.max()) / PANEL_POINTS
    radii = np.array([point * (LABEL_POINTS + 2 * (len(text) - 1)) for text in texts])
    labels = apart(np.array([*places]), radii, size)
    for (place, numbers), text, label, radius in zip(
        places.items(), texts, labels, radii, strict=True
    ):
        if np.hypot(*(label - place)) > radius:
            axes.plot(*np.stack([place, label], 1), color="black", linewidth=0.8)
            axes.plot(*place, ".", color="black", markersize=4)
        axes.text(
            float(label[0]),
            float(label[1]),
            text,
            color="black",
            fontsize=8,
            ha="center",
            va="center",
            bbox={
                "boxstyle": f"{'circle' if len(numbers) == 1 else 'round'},pad=0.25",
                "facecolor": "white" if numbers[0] == 1 else ORANGE,
                "edgecolor": "black",
            },
            in_layout=False,  # numbers at the border are neither clipped nor part of the layout
        )


PANEL_POINTS = 288.0
"""Longer side of a panel, in points."""
LABEL_POINTS = 7.5
"""Radius of the label of a fixation, in points."""
ROUNDS = 200
"""Maximum number of rounds in which labels are moved apart."""


def apart(xy: FloatArray, radii: FloatArray, size: npt.NDArray[Any]) -> FloatArray:
    """(n, 2) positions near given ones, whose discs do not overlap if there is room.

    Args:
        xy: (n, 2) positions in image pixels.
        radii: (n,) radii of the discs.
        size: width and height of the image, which positions do not leave.
    """
    placed, n = xy.astype(np.float64).copy(), len(xy)
    turn = 2.399963 * np.arange(n)  # golden angle, which separates equal positions
    placed += 0.01 * radii[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    needed = radii[:, None] + radii
    np.fill_diagonal(needed, 0)
    number = np.arange(n)
    angle = 2.399963 * (number[:, None] + number)
    spare = np.sign(number[:, None] - number)[..., None] * np.stack(
        [np.cos(angle), np.sin(angle)], axis=2
    )  # directions of equal positions
    for _ in range(ROUNDS):
        offset = placed[:, None] - placed
        distance = np.hypot(*np.moveaxis(offset, 2, 0))
        overlap = np.maximum(needed - distance, 0)
        if overlap.max() < 1e-3 * radii.max():
            break
        direction = np.where(
            (distance > 1e-6)[..., None], offset / np.maximum(distance, 1e-6)[..., None], spare
        )
        placed = (placed + 0.3 * (overlap[..., None] * direction).sum(axis=1)).clip(0, size)
    return placed


def weighted_by(image: Float32Array, values: Float32Array) -> Float32Array:
    """(H, W, 3) the image, dark where a map is low.

    Args:
        image: (H, W, 3) in [0, 1].
        values: (h, w), not negative.
    """
    weight = np.sqrt(cv2.resize(values / max(float(values.max()), 1e-12), image.shape[1::-1]))
    return np.asarray(image * (0.15 + 0.85 * weight[:, :, None]), np.float32)


def heat_beside(
    frame: Image, values: Float32Array, gaze: tuple[float, float]
) -> npt.NDArray[np.uint8]:
    """A frame and its saliency as a heat map, side by side: (H, 2 W, 3) RGB.

    Args:
        frame: (H, W, 3) uint8 RGB.
        values: (h, w), not negative.
        gaze: x and y in pixels, drawn in both.
    """
    levels = values * (255 / max(float(values.max()), 1e-12))
    large = cv2.resize(levels.astype(np.uint8), frame.shape[1::-1])
    panels = [np.array(panel, np.uint8) for panel in (frame, heat_colors(large))]
    center, radius = (round(gaze[0]), round(gaze[1])), max(3, max(frame.shape) // 40)
    for panel in panels:
        cv2.circle(panel, center, radius, (0, 0, 0), 4, cv2.LINE_AA)
        cv2.circle(panel, center, radius, rgb_levels(ORANGE), 2, cv2.LINE_AA)
    return np.hstack(panels)


def heat_colors(levels: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """(h, w, 3) RGB of levels (h, w) from 0 to 255."""
    return np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_CIVIDIS)[:, :, ::-1], np.uint8)
