"""Fixations in tables of any laboratory, and in exports of eye trackers as tables.

Columns are identified by their usual names. The data exports of Tobii Pro Lab and Gazepoint
Analysis, described in their manuals, have one row per sample, with its fixation. The event exports
of SMI BeGaze have one row per fixation, saccade or blink.
"""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from saccade.datasets.tables import DETECTED, Row, TextTable, read_csv, read_rows
from saccade.errors import ConfigError, LogError, require
from saccade.io.files import IMAGE_SUFFIXES, decode_text, open_file, reading
from saccade.types import FloatArray, IntArray, Table

Texts = npt.NDArray[np.str_]
Box = tuple[float, float, float, float, bool]
"""Position of an image on the screen, in the units of the fixations: x and y of its upper left
corner, width and height (NaN for the size of the file), and True if x and y are the center
instead."""
NO_BOX: Box = (np.nan, np.nan, np.nan, np.nan, False)
"""Box for positions in pixels of the image."""


@dataclass(frozen=True, eq=False)
class RawFixations(Table):
    """n fixations before conversion, in the units of the file."""

    image: Texts
    subject: Texts
    order: FloatArray
    """(n,) index, time in the unit of the file, or row number."""
    xy: FloatArray
    """(n, 2) positions; NaN if missing, for example during a blink."""
    milliseconds: FloatArray
    """(n,) duration; NaN where unknown."""
    box: FloatArray
    """(n, 5) `Box`."""
    trial: npt.NDArray[Any]
    """(n,) name of the trial, empty if it has none; or its number."""
    eye: Texts
    """(n,) L or R; empty if unknown."""

    @classmethod
    def of(cls, rows: Iterable[tuple[Any, ...]]) -> Self:
        """The table for rows of image, subject, order, x, y, milliseconds, box, trial and eye."""
        columns = [*zip(*rows, strict=True)] or [()] * 9
        image, subject, trial, eye = (np.array(columns[i], np.str_) for i in (0, 1, 7, 8))
        order, x, y, milliseconds, box = (np.array(each, np.float64) for each in columns[2:7])
        xy = np.stack([x, y], axis=1)
        return cls(image, subject, order, xy, milliseconds, box.reshape(-1, 5), trial, eye)


class FixationList(NamedTuple):
    """The fixations of a file."""

    fixations: RawFixations
    order: str
    """Meaning of `RawFixations.order`: index, time or row; none if the file has no order."""
    remarks: Counter[str]
    """Number of fixations left out, by reason."""
    screen: tuple[float, float] | None = None
    """Width and height of the screen in pixels; None if unknown."""


def rows_by(*columns: npt.NDArray[Any]) -> list[IntArray]:
    """Row indices of each group with equal values in all columns (n,)."""
    codes = [np.unique(each, return_inverse=True)[1].reshape(-1) for each in columns]
    order = np.lexsort(codes[::-1])
    sorted_codes = np.stack(codes, axis=1)[order]
    starts = np.flatnonzero((sorted_codes[1:] != sorted_codes[:-1]).any(axis=1)) + 1
    return [np.sort(rows) for rows in np.split(order, starts) if len(rows)]


def _position_names(axis: str) -> str:
    parts = "pos|position|coord|coordinate|avg|mean|norm|screen"
    before = f"fix|fixation|currentfix|fixationposition|fixationpoint|gaze|{parts}"
    return f"({before})?{axis}|{axis}(fix|normalized|{parts})"


COLUMN_NAMES = {
    "image": "(image|img|stimulus|stimuli|stim|picture|pic|photo|photograph|scene|file)"
    "(id|file|filename|name|code|label|number|num|nr|no|index)?"
    "|filename|presentedstimulusname|(presented)?medianame",
    "subject": "(subject|subj|sub|viewer|participant|pp|observer|obs|person|user)"
    "(id|name|code|label|number|num|nr|no|index|key)?|sid"
    "|ppt|ppn|pid|recordingsessionlabel",
    "index": "(current)?fix(ation)?(index|number|order|id|num|nr|no)|index|order|fixation|nfix"
    "|rank",
    "trial": "(trial|session|block|run|repetition|presentation)"
    "(index|id|number|num|nr|no|label|name)?",
    "time": "(fix|fixation)?(onset|start)(time)?|(fix|fixation)starttime|currentfixstart|t|time"
    "|timestamp|timestart|begin|tstart|startt|recordingtimestamp",
    "x": _position_names("x"),
    "y": _position_names("y"),
    "eye": "eye(used|tracked|reported|recorded)?|(used|tracked|recorded)eye",
    "duration": "(current)?(fix|fixation)?(duration|dur)|(gazeevent|eyemovementevent)duration",
}
"""Patterns of usual column names, in letters and digits only."""
ROLES = tuple(COLUMN_NAMES)
UNITS = re.compile(r"(px|pix|pixels?|ms|msec|milliseconds|s|sec|seconds)$")
BLANK = ("", ".", "-", "na", "nan", "n/a", "none", "null")
"""Blank cells in lower case, as written by spreadsheets, R, MATLAB, pandas and EyeLink."""
SHORTEST = 10.0
"""Minimum median duration in milliseconds; smaller values are in seconds, since fixations last
between 10 ms and 10 s."""
THOUSANDS = re.compile(r"-?[1-9]\d{0,2},\d{3}")

