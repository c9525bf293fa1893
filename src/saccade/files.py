"""What files are called, how they are opened, and output that appears whole or not at all."""

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from saccade.errors import OutputError

LARGEST_IMAGE = 1 << 28
"""Pixels; as float32 RGB they take 3 GB, and what is made of them several times that."""
LARGEST_FILE = 1 << 31
"""Bytes of a file that is read as one piece."""
LARGEST_TEXT = 1 << 28
"""Bytes of one that is text: lines and numbers take twenty times as much."""
IMAGE_SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp")
VIDEO_SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".webm")


def check_file(path: Path, most: int | None = None) -> None:
    """Refuse what may have no end, or never begin: devices, pipes and sockets.

    Folders pass: the operating system has a better word for whoever opens one.

    Args:
        path: what a library of others is about to open.
        most: bytes that it may have; any number unless told otherwise.

    Raises:
        OSError: it is no file, has too many bytes, or is not there.
    """
    found = path.stat()
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise OSError(None, f"expected a file, found {_kind(found.st_mode)}", str(path))
    if most is not None and found.st_size > most:
        expected = f"expected at most {most:,} bytes, found {found.st_size:,}"
        raise OSError(None, expected, str(path))


def as_text(name: str) -> str:
    """A name of a file, with a backslash, x and two digits for a byte that is not UTF-8."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


@contextmanager
def text_path(path: Path) -> Iterator[str]:
    """A path for a library that takes no other than text: a link, where a name is none.

    Args:
        path: a file that is there.
    """
    if as_text(str(path)) == str(path):
        yield str(path)
        return
    with tempfile.TemporaryDirectory(prefix="saccade-") as folder:
        link = Path(folder) / f"file{as_text(path.suffix)}"
        link.symlink_to(path.absolute())
        yield str(link)


def open_file(path: Path) -> BinaryIO:
    """A file, open for reading: every reader of ours comes by here.

    Raises:
        OSError: see `check_file`.
    """
    check_file(path)
    return path.open("rb")


def read_bytes(path: Path, most: int = LARGEST_FILE) -> bytes:
    """All that is in a file of at most so many bytes.

    Raises:
        OSError: see `check_file`.
    """
    check_file(path, most)
    return path.read_bytes()


def read_text(path: Path) -> str:
    """The text in a file, with the ends of its lines as they are, without a mark of UTF-8.

    Raises:
        OSError: see `check_file`.
        UnicodeDecodeError: it is no UTF-8.
    """
    return read_bytes(path, LARGEST_TEXT).decode("utf-8-sig")


def make_folder(path: Path) -> None:
    """Make a folder for what is about to be made, if there is none.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # no name can hold a null or a lone surrogate
        raise OutputError(f"{path}: cannot be written: {reason_of(error)}") from error


@contextmanager
def atomic_write(path: str | Path, folder: Path | None = None) -> Iterator[Path]:
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
        if path.exists():
            check_file(path)  # or the device itself would be replaced
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
    except OutputError:  # of another file, in the block
        raise
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {reason_of(error)}") from error
    finally:
        temporary.unlink(missing_ok=True)


def reason_of(error: Exception) -> str:
    """What is wrong, in the words of the operating system where it is its business."""
    number = getattr(error, "errno", None)
    if number:
        return os.strerror(number)
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def one_line(error: Exception) -> str:
    """`reason_of`, where a library said it in several lines."""
    return " ".join(reason_of(error).split())


def _kind(mode: int) -> str:
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"
