"""Fixations: tables of any lab, EyeLink's and Tobii's recordings, and `.mat` files as of OSIE."""

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from saccade.datasets.eyelink import read_eyelink
from saccade.datasets.fixation_mat import read_mat_fixations
from saccade.datasets.fixation_positions import (
    AXES,
    Names,
    check_positions,
    image_sizes,
    is_outside,
    list_folder,
    resolve_images,
    to_image_pixels,
)
from saccade.datasets.fixation_tables import (
    ROLES,
    Box,
    FixationList,
    RawFixation,
    read_fixation_table,
)
from saccade.datasets.fixation_trials import number_trials
from saccade.datasets.tables import write_table
from saccade.errors import LogError, LogWarning, require
from saccade.io.files import atomic_write, is_file, natural_order
from saccade.types import BoolArray, FixationTable, FloatArray, IntArray

DURATION = "duration_ms"
TABLES = (".csv", ".tsv", ".txt")


@dataclass(frozen=True)
class FixationFormat:
    """Format of a file of fixations; defaults are detected."""

    columns: Mapping[str, str] = field(default_factory=dict)
    """Names of columns by their role: image, subject, index, trial, time, x, y, eye, duration."""
    shown: tuple[float, float] | None = None
    """Size of the images on the screen, in the units of x and y: (1, 1) if these are normalized.
    None for the size of the files in pixels."""
    offset: tuple[float, float] | None = None
    """x and y of the images' upper left corner; None for (0, 0)."""
    axes: str = "x,y"
    """Meanings of the columns x and y: "y,x" if they are exchanged, "x,-y" or "-x,y" if one of them
    points the other way."""
    checked: bool = True
    """Whether positions that cannot be in the pixels of the images are refused."""
    eye: Literal["left", "right"] | None = None
    """Eye to read where both are recorded. None for the one with more fixations."""
    trials: Literal["separate", "first", "joined"] | None = None
    """Of several trials of a subject on an image: each is a scanpath, only the first is read, or
    all are one scanpath. None refuses them."""

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

    A row with an empty cell, as of a blink, is left out, and so is one that repeats another, which
    is counted in a remark. `FixationTable.subject` is the subject's number, or, where subjects
    have names, the position of the name among them. `FixationTable.index` counts from 0, the
    first fixation of a scanpath, which is a trial of a subject on an image; where a file has
    times, or numbers that go on from image to image, it is the rank among its fixations.

    Args:
        path: a table separated by commas, semicolons or tabs, with columns of image, subject, x
            and y, and where it has them, index or time, and duration, by their usual names; an
            export of Tobii Pro Lab (.tsv); a recording of EyeLink (.asc); a .mat of structs, cells
            or matrices, such as OSIE's `fixations.mat` (Xu et al., Journal of Vision 2014); or a
            folder of tables and recordings, of a subject each where they do not name one.
        images: folder of the images: names without suffix are completed, and positions are
            converted to pixels of the images and checked; those outside their images are left out.
            None to take both as they are.
        form: columns of other names, and where images were on the screen.
        only_present: whether fixations on images that are not in the folder are left out.
        say: called with each remark on omissions and assumptions; a `LogWarning` by default.

    Returns:
        Fixations by image, subject and index.

    Raises:
        LogError: the file is missing or broken, with the line; a subject has several trials on an
            image, unless `form` says what to do with them; an image is absent, all of them,
            with `only_present`; or positions are not in the pixels of the images.
        ConfigError: a column that is not in the file.
        ImageError: an image cannot be read.
    """
    path, form = Path(path), form or FixationFormat()
    recording = _recording(path, form.columns, {"left": "L", "right": "R"}.get(form.eye or ""))
    fixations = _complete(path, _choose_trials(path, recording, form, say), say)
    image = np.array([each.image for each in fixations])
    xy = np.array([(each.x, each.y) for each in fixations]) @ np.array(AXES[form.axes]).T
    outside = np.zeros(len(xy), bool)
    if images is not None:
        folder = Path(images)
        image = resolve_images(image, folder)
        present = _present(path, image, folder, only_present, say)
        image, xy = image[present], xy[present]
        fixations = [each for each, kept in zip(fixations, present, strict=True) if kept]
        sizes = image_sizes(image, folder)
        boxes: Sequence[Box | None] = [each.box for each in fixations]
        if form.shown is not None or form.offset is not None:
            boxes = [Box(*(form.offset or (0, 0)), *(form.shown or ()))] * len(fixations)
        xy = to_image_pixels(xy, boxes, sizes)
        remark = check_positions(str(path), xy, sizes) if form.checked else ""
        if remark:
            say(remark)
        outside = is_outside(xy, sizes) & form.checked
        if outside.any():
            say(f"{path}: {outside.sum()} fixations outside their images are left out")
    subject = _subject_numbers(path, [each.subject for each in fixations], say)
    order = np.array([each.order for each in fixations])
    seconds = np.array([each.milliseconds for each in fixations]) / 1000
    trial = np.array([int(each.trial) for each in fixations])
    index = _indices(path, image, subject, trial, order, recording.order, say)
    duration = None if np.isnan(seconds).all() else seconds
    table = FixationTable(image, subject, index, xy, duration, trial if trial.any() else None)
    rows = np.lexsort((order, trial, subject, image))
    return table[rows[~outside[rows]]]


def _recording(
    path: Path, columns: Mapping[str, str], eye: str | None, subject: str | None = None
) -> FixationList:
    """The fixations of a file, or of all of those in a folder."""
    suffix = path.suffix.lower()
    if path.is_dir():
        return _recordings(path, columns, eye)
    if suffix == ".mat":
        return FixationList(read_mat_fixations(path), "index")
    if suffix != ".asc":
        return read_fixation_table(path, columns, subject, eye)
    foreign = ", ".join(sorted(columns.keys() - {"image"}))
    require(not foreign, "--columns", "image alone of an EyeLink recording", foreign)
    return read_eyelink(path, columns, eye)


def _recordings(folder: Path, columns: Mapping[str, str], eye: str | None) -> FixationList:
    files = [each for each in list_folder(folder) if each.suffix.lower() in (".asc", *TABLES)]
    if not files:
        raise LogError(f"{folder}: expected tables or recordings ({', '.join(TABLES)}, .asc)")
    parts = [_recording(each, columns, eye, each.stem) for each in files]
    for part, file in zip(parts, files, strict=True):
        part.fixations[:] = [e._replace(trial=f"{file.name} {e.trial}") for e in part.fixations]
    orders = {part.order for part in parts}
    if len(orders) > 1:
        found = " and some with ".join(sorted(orders))
        raise LogError(f"{folder}: expected files of one kind, found some with {found}")
    left_out = sum((Counter(part.left_out) for part in parts), Counter())
    return FixationList([each for part in parts for each in part.fixations], orders.pop(), left_out)


def _choose_trials(
    path: Path, recording: FixationList, form: FixationFormat, say: Callable[[str], None]
) -> FixationList:
    """The fixations of the chosen trials, whose names are their numbers."""
    found = [each for each in recording.fixations if np.isfinite([each.x, each.y]).all()]
    number = number_trials(found, recording.order)
    repeated = Counter(
        (each.subject, each.image) for each, n in zip(found, number, strict=True) if n
    )
    if repeated and form.trials is None:
        subject, image = next(iter(repeated))
        raise LogError(
            f"{path}: expected one trial of a subject on an image, found several of {subject} on "
            f"{image}" + f" and {len(repeated) - 1} more" * (len(repeated) > 1) + "; --trials "
            "separate makes each a scanpath, first takes the first, joined makes them one"
        )
    if form.trials == "joined":
        number[:] = 0
    kept = [
        each._replace(trial=str(n))
        for each, n in zip(found, number, strict=True)
        if n == 0 or form.trials == "separate"
    ]
    reason = "in later trials of a subject on an image"
    blank = "with an empty cell, as of a blink,"
    left_out = {reason: len(found) - len(kept), blank: len(recording.fixations) - len(found)}
    return recording._replace(fixations=kept, left_out={**recording.left_out, **left_out})


def _complete(path: Path, recording: FixationList, say: Callable[[str], None]) -> list[RawFixation]:
    """The fixations with a position, each once."""
    found = recording.fixations
    if not found:
        raise LogError(f"{path}: expected at least one fixation, found none")
    order = recording.order
    once = {
        (
            *(each.image, each.subject, each.trial, each.x, each.y),
            str(each.milliseconds) if order == "row" else each.order,
        ): each
        for each in reversed(found)
    }
    if order == "row":
        say(f"{path}: neither index nor time is a column; the order is that of the rows")
    repeated = len(found) - len(once)
    kept = len(once) - len({(e.image, e.subject, e.trial, e.order) for e in once.values()})
    counts = {f"fixations {why} are left out": n for why, n in recording.left_out.items()} | {
        f"rows that repeat another (of the same {order}) are left out": repeated,
        f"fixations have the image, subject and {order} of another and are kept": kept,
    }
    for remark, count in counts.items():
        if count:
            say(f"{path}: {count} {remark}")
    return [*reversed(once.values())]


def _present(
    path: Path, image: Names, images: Path, only_present: bool, say: Callable[[str], None]
) -> BoolArray:
    """(n,) whether the file of an image is in the folder."""
    names = np.unique(image)
    absent = [name for name in names if not is_file(images / name)]
    if absent:
        found = f"{len(absent)} of the {len(names)} images of {path} are not in {images}"
        if len(absent) == len(names):
            raise LogError(f"{found}, {absent[0][:80]} first")
        if not only_present:
            raise LogError(f"{found}, {absent[0][:80]} first; --only-present leaves them out")
        say(f"{found} and are left out")
    return np.asarray(~np.isin(image, absent))


def _subject_numbers(path: Path, subjects: Sequence[str], say: Callable[[str], None]) -> IntArray:
    """(n,) numbers of subjects; for names, their positions in the order of the numbers in them."""
    names = sorted(set(subjects), key=natural_order)
    if all(name.isascii() and name.isdecimal() and len(name) < 19 for name in names):
        return np.array([int(subject) for subject in subjects])
    numbers = {name: number for number, name in enumerate(names)}
    shown = ", ".join(names if len(names) <= 20 else [*names[:3], "...", names[-1]])
    say(f"{path}: the subjects are numbered from 0 in this order: {shown}")
    return np.array([numbers[subject] for subject in subjects])


def _indices(
    path: Path,
    image: Names,
    subject: IntArray,
    trial: IntArray,
    order: FloatArray,
    kind: str,
    say: Callable[[str], None],
) -> IntArray:
    """(n,) numbers of the fixations of a scanpath, from 0; see `read_fixations`."""
    by = np.lexsort((order, trial, subject, image))
    new = np.ones(len(by), bool)
    keys = [key[by] for key in (image, subject, trial)]
    new[1:] = np.any([key[1:] != key[:-1] for key in keys], axis=0)
    first = order[by][new]
    base = first.min()
    if kind == "index" and base in (0, 1) and np.mean(first == base) >= 0.5:
        if base == 1:
            say(f"{path}: the index counts from 1, the first fixation of a subject on an image")
        return np.asarray(order - base).astype(np.int64)
    rank = np.empty(len(by), np.int64)
    rank[by] = np.arange(len(by)) - np.flatnonzero(new)[np.cumsum(new) - 1]
    return rank


def write_fixations(path: str | Path, table: FixationTable, **columns: npt.NDArray[Any]) -> None:
    """Write fixations as `read_fixations` reads them.

    Args:
        path: .csv, a row for each fixation: image, subject, index, x, y, duration_ms (empty where
            unknown) and further columns; or .mat, in OSIE's layout: a cell array `fixations` with
            `img` and a cell array `subjects` for each image, and `subject`, `fix_x`, `fix_y`,
            `fix_duration` (ms) and further fields `fix_NAME` for each subject. Written whole or
            not at all; an old file is replaced.
        table: fixations, of each subject in their order.
        columns: (n,) further numbers, by name.

    Raises:
        ConfigError: another suffix.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    require(path.suffix in (".csv", ".mat"), "path", "a .csv or .mat", str(path))
    x, y = table.xy.T
    unknown = np.full(len(table), np.nan)
    milliseconds = unknown if table.duration is None else 1000 * table.duration
    if path.suffix == ".csv":
        keys = {"image": table.image, "subject": table.subject, "index": table.index}
        if table.trial is not None:
            keys["trial"] = table.trial
        write_table(path, keys | {"x": x, "y": y, DURATION: milliseconds} | columns)
        return
    from scipy.io import savemat  # slow to import

    fields = {"x": x, "y": y, "duration": milliseconds} | columns
    images = []
    for name in np.unique(table.image):
        own = np.flatnonzero(table.image == name)
        subjects = []
        paths = table[own].scanpath
        for rows in (own[paths == path] for path in np.unique(paths)):
            numbers = {f"fix_{key}": values[rows] for key, values in fields.items()}
            subjects.append({"subject": table.subject[rows[0]], **numbers})
        images.append({"img": str(name), "subjects": np.array(subjects, object)})
    with atomic_write(path) as temporary:
        content = {"fixations": np.array(images, object)}
        savemat(temporary, content, do_compression=True, oned_as="column")
