"""A scanpath played in time."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from saccade.errors import require
from saccade.files import atomic_write
from saccade.types import Float32Array, Scanpath
from saccade.viewing.attention import draw_scanpath
from saccade.viewing.style import figure_for, picture_axes

FOVEA = 0.08
"""Radius of the light around a fixation, by the longer side of the image."""
REST = 1.5
"""Seconds for which the last fixation stays before the film starts again."""


def scanpath_frames(
    image: Float32Array, path: Scanpath
) -> tuple[list[npt.NDArray[np.uint8]], list[float]]:
    """One frame before the first fixation and one for each, with the model's time on it.

    Args:
        image: (H, W, 3) in [0, 1].
        path: n fixations.

    Returns:
        n + 1 frames, each (h, w, 3), and the (n + 1) seconds for which each is seen.
    """
    starts = np.concatenate([[0.0], path.time])
    lengths = [*np.diff(starts).tolist(), REST]
    return [_frame(image, path, seen, starts[seen]) for seen in range(len(path) + 1)], lengths


def save_film(
    frames: Sequence[npt.NDArray[np.uint8]],
    lengths: Sequence[float],
    file: str | Path,
    slower: float = 4.0,
) -> Path:
    """Write frames as an animated GIF that starts again at its end.

    Args:
        frames: each (h, w, 3).
        lengths: seconds for which each is seen; the last is not slowed.
        file: the GIF.
        slower: how many times slower than the model.

    Raises:
        ConfigError: `slower` is not above 0.
        OutputError: the file cannot be written.
    """
    require(slower > 0, "slower", "a factor above 0", slower)
    shown = [1000 * slower * length for length in lengths[:-1]] + [1000 * lengths[-1]]
    pictures = [Image.fromarray(frame) for frame in frames]
    with atomic_write(file) as temporary:
        pictures[0].save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=pictures[1:],
            duration=[max(20, round(milliseconds)) for milliseconds in shown],
            loop=0,
        )
    return Path(file)


def _frame(image: Float32Array, path: Scanpath, seen: int, time: float) -> npt.NDArray[np.uint8]:
    height, width = image.shape[:2]
    figure = figure_for(width, height, columns=1, rows=1, panel=6)
    axes = figure.subplots()
    if seen:
        axes.imshow(image * _light(image.shape, path.xy[seen - 1])[:, :, None])
    else:
        axes.imshow(image)
    picture_axes(axes, f"{1000 * time:.0f} ms")
    draw_scanpath(axes, Scanpath(path.xy[:seen], path.time[:seen], path.saliency[:seen]))
    with BytesIO() as drawn:
        figure.savefig(drawn, format="png", facecolor="white")
        return np.array(Image.open(drawn).convert("RGB"))


def _light(shape: tuple[int, ...], center: npt.NDArray[np.float64]) -> Float32Array:
    y, x = np.ogrid[: shape[0], : shape[1]]
    sigma = FOVEA * max(shape[:2])
    d2 = (x - center[0]) ** 2 + (y - center[1]) ** 2
    return np.asarray(0.35 + 0.65 * np.exp(-d2 / (2 * sigma**2)), np.float32)
