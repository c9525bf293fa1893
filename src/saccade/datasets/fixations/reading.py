"""Fixations of any format as one table, in pixels of their images."""

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from saccade.datasets.fixations.checks import AXES, check_positions, is_outside, matrix_of
from saccade.datasets.fixations.exports import (
    ROLES,
    FixationList,
    RawFixations,
    Texts,
    rows_by,
)
from saccade.datasets.fixations.formats import read_recording
from saccade.datasets.fixations.placement import (
    PLACEMENTS,
    UNITS,
    from_center,
    image_sizes,
    placed,
    require_aspect,
    resolve_images,
    to_image_pixels,
)
from saccade.datasets.fixations.trials import merge_eyes, number_trials
from saccade.datasets.tables import write_table
from saccade.errors import LogError, LogWarning, require
from saccade.io.files import is_file, natural_order
from saccade.types import BoolArray, FixationTable, FloatArray, IntArray

DURATION = "duration_ms"
DIGITS = {"x": 3, "y": 3, DURATION: 3}
"""Number of decimals in written tables."""


@dataclass(frozen=True)
class FixationFormat:
    """Format of a file of fixations; defaults are detected."""

    columns: Mapping[str, str] = field(default_factory=dict)
    """Names of columns by their role: image, subject, index, trial, time, x, y, eye, duration."""
    shown: tuple[float, float] | None = None
    """Size of the images on the screen, in the units of x and y; (1, 1) for normalized positions.
    None for the size of the image files in pixels."""
    offset: tuple[float, float] | None = None
    """x and y of the images' upper left corner; None for (0, 0)."""
    unit: str | None = None
    """Unit of x and y about the center of the screen, with y up, by PsychoPy's name: "norm" (-1 to
    1), "height" (of the screen), "pix" or "deg"; None for positions as `shown` describes them."""
    placement: str | None = None
    """Place of each image on the screen, by its own size: "native" (in the upper left corner),
    "centered", "fit" (scaled to the screen with its aspect) or "stretch"; see `placed`. None if x
    and y are relative to the image; with `unit`, for an image in the middle, which has the size of
    the screen for "norm", and its height for "height"."""
    screen: tuple[float, float] | None = None
    """Width and height of the screen in pixels, for `placement`; None for that of the recording."""
    pixels_per_degree: float | None = None
    """Image pixels per degree of visual angle, for the unit "deg"."""
    axes: str = "x,y"
    """Order and signs of the columns x and y: "y,x" if they are exchanged, "x,-y" or "-x,y" if an
    axis is reversed."""
    checked: bool = True
    """Whether to reject positions that cannot be pixels of the images."""
    eye: Literal["left", "right"] | None = None
    """Eye to read if both are recorded. None averages both eyes, or selects the eye with more
    fixations if the second eye has less than half as many."""
    trials: Literal["separate", "first", "joined"] | None = None
    """Treatment of repeated trials of a subject on an image: one scanpath each, only the first, or
    one scanpath in all. None rejects repeated trials."""

    def __post_init__(self) -> None:
        """Check the settings."""
        unknown = sorted(self.columns.keys() - set(ROLES))
        require(self.axes in AXES, "--axes", f"one of {' '.join(AXES)}", self.axes)
        known = self.trials in (None, "separate", "first", "joined")
        require(known, "--trials", "separate, first or joined", self.trials)
        require(not unknown, "--columns", f"names of {', '.join(ROLES)}", ", ".join(unknown))
        require(self.unit in (None, *UNITS), "--xy", f"one of {', '.join(UNITS)}", self.unit)
        places = f"one of {', '.join(PLACEMENTS)}"
        require(self.placement in (None, *PLACEMENTS), "--placement", places, self.placement)
        for name, size in (("--xy", self.shown), ("--placement", self.screen)):
            if size is not None:
                require(min(size) > 0, name, "a width and a height", size)
        given = self.placement is not None and (self.shown is not None or self.offset is not None)
        require(not given, "--placement", "no --offset and no WIDTH,HEIGHT in --xy", self.placement)
        degrees = self.unit != "deg" or (self.pixels_per_degree or 0) > 0
        expected = "a number of pixels, for --xy deg"
        require(degrees, "--pixels-per-degree", expected, self.pixels_per_degree)


def _warn(message: str) -> None:
    warnings.warn(message, LogWarning, stacklevel=4)


