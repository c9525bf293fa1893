"""The fixations that commands score, and how they are to be read."""

from math import inf
from pathlib import Path

from saccade.cli.output import print_message
from saccade.datasets.fixations import FixationFormat, read_fixations
from saccade.errors import ConfigError
from saccade.types import FixationTable

LARGEST = 1e6
"""Bound on pixels of a screen."""


def load_fixations(
    file: Path, images: Path, form: FixationFormat, only_present: bool
) -> FixationTable:
    """The fixations of a file on the images of a folder; remarks are printed."""
    return read_fixations(file, images, form, only_present=only_present, say=print_message)


def fixation_format(columns: str | None, xy: str | None, offset: str | None) -> FixationFormat:
    """The format that --columns, --xy and --offset say.

    Raises:
        ConfigError: one of them is not of its form.
    """
    pairs = [pair.partition("=") for pair in columns.split(",")] if columns else []
    if not all(key and name for key, _, name in pairs):
        raise ConfigError(f"--columns: expected KEY=NAME,KEY=NAME, found {columns!r}")
    named = {key.strip(): name.strip() for key, _, name in pairs}
    shown = None
    if xy == "normalized":
        shown = (1.0, 1.0)
    elif xy not in (None, "pixels"):
        shown = _two_numbers(xy, "--xy", "normalized, pixels or WIDTH,HEIGHT")
    corner = None if offset is None else _two_numbers(offset, "--offset", "X,Y")
    return FixationFormat(named, shown, corner, checked=xy != "pixels")


def _two_numbers(text: str, option: str, expected: str) -> tuple[float, float]:
    try:
        first, second = (float(number) for number in text.split(","))
    except ValueError:
        first = second = inf
    if not (abs(first) < LARGEST and abs(second) < LARGEST):
        raise ConfigError(f"{option}: expected {expected}, found {text!r}")
    return first, second
