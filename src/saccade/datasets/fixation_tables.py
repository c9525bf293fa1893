"""Fixations in a table of any lab, or in an export of Tobii Pro Lab.

Columns are found by their usual names. Tobii's data export, described in Tobii Pro Lab's manual,
has a row for each sample, with its fixation.
"""

import math
import re
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from itertools import compress
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from saccade.datasets.tables import DETECTED, Row, TextTable, read_csv
from saccade.errors import ConfigError, LogError


class Box(NamedTuple):
    """Position of an image on the screen, in the units of the fixations."""

    x: float
    """Position of the upper left corner, or of the center."""
    y: float
    width: float = np.nan
    """NaN for the width of the image in pixels."""
    height: float = np.nan
    centered: bool = False
    """Whether `x` and `y` are the center."""


class RawFixation(NamedTuple):
    """A fixation as a file has it."""

    image: str
    subject: str
    order: float
    """Index, time, or number of the row."""
    x: float
    """NaN where the file has none, as during a blink."""
    y: float
    milliseconds: float
    """Duration; NaN where unknown."""
    box: Box | None = None
    """None where fixations are in pixels of the image."""
    trial: str = ""
    """Name of the trial, if the file has one."""


class FixationList(NamedTuple):
    """The fixations of a file."""

    fixations: list[RawFixation]
    order: str
    """Meaning of `RawFixation.order`: index, time or row."""
    left_out: Mapping[str, int] = MappingProxyType({})
    """Number of fixations by the reason that they are not among these."""


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
"""Patterns of the usual names of columns, in the letters and digits of their names."""
ROLES = tuple(COLUMN_NAMES)
OTHER_EYE = "of the other eye"
"""Reason to leave out fixations."""
UNITS = re.compile(r"(px|pix|pixels?|ms|msec|milliseconds|s|sec|seconds)$")
BLANK = ("", ".", "-", "na", "nan", "n/a", "none", "null")
"""Cells without a number, in lower case: of tables, R, MATLAB, pandas and EyeLink."""
SHORTEST = 10.0
"""Durations with a smaller median are in seconds: no fixation lasts 10 s, and none 10 ms."""
THOUSANDS = re.compile(r"-?[1-9]\d{0,2},\d{3}")

TOBII = {
    "image": ("presentedstimulusname", "presentedmedianame"),
    "subject": ("participantname",),
    "x": ("fixationpointxmcsnorm", "fixationpointxdacspx", "fixationpointx"),
    "y": ("fixationpointymcsnorm", "fixationpointydacspx", "fixationpointy"),
    "duration": ("gazeeventduration", "eyemovementeventduration"),
    "trial": ("recordingname",),
}
"""Columns of Tobii's export by their roles, the preferred first."""
TOBII_TYPE = "eyemovementtype"
TOBII_INDEX = "eyemovementtypeindex"
TOBII_RECORDING = "recordingname"
TOBII_BOX = tuple(
    f"presentedmedia{name}" for name in ("positionxdacspx", "positionydacspx", "width", "height")
)


def read_fixation_table(
    path: Path,
    columns: Mapping[str, str] | None = None,
    subject: str | None = None,
    eye: str | None = None,
) -> FixationList:
    """The fixations of a table, separated by commas, semicolons or tabs.

    Args:
        path: a file with a header; decimal commas are read where they cannot be anything else.
        columns: names of columns by `ROLES`, where they are not the usual ones.
        subject: of all rows, where no column names one.
        eye: L or R: the eye to read where a column says that both are recorded.
    """
    table = read_csv(path, delimiter=DETECTED, comment=None)
    keys = [_key(name) for name in table.names]
    is_tobii = TOBII_TYPE in keys
    place = {
        role: number
        for role in ROLES
        if role != "trial"
        for number in _find_columns(path, table.names, role, (columns or {}).get(role), is_tobii)
    }
    for role in ("image", "subject", "x", "y"):
        if role not in place and not (role == "subject" and subject):
            raise LogError(
                f"{path}: expected columns of image, subject, x and y; {role} is missing among "
                f"{', '.join(table.names)[:200] or 'none'}; --columns {role}=NAME names it"
            )
    trials = _find_columns(path, table.names, "trial", (columns or {}).get("trial"), is_tobii)
    is_normalized = is_tobii and keys[place["x"]].endswith("norm")
    box = []
    if is_tobii and not is_normalized and all(name in keys for name in TOBII_BOX):
        box = [keys.index(name) for name in TOBII_BOX]
    for column in [
        *box,
        *(place[role] for role in place if role not in ("image", "subject", "eye")),
    ]:
        _replace_decimal_commas(table.rows, column)
    order = next((role for role in ("index", "time") if role in place and not is_tobii), "row")
    fixations, eyes = list[RawFixation](), list[str]()
    for row in _tobii_rows(path, table, keys, place) if is_tobii else table.rows:
        image = row.cells[place["image"]]
        person = row.cells[place["subject"]] if "subject" in place else subject or ""
        number = _number(row, place[order]) if order in place else row.line
        x, y, milliseconds = (_number(row, place.get(role)) for role in ("x", "y", "duration"))
        where = Box(0.0, 0.0, 1.0, 1.0) if is_normalized else None
        if box:
            left, top, width, height = (_number(row, column) for column in box)
            where = Box(left, top, width, height)
        is_blank = bool({image, person} & {"", "."}) or np.isnan(number)
        if is_blank or (where and not (np.isfinite(where).all() and min(where[2:4]) > 0)):
            x = np.nan
        trial = " ".join(row.cells[column] for column in trials)
        fixations.append(RawFixation(image, person, number, x, y, milliseconds, where, trial))
        eyes.append(row.cells[place["eye"]][:1].upper() if "eye" in place else "")
    if "duration" in place:
        fixations = _in_milliseconds(fixations, keys[place["duration"]])
    views = [(each.image, each.subject, each.trial) for each in fixations]
    of_eye = choose_eyes(views, eyes, eye)
    left_out = {OTHER_EYE: len(of_eye) - sum(of_eye)}
    return FixationList([*compress(fixations, of_eye)], "time" if is_tobii else order, left_out)