def read_fixations(
    path: str | Path,
    images: str | Path | None = None,
    form: FixationFormat | None = None,
    *,
    only_present: bool = False,
    say: Callable[[str], None] = _warn,
) -> FixationTable:
    """The fixations in a file, or in all files of a folder.

    Rows with an empty cell, for example blinks, and repeated rows are left out and counted in a
    remark. `FixationTable.subject` is the subject's number or, for named subjects, the rank of the
    name, which is in `FixationTable.name`. `FixationTable.index` counts from 0 for the first
    fixation of a scanpath, which is a trial of a subject on an image; for files with times, or with
    indices that continue from image to image, it is the rank within the scanpath.

    Args:
        path: a table separated by commas, semicolons or tabs, with columns for image, subject, x
            and y, and optionally index or time, and duration, under their usual names; a Tobii Pro
            Lab export (.tsv); an EyeLink recording (.asc); a .mat file of structs, cells or
            matrices, such as OSIE's `fixations.mat` (Xu et al., Journal of Vision 2014); or a
            folder of tables and recordings, with one subject per file unless the files name
            subjects.
        images: folder of the images. Names without suffix are completed; positions are converted to
            pixels of the images and checked, and fixations outside their images are left out. None
            leaves names and positions unchanged.
        form: names of columns, and positions of the images on the screen.
        only_present: whether to ignore fixations on images missing from the folder.
        say: function that receives remarks on omissions and assumptions; by default it issues a
            `LogWarning`.

    Returns:
        Fixations by image, subject and index.

    Raises:
        LogError: the file is missing or broken, with the line; a subject repeats an image without a
            choice in `form.trials`; an image is missing, or all images with `only_present`; or
            positions are not pixels of the images.
        ConfigError: a column is missing from the file.
        ImageError: an image cannot be read.
    """
    path, form = Path(path), form or FixationFormat()
    recording = read_recording(path, form.columns)
    raw, order, remarks, _ = recording
    known = np.asarray(np.isfinite(raw.xy).all(axis=1))
    remarks["fixations with an empty cell, as of a blink, are left out"] += int((~known).sum())
    raw = merge_eyes(raw[known], order, form.eye and form.eye[0].upper(), remarks)
    raw = _choose_trials(path, raw, order, form.trials, remarks)
    raw = _distinct(raw, order, remarks)
    if order == "row":
        say(f"{path}: neither index nor time is a column; the order is that of the rows")
    if order == "none":
        say(f"{path}: the fixations have no order; --drop 0 leaves out none")
    for remark, count in (+remarks).items():
        say(f"{path}: {count} {remark}")
    if len(raw) == 0:
        raise LogError(f"{path}: expected at least one fixation, found none")
    outside = np.zeros(len(raw), bool)
    if images is not None:
        found = recording._replace(fixations=raw)
        raw, outside = _on_images(path, found, Path(images), form, only_present, say)
    else:
        raw = replace(raw, xy=raw.xy @ matrix_of(form.axes))
    subject, names = _subject_numbers(raw.subject.tolist())
    index = _indices(path, raw, order, say)
    seconds = None if np.isnan(raw.milliseconds).all() else raw.milliseconds / 1000
    trial = raw.trial if raw.trial.any() else None
    table = FixationTable(raw.image, subject, index, raw.xy, seconds, trial, names)
    rows = np.lexsort((raw.order, raw.trial, subject, raw.image))
    return table[rows[~outside[rows]]]


def _choose_trials(
    path: Path, raw: RawFixations, order: str, chosen: str | None, remarks: Counter[str]
) -> RawFixations:
    """The fixations of the chosen trials, numbered; counts the others in `remarks`."""
    number = number_trials(raw, order)
    later = np.flatnonzero(number)
    if len(later) and chosen is None:
        several = len(rows_by(raw.image[later], raw.subject[later]))
        raise LogError(
            f"{path}: expected one trial of a subject on an image, found several of "
            f"{raw.subject[later[0]]} on {raw.image[later[0]]}"
            + f" and {several - 1} more"
            * (several > 1)
            + "; --trials separate makes each a scanpath, first takes the first, joined makes them "
            "one"
        )
    if chosen == "joined":
        number[:] = 0
    kept = (number == 0) | (chosen == "separate")
    remarks["fixations in later trials of a subject on an image are left out"] += int((~kept).sum())
    return replace(raw, trial=number)[kept]


def _distinct(raw: RawFixations, order: str, remarks: Counter[str]) -> RawFixations:
    """The fixations without repetitions, which are counted in `remarks`."""
    scanpath, number = (raw.image, raw.subject, raw.trial), raw.order
    by = raw.milliseconds if order == "row" else number
    first = np.sort([rows[0] for rows in rows_by(*scanpath, *raw.xy.T, by)]).astype(np.int64)
    once = raw[first]
    same = len(once) - len(rows_by(*(each[first] for each in (*scanpath, number))))
    remarks[f"rows that repeat another (of the same {order}) are left out"] += len(raw) - len(once)
    remarks[f"fixations have the image, subject and {order} of another and are kept"] += same
    return once


