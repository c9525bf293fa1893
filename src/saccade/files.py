"""Safe opening of files, atomic writes, and limits on sizes."""

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from saccade.errors import OutputError

LARGEST_IMAGE = 1 << 28
"""Pixels. As float32 RGB they take 3 GB, and what is computed from them several times that."""
LARGEST_FILE = 1 << 31
"""Bytes of a file that is read into memory."""
LARGEST_TEXT = 1 << 28
"""Bytes of a text file; parsed into lines and numbers it takes twenty times as much."""
IMAGE_SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp")
UNREAD_SUFFIXES = (".avif", ".gif", ".heic", ".heif")
"""Of pictures that are not read; folders are said to hold them."""
VIDEO_SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".webm")


def check_file(path: Path, max_bytes: int | None = None) -> None:
    """Refuse devices, pipes and sockets, reading of which may block or never end.

    Folders pass: opening one raises an error of the operating system.

    Args:
        path: that a library is about to open.
        max_bytes: size limit; None for no limit.

    Raises:
        OSError: it does not exist, is no file, or is too large.
    """
    status = path.stat()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
        raise OSError(None, f"expected a file, found {_kind(status.st_mode)}", str(path))
    if max_bytes is not None and status.st_size > max_bytes:
        expected = f"expected at most {max_bytes:,} bytes, found {status.st_size:,}"
        raise OSError(None, expected, str(path))


def as_text(name: str) -> str:
    """A file name as text; a byte that is not UTF-8 is escaped, as in a Python literal."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


@contextmanager
def text_path(path: Path) -> Iterator[str]:
    """A path for a library that accepts only UTF-8: a symbolic link, where the name is not.

    Args:
        path: an existing file.
    """
    if as_text(str(path)) == str(path):
        yield str(path)
        return
    with tempfile.TemporaryDirectory(prefix="saccade-") as folder:
        link = Path(folder) / f"file{as_text(path.suffix)}"
        link.symlink_to(path.absolute())
        yield str(link)


def open_file(path: Path) -> BinaryIO:
    """Open a file for reading; all readers of this package use it.

    Raises:
        OSError: see `check_file`.
    """
    check_file(path)
    return path.open("rb")


def is_file(path: Path) -> bool:
    """Whether there is a file; false where no file can have the name."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long a name, or a null in it
        return False


def read_bytes(path: Path, max_bytes: int = LARGEST_FILE) -> bytes:
    """The content of a file.

    Raises:
        OSError: see `check_file`.
    """
    check_file(path, max_bytes)
    return path.read_bytes()


def read_text(path: Path) -> str:
    """The text of a file, with its own line ends, without a byte order mark.

    Raises:
        OSError: see `check_file`.
        UnicodeDecodeError: it is not UTF-8.
    """
    return read_bytes(path, LARGEST_TEXT).decode("utf-8-sig")


def make_folder(path: Path) -> None:
    """Create a folder and its parents, unless it exists.

    Raises:
        OutputError: it cannot be created.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # ValueError: a null or a lone surrogate in the name
        raise OutputError(f"{path}: cannot be written: {reason_of(error)}") from error


@contextmanager
def atomic_write(path: str | Path, folder: Path | None = None) -> Iterator[Path]:
    """A temporary path that is renamed to `path` when the block ends without an error.

    Args:
        path: the file to write; missing folders are created, an old file is replaced.
        folder: of the temporary path, on the same disk; None for that of `path`.

    Yields:
        The path to write to; it has the same suffix as `path`.

    Raises:
        OutputError: the folder or the file cannot be written.
    """
    path = Path(path)
    try:
        if path.exists():
            check_file(path)  # a device would be replaced
        for parent in (folder or path.parent, path.parent):
            parent.mkdir(parents=True, exist_ok=True)
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
    """Message of an error: that of the operating system, if it comes from there."""
    number = getattr(error, "errno", None)
    if number:
        return os.strerror(number)
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def one_line(error: Exception) -> str:
    """`reason_of` in one line."""
    return " ".join(reason_of(error).split())


def _kind(mode: int) -> str:
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"
