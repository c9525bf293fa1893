"""Reads camera drives of every layout."""

from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Any, TypeAlias, cast

from saccade.datasets.drives.folder import CameraOptions
from saccade.datasets.drives.formats import DRIVE_FORMATS
from saccade.datasets.formats import find_reader
from saccade.errors import DriveError, ImageError, LogError
from saccade.frames import Drive

DriveKind: TypeAlias = str | Callable[..., Drive]
"""A layout: a name in `DRIVE_FORMATS`, "auto" to detect it, module:function, or a function of the
path."""
WHAT = "a camera drive"
"""What a path should be, for messages."""


def load_drive(kind: DriveKind, path: str | Path, camera: CameraOptions | None = None) -> Drive:
    """Open a camera drive; its images are read on demand.

    Args:
        kind: layout of the drive, such as "kitti"; see `DriveKind`. The modules in
            `saccade.datasets.drives` list the files of each.
        path: the folder or file.
        camera: intrinsics and baseline for images without a calibration.

    Raises:
        DriveError: a file is missing, broken, or not of this layout; the message names it.
        ConfigError: unknown kind, or a missing extra.
    """
    path = Path(path)
    try:
        kind, reader = find_reader(kind, path, DRIVE_FORMATS, WHAT, DriveError)
        given: dict[str, Any] = {} if camera in (None, CameraOptions()) else {"options": camera}
        if given and "options" not in signature(reader).parameters:
            raise DriveError(
                f"{path}: has a calibration ({kind} layout); leave out --intrinsics and --baseline"
            )
        return cast("Drive", reader(path, **given))
    except (ImageError, LogError) as error:
        raise DriveError(str(error)) from error
