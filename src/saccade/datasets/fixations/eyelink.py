"""Fixations in EyeLink's text format (.asc), written by edf2asc.

Source of lines and fields: "The ASC File Format" in SR Research's user manuals; of messages with
trials and images: "Protocol for EyeLink Data to Viewer Integration".
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import Any, NamedTuple

import numpy as np

from saccade.datasets.fixations.exports import (
    NO_BOX,
    Box,
    FixationList,
    RawFixations,
    is_named,
    number_in,
)
from saccade.datasets.tables import Row, is_number, read_rows
from saccade.errors import LogError, require
from saccade.io.files import IMAGE_SUFFIXES


class _Shown(NamedTuple):
    """An image that was displayed on the screen."""

    time: float
    name: str
    box: Box


@dataclass
class _Trial:
    """Content of a file between two TRIALID messages."""

    label: str = ""
    shown: list[_Shown] = field(default_factory=list)
    variables: dict[str, str] = field(default_factory=dict)
    fixations: list[Row] = field(default_factory=list)
    """Rows of EFIX, eye, start, end, duration, x, y."""


def read_eyelink(
    path: Path, columns: Mapping[str, str] | None = None, subject: str = ""
) -> FixationList:
    """The fixations of a recording.

    A fixation is assigned to the image on the screen at its end, since the first fixation of a
    trial often begins before its image. The message `!V IMGLOAD` names the image and its position
    on the screen; otherwise the name is taken from a trial variable (`!V TRIAL_VAR`) called image
    or similar, or from a file name in TRIALID.

    Args:
        path: the .asc file.
        columns: "image": name of the trial variable that holds the image name.
        subject: name of the subject; by default the name of the file.
    """
    foreign = ", ".join(sorted((columns or {}).keys() - {"image"}))
    require(not foreign, "--columns", "image alone of an EyeLink recording", foreign)
    found, early = list[tuple[Any, ...]](), 0
    trials, screen = _trials(path)
    for number, trial in enumerate(trials):
        shown = _images(trial, (columns or {}).get("image"))
        ends = [row.numbers(slice(3, 4))[0] for row in trial.fixations]
        if len(shown) == 1 and max(ends, default=np.inf) < shown[0].time:
            shown = [shown[0]._replace(time=-np.inf)]  # announced after the recording started
        for row, end in zip(trial.fixations, ends, strict=True):
            order = sum(each.time <= end for each in shown)
            if order == 0:
                early += 1
                continue
            image = shown[order - 1]
            start, milliseconds, x, y = (number_in(row, i) for i in (2, 4, 5, 6))
            of_image = (image.name, subject or path.stem, start, x, y, milliseconds, image.box)
            found.append((*of_image, f"{number}.{order}", row.cells[1]))
    if not found:
        raise LogError(
            f"{path}: expected fixations (EFIX) after a message with the name of the image "
            f"(!V IMGLOAD, or !V TRIAL_VAR image NAME), found {early} without; "
            "--columns image=VARIABLE selects another variable"
        )
    remarks = Counter({"fixations with no image on the screen are left out": early})
    size = None if np.isnan(screen[0]) else (screen[2], screen[3])
    return FixationList(RawFixations.of(found), "time", remarks, size)


def _trials(path: Path) -> tuple[list[_Trial], Box]:
    """The trials of a file, the first with the lines before any TRIALID, and the screen."""
    trials, screen = [_Trial()], NO_BOX
    for row in read_rows(path):
        kind = row.cells[0]
        if kind == "EFIX":
            if len(row.cells) < 7:
                raise row.error("EFIX, eye, start, end, duration, x and y", " ".join(row.cells))
            trials[-1].fixations.append(row)
        elif kind == "EVENTS" and row.cells[1:2] != ["GAZE"]:
            raise row.error("events of GAZE, positions on the screen", " ".join(row.cells[1:2]))
        elif kind == "MSG" and len(row.cells) > 2:
            screen = _read_message(row, trials, screen)
    return trials, screen


def _read_message(row: Row, trials: list[_Trial], screen: Box) -> Box:
    """Adds the content of a message to the trials; returns the screen, if known."""
    words, offset = row.cells[2:], 0.0
    if len(words) > 1 and words[0].lstrip("+-").isdecimal():
        offset = float(words.pop(0))
    if words[0] == "TRIALID":
        trials.append(_Trial(" ".join(words[1:])))
    elif words[0] in ("DISPLAY_COORDS", "GAZE_COORDS") and len(words) == 5:
        left, top, right, bottom = Row(row.path, row.line, words[1:]).numbers()
        if right > left and bottom > top:
            return left, top, right - left + 1, bottom - top + 1, False
    elif words[:2] == ["!V", "IMGLOAD"]:
        time = row.numbers(slice(1, 2))[0] - offset
        name, box = _loaded(Row(row.path, row.line, words[2:]), screen)
        trials[-1].shown.append(_Shown(time, name, box))
    elif words[:2] == ["!V", "TRIAL_VAR"] and len(words) > 3:
        trials[-1].variables[words[2]] = " ".join(words[3:])
    return screen


def _loaded(command: Row, screen: Box) -> tuple[str, Box]:
    """Image and box from FILL PATH, or CENTER or TOP_LEFT PATH X Y [WIDTH HEIGHT]."""
    kind, *words = command.cells or [""]
    numbers: list[str] = []
    while kind != "FILL" and len(words) > 1 and len(numbers) < 4 and is_number(words[-1]):
        numbers.insert(0, words.pop())
    if kind not in ("FILL", "CENTER", "TOP_LEFT") or not words or len(numbers) % 2:
        raise command.error(
            "IMGLOAD with FILL PATH, or CENTER or TOP_LEFT, PATH, X, Y, WIDTH and HEIGHT",
            " ".join(command.cells),
        )
    name = PureWindowsPath(" ".join(words)).as_posix()  # accepts both kinds of slashes
    if kind == "FILL" or not numbers:
        return name, screen if kind == "FILL" else NO_BOX
    x, y, *size = Row(command.path, command.line, numbers).numbers()
    width, height = size if size and min(size) > 0 else (np.nan, np.nan)
    return name, (x, y, width, height, kind == "CENTER")


def _images(trial: _Trial, wanted: str | None) -> list[_Shown]:
    """The images of a trial in order of time."""
    if trial.shown and wanted is None:
        return sorted(trial.shown, key=lambda each: each.time)
    names = [
        value
        for name, value in trial.variables.items()
        if (name == wanted if wanted else is_named("image", name))
    ]
    names = names or [word for word in trial.label.split() if word.lower().endswith(IMAGE_SUFFIXES)]
    return [_Shown(-np.inf, PureWindowsPath(name).as_posix(), NO_BOX) for name in names[:1]]