def choose_eyes(
    blocks: Sequence[Hashable], eyes: Sequence[str], wanted: str | None = None
) -> list[bool]:
    """Whether each fixation is of the eye that is read in its block of the recording.

    Args:
        blocks: (n,) block of each fixation.
        eyes: (n,) L or R.
        wanted: the eye to read where it has fixations. By default the one with more of them in the
            recording, but in blocks where the other one has more than twice as many.
    """
    overall, counts = Counter(eyes), Counter(zip(blocks, eyes, strict=True))
    preferred = wanted or max(sorted(overall), key=overall.__getitem__, default="")
    chosen = {}
    for block in {*blocks}:
        most = max(sorted(overall), key=lambda eye: counts[block, eye])
        enough = counts[block, preferred] * (math.inf if wanted else 2) >= counts[block, most]
        chosen[block] = preferred if counts[block, preferred] and enough else most
    return [chosen[block] == eye for block, eye in zip(blocks, eyes, strict=True)]


def _key(name: str) -> str:
    """The letters and digits of a name, in lower case."""
    return "".join(letter for letter in name.casefold() if letter.isalnum())


def is_named(role: str, name: str) -> bool:
    """Whether a name is usual for columns of a role."""
    key = _key(name)
    return any(re.fullmatch(COLUMN_NAMES[role], each) for each in (key, UNITS.sub("", key)))


def _find_columns(
    path: Path, names: Sequence[str], role: str, wanted: str | None, is_tobii: bool
) -> list[int]:
    """The numbers of the columns of a role: one, none, or several of trials."""
    if wanted is not None:
        for same in (str, str.casefold):
            if same(wanted) in (given := [same(each) for each in names]):
                return [given.index(same(wanted))]
        found = ", ".join(names)[:200]
        raise ConfigError(
            f"--columns: {role}: expected a column of {path} ({found}), found {wanted!r}"
        )
    if is_tobii:
        keys = [_key(name) for name in names]
        return [keys.index(name) for name in TOBII.get(role, ()) if name in keys][:1]
    fits = [i for i, name in enumerate(names) if name == role]
    fits = fits or [i for i, name in enumerate(names) if is_named(role, name)]
    if len(fits) > 1 and role != "trial":
        several = " or ".join(names[i] for i in fits)
        raise LogError(
            f"{path}: {role} could be the column {several}; "
            f"--columns {role}={names[fits[0]]} chooses it"
        )
    return fits


def _number(row: Row, column: int | None) -> float:
    """The number in a cell; NaN where it is blank, or where there is no such column."""
    if column is None or row.cells[column].casefold() in BLANK:
        return np.nan
    return row.numbers(slice(column, column + 1))[0]


def _replace_decimal_commas(rows: Sequence[Row], column: int) -> None:
    """Replace the commas of a column by points, unless they may separate thousands."""
    numbers = [row.cells[column] for row in rows if row.cells[column].casefold() not in BLANK]
    commas = [cell for cell in numbers if "," in cell]
    thousands = len(commas) < len(numbers) and all(map(THOUSANDS.fullmatch, commas))
    if thousands or any("." in cell for cell in numbers):
        return
    for row in rows:
        row.cells[column] = row.cells[column].replace(",", ".", 1)


def _in_milliseconds(fixations: list[RawFixation], key: str) -> list[RawFixation]:
    """The fixations with durations in milliseconds, by the name of the column or their size."""
    known = [each.milliseconds for each in fixations if np.isfinite(each.milliseconds)]
    in_seconds = bool(known) and float(np.median(known)) < SHORTEST
    if key.endswith(("ms", "msec", "milliseconds")) or not in_seconds:
        return fixations
    return [each._replace(milliseconds=1000 * each.milliseconds) for each in fixations]


def _tobii_rows(
    path: Path, table: TextTable, keys: Sequence[str], place: Mapping[str, int]
) -> list[Row]:
    """One row for each fixation on an image: of its samples the first with a position."""
    if TOBII_INDEX not in keys:
        raise LogError(f"{path}: expected the column Eye movement type index of Tobii's export")
    identity = [place["subject"], place["image"]]
    identity += [keys.index(name) for name in (TOBII_INDEX, TOBII_RECORDING) if name in keys]
    kind = keys.index(TOBII_TYPE)
    first: dict[tuple[str, ...], Row] = {}
    for row in table.rows:
        if row.cells[kind] != "Fixation" or not row.cells[place["image"]]:
            continue
        key = tuple(row.cells[column] for column in identity)
        if key not in first or np.isnan(_number(first[key], place["x"])):
            first[key] = row
    return [*first.values()]