Where = Mapping[str, Sequence[int]]
"""Column numbers by role."""


def _all_rows(path: Path, table: TextTable, keys: Sequence[str], where: Where) -> list[Row]:
    del path, keys, where
    return list(table.rows)


def _fixation_rows(path: Path, table: TextTable, keys: Sequence[str], where: Where) -> list[Row]:
    """The rows of BeGaze's events that are fixations on an image."""
    del path, where
    kinds = [column for column, key in enumerate(keys) if key in ("category", "eventtype")]
    return [
        row
        for row in table.rows
        if any(row.cells[kind].casefold().startswith(FIXATION_WORDS) for kind in kinds)
    ]


def _gazepoint_rows(path: Path, table: TextTable, keys: Sequence[str], where: Where) -> list[Row]:
    """One row per fixation on an image: its last valid sample, which has its whole duration."""
    del path
    image, number, valid = where["image"][0], keys.index("fpogid"), keys.index("fpogv")
    last: dict[tuple[str, ...], Row] = {}
    for row in table.rows:
        if row.cells[image] and number_in(row, valid) == 1:
            last[row.cells[image], row.cells[number]] = row
    return [*last.values()]


def _tobii_rows(path: Path, table: TextTable, keys: Sequence[str], where: Where) -> list[Row]:
    """One row per fixation on an image: its first sample with a position."""
    if TOBII_INDEX not in keys:
        raise LogError(f"{path}: expected the column Eye movement type index of Tobii's export")
    identity = [*where["subject"], *where["image"], *where["trial"], keys.index(TOBII_INDEX)]
    kind, image, x = keys.index("eyemovementtype"), where["image"][0], where["x"][0]
    first: dict[tuple[str, ...], Row] = {}
    for row in table.rows:
        if row.cells[kind] != "Fixation" or not row.cells[image]:
            continue
        key = tuple(row.cells[column] for column in identity)
        if key not in first or first[key].cells[x].casefold() in BLANK:
            first[key] = row
    return [*first.values()]


class Export(NamedTuple):
    """Layout of the tables of an eye tracker's software."""

    mark: tuple[str, ...] = ()
    """Keys of columns by which it is recognized."""
    columns: Mapping[str, tuple[str, ...]] = {}
    """Keys of columns by role, preferred ones first; the usual names for other roles."""
    rows: Callable[[Path, TextTable, Sequence[str], Where], list[Row]] = _all_rows
    """The rows of fixations."""
    normalized: tuple[str, ...] = ()
    """Keys of columns x whose values are fractions of the screen, which the image fills."""
    box: tuple[str, ...] = ()
    """Keys of the columns with the position of the image on the screen, and its size."""
    by_file: bool = False
    """Whether every file has one subject, named by the file, if no column has it."""

    def fits(self, keys: Collection[str]) -> bool:
        """Whether a table with columns of these keys has this layout."""
        return all(key in keys for key in self.mark)

    def columns_in(self, names: Sequence[str], keys: Sequence[str]) -> dict[str, str]:
        """Names of the columns by role."""
        found = {
            role: next((k for k in known if k in keys), None)
            for role, known in self.columns.items()
        }
        return {role: names[keys.index(key)] for role, key in found.items() if key is not None}


