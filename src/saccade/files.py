"""What files are called, and output files that appear whole or not at all."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from saccade.errors import OutputError

LARGEST_IMAGE = 1 << 28
"""Pixels; as float32 RGB they take 3 GB, and what is made of them several times that."""
IMAGE_SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp")
VIDEO_SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".webm")


@contextmanager
def whole_file(path: str | Path, folder: Path | None = None) -> Iterator[Path]:
    """A temporary path that takes the name of `path` when the block ends well.

    Args:
        path: the file to write; missing folders are made, an old file is replaced.
        folder: where the temporary path is, on the same disk; beside `path` unless told otherwise.

    Yields:
        The path to write to; it has the same suffix as `path`.

    Raises:
        OutputError: the folder or the file cannot be written.
    """
    path = Path(path)
    try:
        for each in (folder or path.parent, path.parent):
            each.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(
            prefix=".saccade-", suffix=path.suffix, dir=folder or path.parent
        )
        os.close(handle)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {reason_of(error)}") from error
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {reason_of(error)}") from error
    finally:
        temporary.unlink(missing_ok=True)


def reason_of(error: Exception) -> str:
    """What is wrong, in the words of the operating system where it is its business."""
    number = getattr(error, "errno", None)
    return os.strerror(number) if number else str(error) or type(error).__name__
