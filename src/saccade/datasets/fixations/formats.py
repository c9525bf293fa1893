"""The formats of files of fixations: a row of `FORMATS` for each reader."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePath
from typing import NamedTuple

import numpy as np

from saccade.datasets.fixations.exports import (
    BEGAZE,
    GAZEPOINT,
    PLAIN,
    TOBII,
    FixationList,
    RawFixations,
    Texts,
    header_of,
    is_event_list,
    read_event_list,
    read_fixation_table,
)
from saccade.datasets.fixations.eyelink import read_eyelink
from saccade.datasets.fixations.mat import read_mat_fixations
from saccade.datasets.fixations.placement import list_files
from saccade.errors import LogError

TEXT = (".csv", ".tsv", ".txt")


class Format(NamedTuple):
    """A format of files of fixations."""

    read: Callable[[Path, Mapping[str, str], str], FixationList]
    """Reads a file, given the names of columns by role, and the name of the subject or image of a
    file that names none: its own name in a folder, without suffix, or empty."""
    suffixes: tuple[str, ...]
    """Suffixes of the files, in lower case."""
    summary: str
    """A few words on the files, for the help."""
    recognizes: Callable[[Path], bool] = lambda path: True
    """Whether a file with such a suffix has this format, by its content."""


FORMATS = {
    "eyelink": Format(read_eyelink, (".asc",), "EyeLink's .asc"),
    "mat": Format(read_mat_fixations, (".mat",), "MATLAB files of OSIE, SALICON and CAT2000"),
    "tobii": Format(
        partial(read_fixation_table, export=TOBII),
        TEXT,
        "exports of Tobii",
        lambda path: TOBII.fits(header_of(path)),
    ),
    "gazepoint": Format(
        partial(read_fixation_table, export=GAZEPOINT),
        TEXT,
        "exports of Gazepoint",
        lambda path: GAZEPOINT.fits(header_of(path)),
    ),
    "begaze": Format(
        partial(read_fixation_table, export=BEGAZE),
        TEXT,
        "exports of BeGaze",
        lambda path: BEGAZE.fits(header_of(path)),
    ),
    "begaze-events": Format(read_event_list, TEXT, "event lists of BeGaze", is_event_list),
    "table": Format(
        partial(read_fixation_table, export=PLAIN),
        TEXT,
        "tables of image, subject, index or time, x and y (.csv, .tsv)",
    ),
}
"""The formats by name; the first that recognizes a file reads it."""
SUFFIXES = tuple(dict.fromkeys(suffix for row in FORMATS.values() for suffix in row.suffixes))


def read_recording(path: Path, columns: Mapping[str, str]) -> FixationList:
    """The fixations of a file, or of all files in a folder and its subfolders.

    Raises:
        LogError: the file is broken or incomplete; the folder has no such files, or of two kinds.
        ConfigError: a column is missing from the file.
    """
    if not path.is_dir():
        return _read_file(path, columns, "")
    files = [name for name in list_files(path, SUFFIXES) if not name.startswith(".")]
    if not files:
        raise LogError(f"{path}: expected tables or recordings ({', '.join(SUFFIXES)}), found none")
    names = [PurePath(name).with_suffix("").as_posix() for name in files]
    lists = [
        _read_file(path / file, columns, name) for file, name in zip(files, names, strict=True)
    ]
    orders = sorted({each.order for each in lists})
    if len(orders) > 1:
        found = " and some with ".join(orders)
        raise LogError(f"{path}: expected files of one kind, found some with {found}")
    parts = [
        replace(each.fixations, trial=_trials_of(file, each))
        for file, each in zip(files, lists, strict=True)
        if len(each.fixations)
    ]
    every = RawFixations.concatenate(parts) if parts else RawFixations.of([])
    screens = {each.screen for each in lists}
    screen = screens.pop() if len(screens) == 1 else None
    return FixationList(every, orders[0], sum((each.remarks for each in lists), Counter()), screen)


def _trials_of(file: str, found: FixationList) -> Texts:
    """(n,) names of the trials, which differ from file to file."""
    return np.array([f"{file} {name}" for name in found.fixations.trial.tolist()])


def _read_file(path: Path, columns: Mapping[str, str], name: str) -> FixationList:
    for row in FORMATS.values():
        if path.suffix.lower() in row.suffixes and row.recognizes(path):
            return row.read(path, columns, name)
    return FORMATS["table"].read(path, columns, name)
