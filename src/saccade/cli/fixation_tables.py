"""Options for fixation tables, which several commands score."""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from math import inf, isnan
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from saccade.cli.options import INPUT, Options
from saccade.cli.output import print_message
from saccade.datasets.fixations import FixationFormat, read_fixations
from saccade.datasets.fixations.formats import FORMATS
from saccade.datasets.fixations.placement import UNITS
from saccade.datasets.tables import is_number
from saccade.errors import ConfigError, LogError, setting
from saccade.evaluation.fixations import FixationScores
from saccade.evaluation.prediction import FixationData

PLACE = "native, centered, fit or stretch, with the WIDTH,HEIGHT of the screen"
PLACEMENT = Parameter(
    consume_multiple=True,
    metavar="PLACE WIDTH,HEIGHT",
    help="Place of each image on a screen, by its own size: native (in the upper left corner), "
    "centered, fit (scaled to the screen with its aspect, in the middle) or stretch, and the size "
    "of the screen in pixels, unless the recording has it; x and y are positions on the screen.",
)
FIXATIONS = (
    f"Fixations: {'; '.join(each.summary for each in reversed(FORMATS.values()))}; "
    "or a folder of such files."
)
PIXELS_PER_DEGREE = 24.0
"""Pixels per degree of visual angle by default: that of OSIE."""
MAX_SCREEN_SIDE = 1e6
"""Maximum number of pixels along a side of a screen."""
SCORES = ("AUC", "sAUC", "NSS", "CC", "SIM", "KL", "IG (bit)")
"""Columns of tables: the fields of `FixationScores`."""


def score_cells(scores: FixationScores) -> list[str]:
    """A row of `SCORES`."""
    return ["" if isnan(value) else f"{value:.3f}" for value in astuple(scores)]


@dataclass(frozen=True, kw_only=True)
class FixationOptions(Options):
    """Photographs, recorded fixations, and the format of the recordings."""

    images: Annotated[Path, INPUT, Parameter(metavar="DIR")]
    """Folder of the images."""
    fixations: Annotated[Path, INPUT, Parameter(help=FIXATIONS)]
    drop: Annotated[int, INPUT] = setting(1, 0)
    """Leave out the first N fixations of each scanpath."""
    columns: Annotated[str | None, INPUT, Parameter(metavar="KEY=NAME,...")] = None
    """Names of columns that differ from image, subject, index, trial, time, x, y, eye, duration.
    Example: subject=code,x=gx"""
    xy: Annotated[str | None, INPUT, Parameter(metavar="UNIT")] = None
    """Units of x and y: normalized; WIDTH,HEIGHT, the size of the images on the screen; norm,
    height, pix or deg, PsychoPy's units about the center, with y up; or pixels of the images,
    unchecked."""
    placement: Annotated[list[str] | None, INPUT, PLACEMENT] = None
    offset: Annotated[str | None, INPUT, Parameter(metavar="X,Y")] = None
    """Upper left corner of the images on the screen, if x and y are screen positions."""
    axes: Annotated[Literal["x,y", "y,x", "x,-y", "-x,y"], INPUT] = "x,y"
    """Order and signs of the axes: y,x if exchanged (row, column), x,-y or -x,y if an axis is
    reversed."""
    eye: Annotated[Literal["left", "right"] | None, INPUT] = None
    """Eye to read if both are recorded; by default the mean of both."""
    trials: Annotated[Literal["separate", "first", "joined"] | None, INPUT] = None
    """Treatment of repeated trials of a subject on an image: one scanpath each (separate), only the
    first, or one scanpath in all (joined)."""
    only_present: Annotated[bool, INPUT] = False
    """Ignore fixations on images that are missing."""

    pixels_per_degree: Annotated[str | None, INPUT, Parameter(metavar="N")] = None
    """Image pixels per degree of visual angle, by default 24, which is also the blur of the
    fixations: a number, WIDTHxHEIGHT=N for each image size, separated by commas, or a percentage of
    the width (3%)."""

    def data(self) -> FixationData:
        """Fixations inside their images, blurred by a degree of visual angle; prints remarks."""
        per_degree = self.pixels_per_degree
        blur = PIXELS_PER_DEGREE if per_degree is None else degree_sizes(per_degree)
        form = fixation_format(
            self.columns, self.xy, self.offset, self.placement or (), self.pixels_per_degree
        )
        form = replace(form, axes=self.axes, eye=self.eye, trials=self.trials)
        table = read_fixations(
            self.fixations, self.images, form, only_present=self.only_present, say=print_message
        )
        if not (table.index >= self.drop).any():
            raise LogError(
                f"{self.fixations}: every fixation is among the first {self.drop}; lower --drop"
            )
        found = FixationData.of(table, self.images, self.drop, blur)
        sizes = len(set(found.sizes.values()))
        if sizes > 1 and per_degree is None:
            print_message(
                f"fixations are blurred by {PIXELS_PER_DEGREE:g} pixels on images of {sizes} "
                "sizes; --pixels-per-degree sets one degree for each size"
            )
        if found.outside:
            print_message(f"{found.outside} fixations outside their images are left out")
        return found


