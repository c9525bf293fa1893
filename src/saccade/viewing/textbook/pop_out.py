"""Pop-out of a color: displays, the rank of the target, and a figure."""

from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

from saccade.types import Float32Array, FloatArray, Image
from saccade.viewing.style import HEAT, draw_panel, figure_for

ROWS = 5
"""Rows of bars in a pop-out display."""
COLUMNS = 7
"""Columns of bars in a pop-out display."""
BAR_SPACING = 92
"""Distance of the bars of a pop-out display, in pixels."""
BAR_SIZE = (32.0, 8.0)
"""Length and width of a bar, in pixels."""
TARGET_COLOR = (0.8, 0.1, 0.1)
"""Color of the target."""
DISTRACTOR_COLOR = (0.1, 0.55, 0.1)
"""Color of the distractors."""


def pop_out_display(seed: int, background: float = 0.5) -> tuple[Float32Array, FloatArray, int]:
    """A red bar among green bars of random orientation, on a gray background.

    Returns:
        (460, 644, 3) the display; (35, 2) the centers (x, y) of the bars; the number of the target.
    """
    rng = np.random.default_rng(seed)
    image = np.full((ROWS * BAR_SPACING, COLUMNS * BAR_SPACING, 3), background, np.float32)
    target = int(rng.integers(ROWS * COLUMNS))
    rows, columns = np.indices((ROWS, COLUMNS)).reshape(2, -1)
    jitter = rng.uniform(-8, 8, (len(rows), 2))
    centers = (np.stack([columns, rows], axis=1) + 0.5) * BAR_SPACING + jitter
    angles = rng.uniform(0, 180, len(centers))
    for number, center in enumerate(centers):
        corners = cv2.boxPoints((center.tolist(), BAR_SIZE, float(angles[number])))
        color = TARGET_COLOR if number == target else DISTRACTOR_COLOR
        cv2.fillPoly(image, [np.round(corners * 16).astype(np.int32)], color, cv2.LINE_AA, 4)
    return image, centers, target


def target_rank(saliency: Float32Array | FloatArray, centers: FloatArray, target: int) -> int:
    """Rank of the target among the bars, 1 for the most salient.

    The saliency of a bar is the maximum over the cells that are closest to it.

    Args:
        saliency: (h, w) of a display.
        centers: (n, 2) of its bars, x and y.
        target: number of the target.
    """
    cell = 2 ** round(np.log2(COLUMNS * BAR_SPACING / saliency.shape[1]))
    rows, columns = cell * np.indices(saliency.shape)[..., None]  # A.5
    nearest = np.hypot(columns - centers[:, 0], rows - centers[:, 1]).argmin(axis=-1)
    heights = [float(saliency[nearest == bar].max(initial=0)) for bar in range(len(centers))]
    return sum(each >= heights[target] for each in heights)


def pop_out_figure(image: Image, result: Any, default: Float32Array) -> Figure:
    """A display, its red-green and orientation maps, and its saliency by both models.

    Args:
        image: the display.
        result: its `ContrastSaliency` by the textbook.
        default: (h, w) its saliency by the default model.
    """
    figure = figure_for(image.shape[1], image.shape[0], columns=3, rows=2, panel=3.8)
    panels = figure.subplots(2, 3).ravel()
    draw_panel(panels[0], image, "display")
    name, c, s = next(key for key in result.features if key[0] == "red_green")
    feature = result.features[name, c, s]
    title = f"red-green, c = {c}, s = {s} (A.8)\nweight {feature.normalized.weight:.3f}"
    draw_panel(panels[1], result.channels[name], "red-green (A.2)", cmap="gray", vmin=-1, vmax=1)
    draw_panel(panels[2], feature.contrast, title, cmap=HEAT, vmin=0)
    draw_panel(panels[3], result.orientation, "orientation (A.13)", cmap=HEAT, vmin=0)
    draw_panel(panels[4], result.saliency, "saliency as printed", cmap=HEAT, vmin=0)
    draw_panel(panels[5], default, "saliency by the default", cmap=HEAT, vmin=0)
    return figure
