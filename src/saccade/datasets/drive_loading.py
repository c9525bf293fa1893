"""One door to every camera drive."""

from pathlib import Path
from typing import Literal, TypeAlias, get_args

from saccade.datasets.drive_kitti import read_kitti_drive
from saccade.errors import ConfigError, DriveError, LogError, require
from saccade.frames import Drive

DriveKind: TypeAlias = Literal["auto", "kitti"]
"""The layouts; "auto" looks into the folder."""


def load_drive(kind: DriveKind, path: str | Path) -> Drive:
    """Open a camera drive; its images are read when they are wanted.

    Args:
        kind: "kitti", or "auto".
        path: the folder.

    Raises:
        DriveError: a file is missing, broken, or not of this layout; one line that names it.
        ConfigError: no such kind.
    """
    require(kind in get_args(DriveKind), "kind", f"one of {', '.join(get_args(DriveKind))}", kind)
    path = Path(path)
    if not path.exists():
        raise DriveError(f"{path}: expected a camera drive, found no such file or folder")
    try:
        return read_kitti_drive(path)
    except (LogError, ConfigError) as error:
        raise DriveError(str(error)) from error
