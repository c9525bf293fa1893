"""Colors and axes of every figure; safe for color-blind readers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from saccade.io.files import atomic_write

FIGURE_FORMATS: Mapping[str, dict[str, Any]] = {
    "png": {},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
"""Formats of figures by suffix, and metadata that is omitted."""
VECTOR_TEXT: Any = {
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "saccade",
}
"""Settings for editable text in vector graphics, and reproducible names in SVG."""

BLUE = "#0072b2"
"""Blue of Okabe & Ito (2008), whose colors suit every common color-vision deficiency."""
ORANGE = "#e69f00"
"""Orange of Okabe & Ito."""
GREEN = "#009e73"
"""Bluish green of Okabe & Ito."""
RED = "#d55e00"
"""Vermilion of Okabe & Ito."""
GRAY = "#7f7f7f"
HEAT = "cividis"
"""Colormap of nonnegative values, perceptually uniform and suited to red-green deficiency."""
DIVERGING = "PuOr_r"
"""Colormap of signed values, suited to red-green deficiency."""
SIGMAS = 3.0
"""Half-width of the band of one variable, in standard deviations: 99.73 %."""


def rgb_levels(color: str) -> tuple[int, int, int]:
    """A color as three levels of 0 to 255."""
    red, green, blue = (round(255 * part) for part in to_rgb(color))
    return red, green, blue


def picture_axes(axes: Axes, title: str) -> None:
    """A title, and neither ticks nor frame: for photographs and maps."""
    axes.set_title(title, fontsize=10)
    axes.set_axis_off()
    for axis in (axes.xaxis, axes.yaxis):  # else the title waits for ticks that are not drawn
        axis.set_visible(False)


def draw_panel(axes: Axes, image: npt.NDArray[Any], title: str, **options: Any) -> None:
    """An image or a map under its title; options are passed to `Axes.imshow`."""
    axes.imshow(image, **options)
    picture_axes(axes, title)


def hide_ticks(axes: Axes) -> None:
    """Neither ticks nor frame; title and axis labels stay."""
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


def grid_axes(axes: Axes) -> None:
    """A light grid in the background, and no frame."""
    axes.grid(color="0.92", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(color="0.7", labelcolor="0.3", labelsize=9)
    axes.spines[:].set_visible(False)


def faded(image: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """(H, W) pale gray, a background for drawings; `image` is (H, W, 3) in [0, 1]."""
    return np.asarray(0.35 + 0.65 * image.mean(axis=2), np.float32)


def figure_for(
    width: int,
    height: int,
    columns: int = 1,
    rows: int = 1,
    panel: float = 4.0,
    dpi: float = 110.0,
) -> Figure:
    """Figure of `columns` x `rows` panels with the aspect ratio of an image.

    Args:
        width: width of the image, in pixels.
        height: height of the image, in pixels.
        columns: panels side by side.
        rows: panels stacked vertically.
        panel: the longer side of one panel, in inches.
        dpi: resolution in pixels per inch.
    """
    scale = panel / max(width, height)
    size = (columns * max(width * scale, 1.2) + 0.2, rows * (max(height * scale, 0.6) + 0.35))
    return Figure(figsize=size, layout="compressed", dpi=dpi)


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Writes a figure atomically, in the format of the suffix.

    The text of an SVG or a PDF stays text, and the same figure gives the same bytes.

    Raises:
        OutputError: the file cannot be written.
    """
    path = Path(path)
    metadata = FIGURE_FORMATS.get(path.suffix.lower().removeprefix("."))
    with atomic_write(path) as temporary, rc_context(VECTOR_TEXT):
        figure.savefig(temporary, facecolor="white", metadata=metadata)
    return path


def save_figures(figure: Figure, path: str | Path, formats: Sequence[str]) -> Path:
    """Writes a figure in each of several `FIGURE_FORMATS`, whose suffix is added to `path`.

    Returns:
        The file of the first format.

    Raises:
        OutputError: a file cannot be written.
    """
    first, *_ = [save_figure(figure, f"{path}.{each}") for each in formats]
    return first
