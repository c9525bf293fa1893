"""Fixations in a table of any lab, of EyeLink or Tobii Pro Lab, or in EyeLink's text.

Columns are found by their usual names. Tobii's are those of the data export in Tobii Pro Lab's
manual: a row for each sample, with the fixation that it belongs to.

EyeLink's text (.asc) is what edf2asc writes. Lines and their fields are those of "The ASC File
Format" in SR Research's user manuals; messages that name trials and images are those of its
"Protocol for EyeLink Data to Viewer Integration".
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from saccade.datasets.tables import DETECTED, Row, is_number, read_rows
from saccade.errors import ConfigError, LogError
from saccade.io.files import IMAGE_SUFFIXES


class Box(NamedTuple):
    """Where an image was on the screen, in the units of the fixations."""

    x: float
    """Position of the upper left corner, or of the center."""
    y: float
    width: float = np.nan
    """NaN for the width of the image in pixels."""
    height: float = np.nan
    centered: bool = False
    """Whether `x` and `y` are those of the center."""


class RawFixation(NamedTuple):
    """A fixation as a file has it."""

    image: str
    viewer: str
    order: float
    """Index, time, or number of the row."""
    x: float
    """NaN where the file has none, as during a blink."""
    y: float
    milliseconds: float
    """Duration; NaN where unknown."""
    box: Box | None = None
    """None where fixations are in pixels of the image."""


class FixationList(NamedTuple):
    """The fixations of a file."""

    fixations: list[RawFixation]
    order: str
    """Meaning of `RawFixation.order`: index, time or row."""
    left_out: Mapping[str, int] = MappingProxyType({})
    """Number of fixations by the reason that they are not among these."""


ROLES = ("image", "viewer", "index", "time", "x", "y", "duration")
POSITIONS = (
    *("{}", "fix{}", "{}fix", "fixation{}", "currentfix{}", "{}pos", "pos{}", "{}position"),
    *("position{}", "fixationposition{}", "fixationpoint{}", "{}coord", "coord{}"),
    *("{}coordinate", "coordinate{}", "gaze{}", "avg{}", "{}avg", "mean{}", "{}mean"),
    *("norm{}", "{}norm", "{}normalized", "{}screen", "screen{}"),
)
NAMES: dict[str, set[str]] = {
    "image": {
        *("image", "imageid", "imagefile", "imagefilename", "imagename", "img", "imgname"),
        *("stimulus", "stimulusid", "stimulusfile", "stimulusname", "stim", "stimname"),
        *("picture", "picturename", "photo", "photograph", "scene", "file", "filename"),
        *("presentedstimulusname", "presentedmedianame", "medianame"),
    },
    "viewer": {
        *("viewer", "viewerid", "subject", "subjectid", "subjectname", "subj", "subjid", "sub"),
        *("participant", "participantid", "participantname", "pp", "ppid", "ppt", "ppn", "pid"),
        *("observer", "observerid", "obs", "person", "user", "userid", "recordingsessionlabel"),
    },
    "index": {
        *("index", "order", "fixation", "fixationindex", "fixationnumber", "fixationorder"),
        *("fixationid", "fixindex", "fixnumber", "fixnum", "fixid", "fixnr", "fixorder"),
        *("currentfixindex", "fixationno", "fixno", "nfix", "rank"),
    },
    "time": {
        *("t", "time", "timestamp", "onset", "onsettime", "start", "starttime", "timestart"),
        *("begin", "tstart", "startt", "fixstart", "fixationstart", "fixationonset", "fixonset"),
        *("fixationstarttime", "fixstarttime", "currentfixstart", "recordingtimestamp"),
    },
    "x": {name.format("x") for name in POSITIONS},
    "y": {name.format("y") for name in POSITIONS},
    "duration": {
        *("duration", "dur", "fixationduration", "fixationdur", "fixduration", "fixdur"),
        *("currentfixduration", "gazeeventduration", "eyemovementeventduration"),
    },
}
"""Usual names of columns, in the letters and digits of their names."""
UNITS = re.compile(r"(px|pix|pixels?|ms|msec|milliseconds|s|sec|seconds)$")
BLANK = ("", ".", "-", "na", "nan", "n/a", "none", "null")
"""Cells without a number, in lower case: of tables, R, MATLAB, pandas and EyeLink."""
SHORTEST = 10.0
"""A median duration below it is in seconds: no fixation lasts ten, and none 10 ms."""
THOUSANDS = re.compile(r"-?[1-9]\d{0,2},\d{3}")

TOBII = {
    "image": ("presentedstimulusname", "presentedmedianame"),
    "viewer": ("participantname",),
    "x": ("fixationpointxmcsnorm", "fixationpointxdacspx", "fixationpointx"),
    "y": ("fixationpointymcsnorm", "fixationpointydacspx", "fixationpointy"),
    "duration": ("gazeeventduration", "eyemovementeventduration"),
}
TOBII_TYPE, TOBII_INDEX, TOBII_RECORDING = (
    "eyemovementtype",
    "eyemovementtypeindex",
    "recordingname",
)
TOBII_BOX = tuple(
    f"presentedmedia{name}" for name in ("positionxdacspx", "positionydacspx", "width", "height")
)


def read_fixation_table(
    path: Path, columns: Mapping[str, str] | None = None, viewer: str | None = None
) -> FixationList:
    """The fixations of a table, separated by commas, semicolons or tabs.

    Args:
        path: a file with a header; decimal commas are read where they cannot be anything else.
        columns: names of columns by `ROLES`, where they are not the usual ones.
        viewer: of all rows, where no column names one.

    Raises:
        LogError: the file is missing or broken, or a column is missing or could be several.
    """
    rows = read_rows(path, delimiter=DETECTED, comment=None)
    names = next(rows, Row(path, 1, [])).cells
    table = [row.require_cells(len(names)) for row in rows]
    keys = [_key(name) for name in names]
    tobii = TOBII_TYPE in keys
    place = _find_columns(path, names, columns or {}, tobii)
    for role in ("image", "viewer", "x", "y"):
        if role not in place and not (role == "viewer" and viewer):
            raise LogError(
                f"{path}: expected columns of image, viewer, x and y; {role} is missing among "
                f"{', '.join(names)[:200] or 'none'}; --columns {role}=NAME names it"
            )
    for role in place.keys() - {"image", "viewer"}:
        _replace_decimal_commas(table, place[role])
    order = "row" if tobii else next((role for role in ("index", "time") if role in place), "row")
    box = _box_columns(keys, place) if tobii else []
    for column in box:
        _replace_decimal_commas(table, column)
    fixations = []
    for row in _tobii_rows(path, table, keys, place) if tobii else table:
        x, y, time, milliseconds = (
            _number(row, place.get(role)) for role in ("x", "y", order, "duration")
        )
        image = row.cells[place["image"]]
        person = row.cells[place["viewer"]] if "viewer" in place else viewer or ""
        if {image, person} & {"", "."} or (order in place and np.isnan(time)):
            x = np.nan
        where = None
        if box:
            left, top, width, height = (_number(row, column) for column in box)
            where = Box(left, top, width, height)
            if not (np.isfinite([left, top]).all() and width > 0 and height > 0):
                x = np.nan
        if tobii and keys[place["x"]].endswith("norm"):
            where = Box(0.0, 0.0, 1.0, 1.0)
        number = time if order in place else row.line
        fixations.append(RawFixation(image, person, number, x, y, milliseconds, where))
    if "duration" in place:
        fixations = _in_milliseconds(fixations, keys[place["duration"]])
    return FixationList(fixations, "time" if tobii else order)


def _key(name: str) -> str:
    """The letters and digits of a name, in lower case."""
    return "".join(letter for letter in name.casefold() if letter.isalnum())


def _find_columns(
    path: Path, names: Sequence[str], columns: Mapping[str, str], tobii: bool
) -> dict[str, int]:
    """The number of the column of each role that the table has."""
    keys = [_key(name) for name in names]
    found = {}
    for role in ROLES:
        if role in columns:
            found[role] = _named_column(path, names, role, columns[role])
        elif tobii:
            chosen = [keys.index(name) for name in TOBII.get(role, ()) if name in keys]
            found.update((role, number) for number in chosen[:1])
        else:
            usual = NAMES[role]
            own = [i for i, name in enumerate(names) if name == role]
            fits = own or [
                i for i, key in enumerate(keys) if key in usual or UNITS.sub("", key) in usual
            ]
            if len(fits) > 1:
                several = " or ".join(names[i] for i in fits)
                raise LogError(
                    f"{path}: {role} could be the column {several}; "
                    f"--columns {role}={names[fits[0]]} chooses it"
                )
            found.update((role, number) for number in fits)
    return found


def _named_column(path: Path, names: Sequence[str], role: str, name: str) -> int:
    """The column that the user names."""
    for same in (str, str.casefold):
        if same(name) in (given := [same(each) for each in names]):
            return given.index(same(name))
    raise ConfigError(
        f"--columns: {role}: expected a column of {path} ({', '.join(names)[:200]}), found {name!r}"
    )


def _number(row: Row, column: int | None) -> float:
    """The number in a cell; NaN where it is blank, or where there is no such column."""
    if column is None or row.cells[column].casefold() in BLANK:
        return np.nan
    return row.numbers(slice(column, column + 1))[0]


def _replace_decimal_commas(table: Sequence[Row], column: int) -> None:
    """Replace the commas of a column by points, unless they may separate thousands."""
    cells = [row.cells[column] for row in table]
    numbers = [cell for cell in cells if cell.casefold() not in BLANK]
    commas = [cell for cell in numbers if "," in cell]
    points = any("." in cell for cell in numbers)
    thousands = len(commas) < len(numbers) and all(map(THOUSANDS.fullmatch, commas))
    if points or thousands:
        return
    for row in table:
        row.cells[column] = row.cells[column].replace(",", ".", 1)


def _in_milliseconds(fixations: list[RawFixation], key: str) -> list[RawFixation]:
    """The fixations with durations in milliseconds, by the name of the column or their size."""
    durations = np.array([fixation.milliseconds for fixation in fixations])
    known = durations[np.isfinite(durations)]
    seconds = len(known) > 0 and float(np.median(known)) < SHORTEST
    if key.endswith(("ms", "msec", "milliseconds")) or not seconds:
        return fixations
    return [each._replace(milliseconds=1000 * each.milliseconds) for each in fixations]


def _box_columns(keys: Sequence[str], place: Mapping[str, int]) -> list[int]:
    """The columns of a `Box` in Tobii's export, if fixations are on the screen."""
    if keys[place["x"]].endswith("norm") or not all(name in keys for name in TOBII_BOX):
        return []
    return [keys.index(name) for name in TOBII_BOX]