def _on_images(
    path: Path,
    recording: FixationList,
    folder: Path,
    form: FixationFormat,
    only_present: bool,
    say: Callable[[str], None],
) -> tuple[RawFixations, BoolArray]:
    """The fixations in pixels of the images of a folder, and (n,) True if outside."""
    raw = recording.fixations
    raw = replace(raw, image=resolve_images(raw.image, folder))
    names = np.unique(raw.image).tolist()
    absent = [name for name in names if not is_file(folder / name)]
    if absent:
        found = f"{len(absent)} of the {len(names)} images of {path} are not in {folder}"
        if len(absent) == len(names) or not only_present:
            cure = "; --only-present leaves them out" * (len(absent) < len(names))
            raise LogError(f"{found}, {absent[0][:80]} first{cure}")
        say(f"{found} and are left out")
        raw = raw[~np.isin(raw.image, absent)]
    sizes, given, unplaced = image_sizes(raw.image, folder), raw.xy, np.isnan(raw.box[:, 0]).all()
    raw = replace(raw, xy=_in_images(path, recording._replace(fixations=raw), sizes, form))
    if not form.checked:
        return raw, np.zeros(len(raw), bool)
    screen = form.screen or recording.screen
    if remark := check_positions(str(path), given, raw.xy, sizes, screen):
        say(remark)
    elif (
        unplaced
        and recording.screen
        and form
        == replace(FixationFormat(), eye=form.eye, trials=form.trials, columns=form.columns)
        and (sizes != recording.screen).any()
    ):
        width, height = recording.screen
        say(
            f"{path}: positions on the screen of {width:.0f} x {height:.0f} are taken as pixels of "
            "the images; --placement centered or fit moves them"
        )
    outside = is_outside(raw.xy, sizes)
    if outside.any():
        say(f"{path}: {outside.sum()} fixations outside their images are left out")
    return raw, outside


def _in_images(
    path: Path, recording: FixationList, sizes: FloatArray, form: FixationFormat
) -> FloatArray:
    """(n, 2) positions in pixels of images of width and height (n, 2)."""
    raw, screen = recording.fixations, form.screen or recording.screen
    xy, boxes = raw.xy @ matrix_of(form.axes), raw.box
    if form.placement is not None and screen is None:
        centered = form.placement == "centered" and form.unit in ("pix", "deg")
        expected = f"--placement {form.placement} WIDTH,HEIGHT, the size of the screen"
        require(centered, "--placement", expected, f"{form.placement} alone")
    if form.unit is not None:
        factor = (form.pixels_per_degree or 1.0) if form.unit == "deg" else 1.0
        own = form.placement is None or screen is None
        screens = sizes if own else np.broadcast_to(np.array(screen), sizes.shape)
        xy, boxes = from_center(xy * factor, form.unit, screens), np.full_like(boxes, np.nan)
    if form.placement is not None and screen is not None:
        boxes = placed(form.placement, screen, sizes)
    elif form.shown is not None or form.offset is not None:
        if form.shown is not None and form.checked:
            require_aspect(form.shown, sizes, str(path))
        box = (*(form.offset or (0, 0)), *(form.shown or (np.nan, np.nan)), 0)
        boxes = np.tile(box, (len(raw), 1))
    return to_image_pixels(xy, boxes, sizes)


def _subject_numbers(subjects: Sequence[str]) -> tuple[IntArray, Texts]:
    """(n,) number of each subject, and its name; names are numbered in natural sort order."""
    names = sorted(set(subjects), key=natural_order)
    if all(name.isascii() and name.isdecimal() and len(name) < 19 for name in names):
        numbers = {name: int(name) for name in names}
    else:
        numbers = {name: number for number, name in enumerate(names)}
    return np.array([numbers[subject] for subject in subjects]), np.array(subjects, np.str_)


def _indices(path: Path, raw: RawFixations, kind: str, say: Callable[[str], None]) -> IntArray:
    """(n,) index of each fixation in its scanpath, from 0; see `read_fixations`."""
    paths = rows_by(raw.image, raw.subject, raw.trial)
    first = np.array([raw.order[rows].min() for rows in paths])
    base = first.min()
    if kind == "index" and base in (0, 1) and np.mean(first == base) >= 0.5:
        if base == 1:
            say(f"{path}: the index counts from 1, the first fixation of a subject on an image")
        return np.asarray(raw.order - base).astype(np.int64)
    rank = np.empty(len(raw), np.int64)
    for rows in paths:
        rank[rows[np.argsort(raw.order[rows], kind="stable")]] = np.arange(len(rows))
    return rank


def write_fixations(path: str | Path, table: FixationTable, **columns: npt.NDArray[Any]) -> None:
    """Write fixations in a format that `read_fixations` reads.

    Args:
        path: .csv with one row per fixation: image, subject, index, x, y, duration_ms (empty if
            unknown) and additional columns.
        table: the fixations; each subject's fixations are in order.
        columns: (n,) additional numbers, by name.

    Raises:
        ConfigError: unknown suffix.
        OutputError: the file cannot be written.
    """
    require(Path(path).suffix == ".csv", "path", "a .csv", str(path))
    x, y = table.xy.T
    unknown = np.full(len(table), np.nan)
    subject = table.subject if table.name is None else table.name
    keys = {"image": table.image, "subject": subject, "index": table.index}
    if table.trial is not None:
        keys["trial"] = table.trial
    milliseconds = unknown if table.duration is None else 1000 * table.duration
    values = keys | {"x": x, "y": y, DURATION: milliseconds} | columns
    digits = DIGITS | dict.fromkeys(columns, 6)
    rounded = {
        name: np.asarray(np.round(each, digits[name])) if name in digits else each
        for name, each in values.items()
    }
    write_table(path, rounded)
