"""Pop-out displays of visual search: one odd item among many, and its rank by a saliency map."""

from typing import Literal

import cv2
import numpy as np

from saccade.errors import require
from saccade.types import Float32Array, FloatArray

ROWS = 5
"""Rows of bars."""
COLUMNS = 7
"""Columns of bars."""
BAR_SPACING = 92
"""Distance of the bars in pixels."""
BAR_SIZE = (32.0, 8.0)
"""Length and width of a bar in pixels."""
RED = (0.8, 0.1, 0.1)
GREEN = (0.1, 0.55, 0.1)
DARK = (0.25, 0.25, 0.25)
LIGHT = (0.8, 0.8, 0.8)
COLORS = {"color": (RED, GREEN), "orientation": (DARK, DARK), "intensity": (LIGHT, DARK)}
"""Colors of the odd bar and of the others, by the feature in which it is odd."""


def pop_out_display(
    seed: int,
    background: float = 0.5,
    odd: Literal["color", "orientation", "intensity"] = "color",
    *,
    rows: int = ROWS,
    columns: int = COLUMNS,
    spacing: float = BAR_SPACING,
) -> tuple[Float32Array, FloatArray, int]:
    """A display of bars of which one is odd.

    Args:
        seed: seed of the positions, the orientations and the target.
        background: gray of the background, 0 to 1.
        odd: "color": a red bar among green bars of random orientation; "orientation": a vertical
            bar among horizontal bars, all dark; "intensity": a light bar among dark bars of random
            orientation.
        rows: rows of bars.
        columns: columns of bars.
        spacing: distance of the bars in pixels; they are moved by up to 8 pixels.

    Returns:
        (rows * spacing, columns * spacing, 3) the display; (n, 2) the centers (x, y) of the bars;
        the number of the target.

    Raises:
        ConfigError: an unknown feature, or no bars.
    """
    require(odd in COLORS, "odd", f"one of {', '.join(COLORS)}", odd)
    require(min(rows, columns) > 0, "rows", "rows and columns of bars", (rows, columns))
    rng = np.random.default_rng(seed)
    image = np.full((round(rows * spacing), round(columns * spacing), 3), background, np.float32)
    target = int(rng.integers(rows * columns))
    y, x = np.indices((rows, columns)).reshape(2, -1)
    jitter = rng.uniform(-8, 8, (len(y), 2))
    centers = (np.stack([x, y], axis=1) + 0.5) * spacing + jitter
    angles = rng.uniform(0, 180, len(centers))
    if odd == "orientation":
        angles = np.where(np.arange(len(centers)) == target, 90.0, 0.0)
    of_target, of_others = COLORS[odd]
    for number, center in enumerate(centers):
        corners = cv2.boxPoints((center.tolist(), BAR_SIZE, float(angles[number])))
        color = of_target if number == target else of_others
        cv2.fillPoly(image, [np.round(corners * 16).astype(np.int32)], color, cv2.LINE_AA, 4)
    return image, centers, target


def target_rank(
    saliency: Float32Array | FloatArray,
    centers: FloatArray,
    target: int,
    width: float = COLUMNS * BAR_SPACING,
) -> int:
    """Rank of the target among the bars, 1 for the most salient.

    The saliency of a bar is the maximum over the cells that are closest to it.

    Args:
        saliency: (h, w) of a display.
        centers: (n, 2) of its bars, x and y.
        target: number of the target.
        width: width of the display in pixels.
    """
    cell = 2 ** round(np.log2(width / saliency.shape[1]))
    rows, columns = cell * np.indices(saliency.shape)[..., None]  # A.5
    nearest = np.hypot(columns - centers[:, 0], rows - centers[:, 1]).argmin(axis=-1)
    heights = [float(saliency[nearest == bar].max(initial=0)) for bar in range(len(centers))]
    return sum(each >= heights[target] for each in heights)