def degree_sizes(text: str) -> Callable[[tuple[int, int]], float]:
    """Parse --pixels-per-degree into a function from image (H, W) to pixels per degree.

    Raises:
        ConfigError: malformed text; or, when the function is called, an image size that it lacks.
    """
    expected = "--pixels-per-degree: expected N, WIDTHxHEIGHT=N,... or N% of the widths, found"
    pairs = [pair.partition("=") for pair in text.split(",")] if "=" in text else [("", "", text)]
    try:
        values = {size.strip(): float(number.rstrip("%")) for size, _, number in pairs}
    except ValueError:
        values = {}
    if not values or not all(0 < value < MAX_SCREEN_SIDE for value in values.values()):
        raise ConfigError(f"{expected} {text!r}")

    def of_size(size: tuple[int, int]) -> float:
        if text.endswith("%"):
            return values[""] / 100 * size[1]
        name = f"{size[1]}x{size[0]}"
        if "" not in values and name not in values:
            raise ConfigError(f"{expected} none for {name}")
        return values.get(name, values.get("", inf))

    return of_size


def fixation_format(
    columns: str | None,
    xy: str | None = None,
    offset: str | None = None,
    placement: Sequence[str] = (),
    pixels_per_degree: str | None = None,
) -> FixationFormat:
    """Fixation format from --columns, --xy, --offset, --placement and --pixels-per-degree.

    Raises:
        ConfigError: an option is malformed.
    """
    pairs = [pair.partition("=") for pair in columns.split(",")] if columns else []
    if not all(key and name for key, _, name in pairs):
        raise ConfigError(f"--columns: expected KEY=NAME,KEY=NAME, found {columns!r}")
    named = {key.strip(): name.strip() for key, _, name in pairs}
    shown, unit, degree = None, None, None
    if xy == "normalized":
        shown = (1.0, 1.0)
    elif xy in UNITS:
        unit, number = xy, (pixels_per_degree or "").strip()
        degree = float(number) if is_number(number) else None
    elif xy is not None and xy != "pixels":
        shown = _two_numbers(xy, "--xy", f"normalized, {', '.join(UNITS)}, pixels or WIDTH,HEIGHT")
    corner = None if offset is None else _two_numbers(offset, "--offset", "X,Y")
    place, *size = " ".join(placement).replace(":", " ").split() or [""]
    if len(size) > 1:
        raise ConfigError(f"--placement: expected {PLACE}, found {' '.join(placement)!r}")
    return FixationFormat(
        named,
        shown,
        corner,
        unit=unit,
        placement=place or None,
        screen=_two_numbers(size[0], "--placement", PLACE) if size else None,
        pixels_per_degree=degree,
        checked=xy != "pixels",
    )


def _two_numbers(text: str, option: str, expected: str) -> tuple[float, float]:
    try:
        first, second = (float(number) for number in text.split(","))
    except ValueError:
        first = second = inf
    if not (abs(first) < MAX_SCREEN_SIDE and abs(second) < MAX_SCREEN_SIDE):
        raise ConfigError(f"{option}: expected {expected}, found {text!r}")
    return first, second