def _tobii_rows(
    path: Path, table: Sequence[Row], keys: Sequence[str], place: Mapping[str, int]
) -> list[Row]:
    """One row for each fixation on an image: of its samples the first with a position."""
    if TOBII_INDEX not in keys:
        raise LogError(f"{path}: expected the column Eye movement type index of Tobii's export")
    identity = [place["viewer"], place["image"], keys.index(TOBII_INDEX)]
    identity += [keys.index(name) for name in (TOBII_RECORDING,) if name in keys]
    kind = keys.index(TOBII_TYPE)
    first: dict[tuple[str, ...], Row] = {}
    for row in table:
        if row.cells[kind] != "Fixation" or not row.cells[place["image"]]:
            continue
        key = tuple(row.cells[column] for column in identity)
        if key not in first or np.isnan(_number(first[key], place["x"])):
            first[key] = row
    return [*first.values()]


@dataclass(frozen=True)
class _Shown:
    """An image that came onto the screen."""

    time: float
    name: str
    box: Box | None


@dataclass
class _Trial:
    """Content of a file from a message TRIALID to the next."""

    label: str = ""
    shown: list[_Shown] = field(default_factory=list)
    variables: dict[str, str] = field(default_factory=dict)
    fixations: list[Row] = field(default_factory=list)
    """EFIX, eye, start, end, duration, x, y."""