TOBII_INDEX = "eyemovementtypeindex"
FIXATION_WORDS = ("fixation", "visual intake")
PLAIN = Export()
"""A table of any laboratory."""
TOBII = Export(
    ("eyemovementtype",),
    {
        "image": ("presentedstimulusname", "presentedmedianame"),
        "subject": ("participantname",),
        "x": ("fixationpointxmcsnorm", "fixationpointxdacspx", "fixationpointx"),
        "y": ("fixationpointymcsnorm", "fixationpointydacspx", "fixationpointy"),
        "duration": ("gazeeventduration", "eyemovementeventduration"),
        "trial": ("recordingname",),
    },
    _tobii_rows,
    ("fixationpointxmcsnorm",),
    tuple(
        f"presentedmedia{key}" for key in ("positionxdacspx", "positionydacspx", "width", "height")
    ),
)
"""Tobii Pro Lab."""
GAZEPOINT = Export(
    ("fpogx", "fpogy", "fpogid", "fpogv"),
    {
        "image": ("medianame",),
        "x": ("fpogx",),
        "y": ("fpogy",),
        "time": ("fpogs",),
        "duration": ("fpogd",),
    },
    _gazepoint_rows,
    ("fpogx",),
    by_file=True,
)
"""Gazepoint Analysis: all samples, or fixations."""
BEGAZE = Export(
    ("stimulus", "fixationpositionxpx"),
    {
        "image": ("stimulus",),
        "subject": ("participant", "subject"),
        "x": ("fixationpositionxpx",),
        "y": ("fixationpositionypx",),
        "time": ("eventstarttrialtimems", "eventstartms", "starttrialtimems"),
        "duration": ("eventdurationms",),
        "index": ("index",),
        "eye": ("eyelr",),
    },
    _fixation_rows,
)
"""Event export of SMI BeGaze."""
EVENT_HEADER = "Table Header for Fixations"
"""Line of a list of events of SMI's IDF Event Detector."""
RECOGNITION_BYTES = 1 << 16
"""Number of bytes by which a format is recognized."""


def read_fixation_table(
    path: Path,
    columns: Mapping[str, str] | None = None,
    subject: str = "",
    *,
    export: Export = PLAIN,
) -> FixationList:
    """The fixations of a table, separated by commas, semicolons or tabs.

    Args:
        path: a file with a header; decimal commas are read if unambiguous.
        columns: names of columns by `ROLES`, if they differ from the usual names.
        subject: subject of all rows, if no column has it.
        export: layout of the table.
    """
    table = read_csv(path, delimiter=DETECTED, comment=None)
    keys = [_key(name) for name in table.names]
    named = export.columns_in(table.names, keys) | dict(columns or {})
    where = {role: _find_columns(path, table.names, role, named.get(role)) for role in ROLES}
    missing = [role for role in ("image", "subject", "x", "y") if not where[role]]
    subject = subject or path.stem * export.by_file
    if missing and not (missing == ["subject"] and subject):
        cure = ",".join(f"{role}=NAME" for role in missing)
        raise LogError(
            f"{path}: expected columns of image, subject, x and y; {named_all(missing)} "
            f"{'is' if len(missing) == 1 else 'are'} missing among "
            f"{', '.join(table.names)[:200] or 'none'}; --columns {cure} names "
            f"{'it' if len(missing) == 1 else 'them'}"
        )
    rows = export.rows(path, table, keys, where)
    n, kind = len(rows), next((role for role in ("index", "time") if where[role]), "row")

    def texts(role: str) -> Texts:
        return np.array([" ".join(row.cells[c] for c in where[role]) for row in rows], np.str_)

    def numbers(columns: Sequence[int]) -> FloatArray:
        for column in columns:
            _replace_decimal_commas(rows, column)
        values = [number_in(row, column) for row in rows for column in columns]
        return np.array(values, np.float64).reshape(n, len(columns))

    order = numbers(where[kind])[:, 0] if kind != "row" else np.array([r.line for r in rows], float)
    xy, box = numbers([*where["x"], *where["y"]]), np.tile(NO_BOX, (n, 1))
    if keys[where["x"][0]] in export.normalized:
        box[:] = 0, 0, 1, 1, False
    elif export.box and all(name in keys for name in export.box):
        box[:, :4] = numbers([keys.index(name) for name in export.box])
        box[:, 4] = 0
        xy[~(np.isfinite(box).all(axis=1) & (box[:, 2:4].min(axis=1) > 0))] = np.nan
    image, person = texts("image"), texts("subject") if where["subject"] else np.full(n, subject)
    xy[np.isin(image, ("", ".")) | np.isin(person, ("", ".")) | np.isnan(order)] = np.nan
    durations = np.full(n, np.nan)
    if where["duration"]:
        durations = numbers(where["duration"])[:, 0]
        known = durations[np.isfinite(durations)]
        named_ms = keys[where["duration"][0]].endswith(("ms", "msec", "milliseconds"))
        if len(known) and np.median(known) < SHORTEST and not named_ms:
            durations = 1000 * durations
    eye = np.array([each[:1].upper() for each in texts("eye")], np.str_)
    return FixationList(
        RawFixations(image, person, order, xy, durations, box, texts("trial"), eye), kind, Counter()
    )


