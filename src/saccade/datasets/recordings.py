"""Recordings that may be landmark logs or camera drives."""

from collections.abc import Callable
from pathlib import Path

from saccade.datasets.drives.formats import DRIVE_FORMATS
from saccade.datasets.drives.tracks import is_tracks
from saccade.datasets.formats import AUTO, candidates
from saccade.datasets.logs.formats import LOG_FORMATS
from saccade.datasets.ros.bags import Bag
from saccade.datasets.ros.drives import IMAGES
from saccade.errors import LogError
from saccade.extras import import_function
from saccade.frames import Drive
from saccade.types import LandmarkLog


def is_log(path: Path, kind: str = AUTO) -> bool:
    """Whether a recording is read as a landmark log, rather than as a camera drive.

    A file that may be both, such as a bag, is a drive if it has images or tracks.

    Args:
        path: the file or folder.
        kind: name of its format, or "auto".

    Raises:
        LogError: the file cannot be read, or is neither.
    """
    tables = (LOG_FORMATS, DRIVE_FORMATS)
    log, drive = (
        candidates(path, table) if kind == AUTO else [name for name in table if name == kind]
        for table in tables
    )
    if log and drive:
        if "rosbag" in log:
            return not Bag(path).topics(IMAGES)
        return not is_tracks(path)
    if not log and not drive:
        known = ", ".join(dict.fromkeys(name for table in tables for name in table))
        raise LogError(
            f"{path}: expected a landmark log or a camera drive ({known}), found neither"
        )
    return bool(log)


def read_by(function: str | Callable[[Path], object], path: Path) -> LandmarkLog | Drive:
    """The recording that a function, or module:function, reads.

    Raises:
        LogError: it returns something else.
    """
    read = import_function("--kind", function) if isinstance(function, str) else function
    found = read(path)
    if not isinstance(found, LandmarkLog | Drive):
        kind = type(found).__name__
        raise LogError(f"{path}: expected a LandmarkLog or a Drive of {function}, found {kind}")
    return found