def read_eyelink(path: Path, columns: Mapping[str, str] | None = None) -> FixationList:
    """The fixations of a recording; its viewer is the name of the file.

    A fixation is on the image that is on the screen when it ends: the first one of a trial often
    began before its image came. The image is that of the message `!V IMGLOAD`, which has its
    place on the screen too; else the value of a trial variable (`!V TRIAL_VAR`) called image or
    alike; else a file name in TRIALID. Of two eyes the one with more fixations is taken.

    Args:
        path: the .asc.
        columns: "image": the name of the trial variable that names the image.

    Raises:
        LogError: the file is missing or broken, its positions are not those of the gaze on the
            screen, or no message names an image.
    """
    trials = _trials(path)
    eye = _eye(trials)
    wanted = (columns or {}).get("image")
    fixations = []
    early = 0
    for trial in trials:
        events = [row for row in trial.fixations if row.cells[1] == eye]
        shown = _images(trial, wanted)
        ends = [row.numbers(slice(3, 4))[0] for row in events]
        if len(shown) == 1 and all(end < shown[0].time for end in ends):
            shown = [_Shown(-np.inf, shown[0].name, shown[0].box)]  # named after the recording
        for row, end in zip(events, ends, strict=True):
            image = next((each for each in reversed(shown) if each.time <= end), None)
            if image is None:
                early += 1
                continue
            start, milliseconds = (row.numbers(slice(i, i + 1))[0] for i in (2, 4))
            x, y = (
                np.nan if row.cells[i] in BLANK else row.numbers(slice(i, i + 1))[0] for i in (5, 6)
            )
            fixations.append(
                RawFixation(image.name, path.stem, start, x, y, milliseconds, image.box)
            )
    if not fixations:
        raise LogError(
            f"{path}: expected fixations (EFIX) on images that a message names (!V IMGLOAD, or "
            f"!V TRIAL_VAR image NAME), found {early} without; --columns image=VARIABLE names "
            "another variable"
        )
    others = sum(len(trial.fixations) for trial in trials) - early - len(fixations)
    left_out = {"with no image on the screen": early, "of the other eye": others}
    return FixationList(fixations, "time", left_out)


