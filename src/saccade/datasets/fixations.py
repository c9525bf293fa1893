"""Fixations in tables, EyeLink and Tobii recordings, and `.mat` files such as OSIE's."""

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from saccade.datasets.eyelink import read_eyelink
from saccade.datasets.fixation_mat import read_mat_fixations
from saccade.datasets.fixation_positions import (
    AXES,
    check_positions,
    image_sizes,
    is_outside,
    list_folder,
    resolve_images,
    to_image_pixels,
)
from saccade.datasets.fixation_tables import (
    ROLES,
    FixationList,
    RawFixations,
    read_fixation_table,
    rows_by,
)
from saccade.datasets.fixation_trials import merge_eyes, number_trials
from saccade.datasets.tables import write_table
from saccade.errors import LogError, LogWarning, require
from saccade.io.files import is_file, natural_order
from saccade.types import BoolArray, FixationTable, IntArray

DURATION = "duration_ms"
TABLES = (".csv", ".tsv", ".txt")


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
        if self.shown is not None:
            require(min(self.shown) > 0, "--xy", "a width and a height", self.shown)


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
    name. `FixationTable.index` counts from 0 for the first fixation of a scanpath, which is a trial
    of a subject on an image; for files with times, or with indices that continue from image to
    image, it is the rank within the scanpath.

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
    raw, order, remarks = _recording(path, form.columns)
    known = np.asarray(np.isfinite(raw.xy).all(axis=1))
    remarks["fixations with an empty cell, as of a blink, are left out"] += int((~known).sum())
    raw = merge_eyes(raw[known], order, form.eye and form.eye[0].upper(), remarks)
    raw = _choose_trials(path, raw, order, form.trials, remarks)
    raw = _distinct(raw, order, remarks)
    if order == "row":
        say(f"{path}: neither index nor time is a column; the order is that of the rows")
    for remark, count in (+remarks).items():
        say(f"{path}: {count} {remark}")
    if len(raw) == 0:
        raise LogError(f"{path}: expected at least one fixation, found none")
    raw = replace(raw, xy=raw.xy @ np.array(AXES[form.axes]).T)
    outside = np.zeros(len(raw), bool)
    if images is not None:
        raw, outside = _on_images(path, raw, Path(images), form, only_present, say)
    subject = _subject_numbers(path, raw.subject.tolist(), say)
    index = _indices(path, raw, order, say)
    seconds = None if np.isnan(raw.milliseconds).all() else raw.milliseconds / 1000
    trial = raw.trial if raw.trial.any() else None
    table = FixationTable(raw.image, subject, index, raw.xy, seconds, trial)
    rows = np.lexsort((raw.order, raw.trial, subject, raw.image))
    return table[rows[~outside[rows]]]


def _recording(path: Path, columns: Mapping[str, str], subject: str = "") -> FixationList:
    """The fixations of a file, or of all files in a folder."""
    suffix = path.suffix.lower()
    if suffix == ".mat":
        return FixationList(read_mat_fixations(path), "index", Counter())
    if suffix == ".asc":
        foreign = ", ".join(sorted(columns.keys() - {"image"}))
        require(not foreign, "--columns", "image alone of an EyeLink recording", foreign)
        return read_eyelink(path, columns)
    if not path.is_dir():
        return read_fixation_table(path, columns, subject)
    files = [each for each in list_folder(path) if each.suffix.lower() in (".asc", *TABLES)]
    if not files:
        raise LogError(f"{path}: expected tables or recordings ({', '.join(TABLES)}, .asc)")
    lists = [_recording(each, columns, each.stem) for each in files]
    orders = sorted({each.order for each in lists})
    if len(orders) > 1:
        found = " and some with ".join(orders)
        raise LogError(f"{path}: expected files of one kind, found some with {found}")
    parts = [
        replace(found, trial=np.array([f"{file.name} {name}" for name in found.trial.tolist()]))
        for file, (found, *_) in zip(files, lists, strict=True)
        if len(found)
    ]
    every = RawFixations.concatenate(parts) if parts else RawFixations.of([])
    return FixationList(every, orders[0], sum((each.remarks for each in lists), Counter()))


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
    raw: RawFixations,
    folder: Path,
    form: FixationFormat,
    only_present: bool,
    say: Callable[[str], None],
) -> tuple[RawFixations, BoolArray]:
    """The fixations in pixels of the images of a folder, and (n,) True if outside."""
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
    sizes, boxes = image_sizes(raw.image, folder), raw.box
    if form.shown is not None or form.offset is not None:
        box = (*(form.offset or (0, 0)), *(form.shown or (np.nan, np.nan)), 0)
        boxes = np.tile(box, (len(raw), 1))
    raw = replace(raw, xy=to_image_pixels(raw.xy, boxes, sizes))
    if not form.checked:
        return raw, np.zeros(len(raw), bool)
    if remark := check_positions(str(path), raw.xy, sizes):
        say(remark)
    outside = is_outside(raw.xy, sizes)
    if outside.any():
        say(f"{path}: {outside.sum()} fixations outside their images are left out")
    return raw, outside


def _subject_numbers(path: Path, subjects: Sequence[str], say: Callable[[str], None]) -> IntArray:
    """(n,) numbers of subjects; for names, their rank in natural sort order."""
    names = sorted(set(subjects), key=natural_order)
    if all(name.isascii() and name.isdecimal() and len(name) < 19 for name in names):
        return np.array([int(subject) for subject in subjects])
    numbers = {name: number for number, name in enumerate(names)}
    shown = ", ".join(names if len(names) <= 20 else [*names[:3], "...", names[-1]])
    say(f"{path}: the subjects are numbered from 0 in this order: {shown}")
    return np.array([numbers[subject] for subject in subjects])


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
    keys = {"image": table.image, "subject": table.subject, "index": table.index}
    if table.trial is not None:
        keys["trial"] = table.trial
    milliseconds = unknown if table.duration is None else 1000 * table.duration
    write_table(path, keys | {"x": x, "y": y, DURATION: milliseconds} | columns)
