"""Film of a scanpath, as an animated GIF."""

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
from saccade.viewing.style import draw_panel, figure_for

FOVEA = 0.08
"""Standard deviation of the bright region around a fixation, by the longer side of the image."""
LAST_SECONDS = 1.5
"""Duration of the last fixation before the film starts again."""


def scanpath_frames(
    image: Float32Array, path: Scanpath
) -> tuple[list[npt.NDArray[np.uint8]], list[float]]:
    """One frame before the first fixation and one for each, titled with the model's time.

    Args:
        image: (H, W, 3) in [0, 1].
        path: n fixations.

    Returns:
        n + 1 frames, each (h, w, 3), and their (n + 1) durations in seconds.
    """
    starts = np.concatenate([[0.0], path.time])
    durations = [*np.diff(starts).tolist(), LAST_SECONDS]
    frames = [_frame(image, path, count, time) for count, time in enumerate(starts.tolist())]
    return frames, durations


def save_film(
    frames: Sequence[npt.NDArray[np.uint8]],
    durations: Sequence[float],
    file: str | Path,
    slowdown: float = 4.0,
) -> Path:
    """Write frames as an animated GIF that repeats.

    Args:
        frames: each (h, w, 3).
        durations: seconds of each; the last is not slowed down.
        file: the GIF.
        slowdown: how many times slower than the model.

    Raises:
        ConfigError: `slowdown` is not above 0.
        OutputError: the file cannot be written.
    """
    require(slowdown > 0, "slowdown", "a factor above 0", slowdown)
    milliseconds = [1000 * slowdown * each for each in durations[:-1]] + [1000 * durations[-1]]
    first, *others = [Image.fromarray(frame) for frame in frames]
    with atomic_write(file) as temporary:
        first.save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=others,
            duration=[max(20, round(each)) for each in milliseconds],
            loop=0,
        )
    return Path(file)


def _frame(image: Float32Array, path: Scanpath, count: int, time: float) -> npt.NDArray[np.uint8]:
    """The image after `count` fixations."""
    height, width = image.shape[:2]
    figure = figure_for(width, height, columns=1, rows=1, panel=6)
    axes = figure.subplots()
    shown = image * _foveal_weight(image.shape, path.xy[count - 1])[:, :, None] if count else image
    draw_panel(axes, shown, f"{1000 * time:.0f} ms")
    draw_scanpath(axes, Scanpath(path.xy[:count], path.time[:count], path.saliency[:count]))
    with BytesIO() as file:
        figure.savefig(file, format="png", facecolor="white")
        return np.array(Image.open(file).convert("RGB"))


def _foveal_weight(shape: tuple[int, ...], center: npt.NDArray[np.float64]) -> Float32Array:
    """(H, W) weight of each pixel, 1 at the fixation."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    sigma = FOVEA * max(shape[:2])
    d2 = (x - center[0]) ** 2 + (y - center[1]) ** 2
    return np.asarray(0.35 + 0.65 * np.exp(-d2 / (2 * sigma**2)), np.float32)