def _trials(path: Path) -> list[_Trial]:
    """The trials of a file; the first is what comes before any."""
    trials = [_Trial()]
    screen = None
    for row in read_rows(path):
        kind = row.cells[0]
        if kind == "EFIX":
            if len(row.cells) < 7:
                raise row.error("EFIX, eye, start, end, duration, x and y", " ".join(row.cells))
            trials[-1].fixations.append(row)
        elif kind == "EVENTS" and row.cells[1:2] != ["GAZE"]:
            raise row.error("events of GAZE, positions on the screen", " ".join(row.cells[1:2]))
        elif kind == "MSG" and len(row.cells) > 2:
            words = row.cells[2:]
            offset = 0.0
            if len(words) > 1 and words[0].lstrip("+-").isdecimal():
                offset = float(words.pop(0))
            if words[0] == "TRIALID":
                trials.append(_Trial(" ".join(words[1:])))
            elif words[0] in ("DISPLAY_COORDS", "GAZE_COORDS") and len(words) == 5:
                left, top, right, bottom = Row(path, row.line, words[1:]).numbers()
                if right > left and bottom > top:
                    screen = Box(left, top, right - left + 1, bottom - top + 1)
            elif words[:2] == ["!V", "IMGLOAD"]:
                time = row.numbers(slice(1, 2))[0] - offset
                name, box = _loaded(Row(path, row.line, words[2:]), screen)
                trials[-1].shown.append(_Shown(time, name, box))
            elif words[:2] == ["!V", "TRIAL_VAR"] and len(words) > 3:
                trials[-1].variables[words[2]] = " ".join(words[3:])
    return trials


def _loaded(command: Row, screen: Box | None) -> tuple[str, Box | None]:
    """The image of FILL PATH, CENTER PATH X Y [WIDTH HEIGHT] or TOP_LEFT, alike, and its place."""
    kind, *words = command.cells or [""]
    numbers: list[str] = []
    while kind != "FILL" and len(words) > 1 and len(numbers) < 4 and is_number(words[-1]):
        numbers.insert(0, words.pop())
    if kind not in ("FILL", "CENTER", "TOP_LEFT") or not words or len(numbers) % 2:
        raise command.error(
            "IMGLOAD with FILL PATH, or CENTER or TOP_LEFT, PATH, X, Y, WIDTH and HEIGHT",
            " ".join(command.cells),
        )
    name = PureWindowsPath(" ".join(words)).name  # which takes both kinds of slashes
    if kind == "FILL" or not numbers:
        return name, screen if kind == "FILL" else None
    x, y, *size = Row(command.path, command.line, numbers).numbers()
    width, height = size if size and min(size) > 0 else (np.nan, np.nan)
    return name, Box(x, y, width, height, kind == "CENTER")


def _images(trial: _Trial, wanted: str | None) -> list[_Shown]:
    """The images of a trial in the order of their times."""
    if trial.shown and wanted is None:
        return sorted(trial.shown, key=lambda each: each.time)
    names = [
        value
        for name, value in trial.variables.items()
        if (name == wanted if wanted else name.casefold().replace("_", "") in NAMES["image"])
    ]
    names = names or [word for word in trial.label.split() if word.lower().endswith(IMAGE_SUFFIXES)]
    return [_Shown(-np.inf, PureWindowsPath(name).name, None) for name in names[:1]]


def _eye(trials: Iterable[_Trial]) -> str:
    """The eye with more fixations; of equals the left."""
    eyes = [row.cells[1] for trial in trials for row in trial.fixations]
    return max(sorted(set(eyes)), key=eyes.count, default="")
