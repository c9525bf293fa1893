"""Directions of a camera that turns, in `gaze.csv` beside the images of a drive.

pan_rad, tilt_rad, sigma_rad    see `CameraTurn`; one row for each recorded frame
reason                          optional
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from saccade.datasets.drives.frames import FrameTimes
from saccade.datasets.tables import Row, read_rows, write_table
from saccade.errors import DriveError
from saccade.frames import CameraTurn, Frame

GAZE_FILE = "gaze.csv"
COLUMNS = ("pan_rad", "tilt_rad", "sigma_rad", "reason")
"""The last one is optional."""


def with_recorded_turns(
    folder: Path, frames: FrameTimes, load: Callable[[int], Frame]
) -> Callable[[int], Frame]:
    """A `Drive.load` whose frames know how the camera was turned, if the folder has that file.

    Raises:
        DriveError: the file has no row for a recorded frame, or another header.
        LogError: a row has other cells than the header, or no numbers.
    """
    path = folder / GAZE_FILE
    if not path.exists():
        return load
    turns = read_turns(path)
    if len(turns) != len(frames.recorded):
        raise DriveError(
            f"{path}: expected a row for each of {len(frames.recorded)} frames, found {len(turns)}"
        )
    numbers = frames.index.tolist()

    def load_turned(i: int) -> Frame:
        return replace(load(i), turn=turns[numbers[i]])

    return load_turned


def read_turns(path: Path) -> list[CameraTurn]:
    """The turns of a file."""
    rows = read_rows(path, delimiter=",")
    header = tuple(next(rows, Row(path, 1, [])).cells)
    if header not in (COLUMNS, COLUMNS[:3]):
        found = ",".join(header)[:80]
        raise DriveError(f"{path}: expected the header {','.join(COLUMNS)}, found {found!r}")
    turns = []
    for row in rows:
        cells = row.require_cells(len(header)).cells
        pan, tilt, sigma = row.numbers(slice(3))
        turn = CameraTurn(pan, tilt, sigma, "".join(cells[3:]))
        if not (abs(turn.pan) <= 4 * np.pi and abs(turn.tilt) <= np.pi and 0 <= turn.sigma <= 1):
            raise row.error("pan, tilt and their standard deviation in radians", str(row.cells))
        turns.append(turn)
    return turns


def write_turns(path: Path, turns: Sequence[CameraTurn | None]) -> None:
    """Write turns as CSV, with every digit; None is as mounted."""
    rows = [turn or CameraTurn(0.0) for turn in turns]
    columns = (np.array(column) for column in zip(*rows, strict=True))
    write_table(path, dict(zip(COLUMNS, columns, strict=True)))