def named_all(names: Sequence[str]) -> str:
    """Names in a sentence: a, b and c."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _key(name: str) -> str:
    """The letters and digits of a name, in lower case."""
    return "".join(letter for letter in name.casefold() if letter.isalnum())


def is_named(role: str, name: str) -> bool:
    """Whether a name is usual for columns of a role."""
    key = _key(name)
    return any(re.fullmatch(COLUMN_NAMES[role], each) for each in (key, UNITS.sub("", key)))


def _find_columns(path: Path, names: Sequence[str], role: str, wanted: str | None) -> list[int]:
    """Column numbers of a role: one, none, or several for trials."""
    if wanted is not None:
        for same in (str, str.casefold):
            if same(wanted) in (given := [same(each) for each in names]):
                return [given.index(same(wanted))]
        found = ", ".join(names)[:200]
        raise ConfigError(
            f"--columns: {role}: expected a column of {path} ({found}), found {wanted!r}"
        )
    fits = [i for i, name in enumerate(names) if name == role]
    fits = fits or [i for i, name in enumerate(names) if is_named(role, name)]
    if len(fits) > 1 and role != "trial":
        several = " or ".join(names[i] for i in fits)
        raise LogError(
            f"{path}: {role} could be the column {several}; "
            f"--columns {role}={names[fits[0]]} chooses it"
        )
    return fits


def number_in(row: Row, column: int) -> float:
    """The number in a cell; NaN if it is blank."""
    if row.cells[column].casefold() in BLANK:
        return np.nan
    return row.numbers(slice(column, column + 1))[0]


def _replace_decimal_commas(rows: Sequence[Row], column: int) -> None:
    """Replaces decimal commas in a column by points, unless they may separate thousands."""
    numbers = [row.cells[column] for row in rows if row.cells[column].casefold() not in BLANK]
    commas = [cell for cell in numbers if "," in cell]
    thousands = len(commas) < len(numbers) and all(map(THOUSANDS.fullmatch, commas))
    if thousands or any("." in cell for cell in numbers):
        return
    for row in rows:
        row.cells[column] = row.cells[column].replace(",", ".", 1)


def header_of(path: Path) -> set[str]:
    """Names of the columns in the first line of a text file, in letters and digits only."""
    line = _first_text(path).partition("\n")[0]
    return {_key(name) for name in re.split("[,;\t]", line)}


def _first_text(path: Path) -> str:
    with reading(path, LogError), open_file(path) as file:
        return decode_text(file.read(RECOGNITION_BYTES)[:RECOGNITION_BYTES])


def is_event_list(path: Path) -> bool:
    """Whether a text file is a list of events of SMI's IDF Event Detector."""
    return EVENT_HEADER in _first_text(path)


def read_event_list(
    path: Path, columns: Mapping[str, str] | None = None, subject: str = ""
) -> FixationList:
    """The fixations of a list of events of SMI's IDF Event Detector.

    The image of a trial is the last message before a fixation that names an image file.
    """
    require(not columns, "--columns", "none for a list of events", columns)
    image, trial, found, early = "", "", list[tuple[Any, ...]](), 0
    subject = subject or path.stem
    header: list[str] = []
    for row in read_rows(path, "\t", comment="##"):
        kind, *cells = row.cells
        if kind == "Event Type" and "Location X" in cells:
            header = cells
        elif kind.rstrip(":") == "Subject" and cells:
            subject = cells[0]
        elif kind == "UserEvent" and cells:
            words = cells[-1].partition("Message:")[2].split()
            names = [word for word in words if word.lower().endswith(IMAGE_SUFFIXES)]
            if names:
                image, trial = PureWindowsPath(names[0]).as_posix(), cells[0]
        elif kind.startswith("Fixation") and header:
            row.require_cells(len(header) + 1)
            start, micro, x, y = (
                number_in(row, 1 + header.index(name))
                for name in ("Start", "Duration", "Location X", "Location Y")
            )
            early += not image
            eye = kind.split()[-1][:1]
            values = (image, subject, start / 1000, x, y, micro / 1000, NO_BOX, trial, eye)
            found += [values] * bool(image)
    if not found:
        raise LogError(
            f"{path}: expected fixations after a message with the name of an image file, found "
            f"{early} without"
        )
    remarks = Counter({"fixations with no image on the screen are left out": early})
    return FixationList(RawFixations.of(found), "time", remarks)
