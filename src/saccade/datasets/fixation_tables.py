"""Fixations in tables of any laboratory, and in exports of Tobii Pro Lab.

Columns are identified by their usual names. Tobii's data export, described in Tobii Pro Lab's
manual, has one row per sample, with its fixation.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from saccade.datasets.tables import DETECTED, Row, TextTable, read_csv
from saccade.errors import ConfigError, LogError
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
    """Meaning of `RawFixations.order`: index, time or row."""
    remarks: Counter[str]
    """Number of fixations left out, by reason."""


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

TOBII = {
    "image": ("presentedstimulusname", "presentedmedianame"),
    "subject": ("participantname",),
    "x": ("fixationpointxmcsnorm", "fixationpointxdacspx", "fixationpointx"),
    "y": ("fixationpointymcsnorm", "fixationpointydacspx", "fixationpointy"),
    "duration": ("gazeeventduration", "eyemovementeventduration"),
    "trial": ("recordingname",),
}
"""Columns of Tobii's export by role, preferred names first."""
TOBII_TYPE = "eyemovementtype"
TOBII_INDEX = "eyemovementtypeindex"
TOBII_BOX = tuple(
    f"presentedmedia{name}" for name in ("positionxdacspx", "positionydacspx", "width", "height")
)


def read_fixation_table(
    path: Path, columns: Mapping[str, str] | None = None, subject: str = ""
) -> FixationList:
    """The fixations of a table, separated by commas, semicolons or tabs.

    Args:
        path: a file with a header; decimal commas are read if unambiguous.
        columns: names of columns by `ROLES`, if they differ from the usual names.
        subject: subject of all rows, if no column has it.
    """
    table = read_csv(path, delimiter=DETECTED, comment=None)
    keys, named, rows = [_key(name) for name in table.names], dict(columns or {}), table.rows
    is_tobii = TOBII_TYPE in keys
    if is_tobii:
        named = _tobii_columns(table.names, keys) | named
    where = {role: _find_columns(path, table.names, role, named.get(role)) for role in ROLES}
    for role in ("image", "subject", "x", "y"):
        if not where[role] and not (role == "subject" and subject):
            raise LogError(
                f"{path}: expected columns of image, subject, x and y; {role} is missing among "
                f"{', '.join(table.names)[:200] or 'none'}; --columns {role}=NAME names it"
            )
    if is_tobii:
        rows = _tobii_rows(path, table, keys, where)
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
    if is_tobii and keys[where["x"][0]].endswith("norm"):
        box[:] = 0, 0, 1, 1, False
    elif is_tobii and all(name in keys for name in TOBII_BOX):
        box[:, :4] = numbers([keys.index(name) for name in TOBII_BOX])
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


def _tobii_columns(names: Sequence[str], keys: Sequence[str]) -> dict[str, str]:
    """Column names of Tobii's export by role."""
    found = {role: next((k for k in known if k in keys), None) for role, known in TOBII.items()}
    return {role: names[keys.index(key)] for role, key in found.items() if key is not None}


def _tobii_rows(
    path: Path, table: TextTable, keys: Sequence[str], where: Mapping[str, Sequence[int]]
) -> list[Row]:
    """One row per fixation on an image: its first sample with a position."""
    if TOBII_INDEX not in keys:
        raise LogError(f"{path}: expected the column Eye movement type index of Tobii's export")
    identity = [*where["subject"], *where["image"], *where["trial"], keys.index(TOBII_INDEX)]
    kind, image, x = keys.index(TOBII_TYPE), where["image"][0], where["x"][0]
    first: dict[tuple[str, ...], Row] = {}
    for row in table.rows:
        if row.cells[kind] != "Fixation" or not row.cells[image]:
            continue
        key = tuple(row.cells[column] for column in identity)
        if key not in first or first[key].cells[x].casefold() in BLANK:
            first[key] = row
    return [*first.values()]
