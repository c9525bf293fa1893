"""The colors and the manner of every figure; safe for color-blind readers."""

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saccade.files import atomic_write

BLUE, ORANGE, GREEN, RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"
"""After Okabe & Ito (2008), told apart under every common color-vision deficiency."""
GRAY = "#7f7f7f"
HEAT = "cividis"
"""Perceptually even, and the same to readers with and without red-green deficiency."""


def picture_axes(axes: Axes, title: str) -> None:
    """Leave only the title: a photograph needs no ticks."""
    axes.set_title(title, fontsize=10)
    axes.set_axis_off()


def figure_for(width: int, height: int, columns: int, rows: int, panel: float = 4.0) -> Figure:
    """A figure of `columns` x `rows` panels that have the shape of a width x height image.

    Args:
        width: of the image, in pixels.
        height: of the image, in pixels.
        columns: panels side by side.
        rows: panels one above the other.
        panel: the longer side of one panel, in inches.
    """
    scale = panel / max(width, height)
    size = (columns * max(width * scale, 1.2) + 0.2, rows * (max(height * scale, 0.6) + 0.35))
    return Figure(figsize=size, layout="compressed", dpi=110)


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure, whole or not at all; the suffix says the format.

    Raises:
        OutputError: the file cannot be written.
    """
    with atomic_write(path) as temporary:
        figure.savefig(temporary, facecolor="white")
    return Path(path)
