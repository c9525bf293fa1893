"""Sheets of paper with tags to print."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Outline

from saccade.io.files import atomic_write
from saccade.types import BoolArray

A4 = (210.0, 297.0)
"""Width and height of a sheet in millimeters."""
INCH = 25.4
"""Millimeters per inch."""
RULER = 100.0
"""Length of the line that checks the scale of a print, in millimeters."""
PRINT_MARGIN = 5.0
"""Width of the margin that a printer leaves white, in millimeters."""


def write_tag_sheets(path: str | Path, tags: Sequence[tuple[str, BoolArray]], size: float) -> None:
    """Write a PDF with one tag on each page of A4, its label and its size.

    Args:
        path: the file.
        tags: label of each tag, and its cells (n, n), True where white.
        size: side of the black square in meters, at most `MAX_TAG_SIZE`.

    Raises:
        OutputError: the file cannot be written.
    """
    about = {"Creator": "saccade", "CreationDate": None}  # the same file for the same tags
    with atomic_write(path) as temporary, PdfPages(temporary, metadata=about) as pages:
        for label, cells in tags:
            pages.savefig(_sheet(label, cells, 1000 * size))


MAX_TAG_SIZE = (A4[0] - 2 * PRINT_MARGIN) / 1000
"""Largest side of a black square on a sheet, in meters."""


def _sheet(label: str, cells: BoolArray, side: float) -> Figure:
    """A page with a tag whose black square has a side in millimeters."""
    width, height = A4
    figure = Figure((width / INCH, height / INCH))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, height))
    axes.set_axis_off()
    cell, left = side / len(cells), (width - side) / 2
    top = height - left - PRINT_MARGIN
    corners = np.array([[0, 0], [1, 0], [1, -1], [0, -1], [0, 0]]) * cell
    squares = [
        Outline(corners + np.array([left + column * cell, top - row * cell]), closed=True)
        for row, column in np.argwhere(~cells).tolist()
    ]
    black = Outline.make_compound_path(*squares)
    axes.add_patch(PathPatch(black, facecolor="black", linewidth=0))
    bottom = top - side - max(cell, 12.0) - 6
    axes.text(width / 2, bottom, label, ha="center", va="top", fontsize=16)
    note = f"side of the black square: {side:g} mm; keep the white border, mount flat and upright"
    axes.text(width / 2, bottom - 9, note, ha="center", va="top", fontsize=9)
    line = Rectangle(((width - RULER) / 2, bottom - 20), RULER, 0.6, facecolor="black", linewidth=0)
    axes.add_patch(line)
    check = f"this line is {RULER:g} mm long if the page was printed at 100 %"
    axes.text(width / 2, bottom - 22, check, ha="center", va="top", fontsize=9)
    return figure
