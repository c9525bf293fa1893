"""Safe opening of files, atomic writes, limits on sizes, and versions of file formats."""

import codecs
import os
import re
import shutil
import stat
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from errno import EILSEQ, EINVAL, EISDIR, ENAMETOOLONG
from pathlib import Path
from typing import Any, BinaryIO
from zlib import crc32

from saccade.errors import ConfigError, OutputError, SaccadeError

LARGEST_IMAGE = 1 << 28
"""Maximum number of pixels: 3 GB as float32 RGB, and several times that while computing."""
LARGEST_FILE = 1 << 31
"""Maximum size of a file that is read into memory, in bytes."""
LARGEST_TEXT = 1 << 28
"""Maximum size of a text file, in bytes; parsed lines and numbers take twenty times as much."""
IMAGE_SUFFIXES = (
    *(".bmp", ".dib", ".jfif", ".jp2", ".jpe", ".jpeg", ".jpg", ".pbm", ".pgm", ".png", ".pnm"),
    *(".ppm", ".ras", ".sr", ".tif", ".tiff", ".webp"),
)
UNREAD_SUFFIXES = (
    *(".arw", ".avif", ".cr2", ".cr3", ".dng", ".exr", ".gif", ".hdr", ".heic", ".heif", ".jxl"),
    *(".nef", ".orf", ".pfm", ".psd", ".raf", ".raw", ".rw2", ".svg", ".tga"),
)
"""Suffixes of unsupported image formats, which cause a warning."""
PARTIAL = ".partial"
"""Subfolder of an output folder for results of an unfinished run."""
LOCK = ".saccade-lock"
"""Lock file in an output folder."""
KINDS = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
VIDEO_SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".webm")


def check_file(path: Path, max_bytes: int | None = None) -> None:
    """Rejects devices, pipes and sockets, which may block reading forever.

    Folders are accepted; opening them raises an error of the operating system.

    Args:
        path: path that a library is about to open.
        max_bytes: size limit; None for no limit.

    Raises:
        OSError: the path does not exist, is not a file, or is too large.
    """
    status = path.stat()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
        kind = KINDS.get(stat.S_IFMT(status.st_mode), "a device")
        raise OSError(None, f"expected a file, found {kind}", str(path))
    if max_bytes is not None and status.st_size > max_bytes:
        expected = f"expected at most {max_bytes:,} bytes, found {status.st_size:,}"
        raise OSError(None, expected, str(path))


def open_file(path: Path) -> BinaryIO:
    """Open a file for reading; all readers of this package use it.

    Raises:
        OSError: see `check_file`.
    """
    check_file(path)
    return path.open("rb")


def natural_order(path: str | Path) -> list[list[str]]:
    """Key for natural sorting of names: frame2 before frame10, and 1.25 before 1.5."""
    parts = []
    for part in Path(path).parts:
        pieces = re.split("([0-9]+)", part)
        is_decimal = re.fullmatch(r"[0-9]+\.[0-9]+(\.[^.]*)?", part)
        for i in range(1, 2 if is_decimal else len(pieces), 2):
            digits = pieces[i].lstrip("0")
            pieces[i] = f"{len(digits):04d}{digits}"
        parts.append([*pieces, part])
    return parts


def is_file(path: Path) -> bool:
    """Whether a file exists; False for invalid names."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long, or with a null character
        return False


def read_bytes(path: Path, max_bytes: int = LARGEST_FILE) -> bytes:
    """The content of a file.

    Raises:
        OSError: see `check_file`.
    """
    check_file(path, max_bytes)
    return path.read_bytes()


def read_text(path: Path) -> str:
    """The text of a file with its original line ends; see `decode_text`.

    Raises:
        OSError: see `check_file` and `decode_text`.
    """
    return decode_text(read_bytes(path, LARGEST_TEXT))


def decode_text(data: bytes) -> str:
    """Decodes UTF-8, UTF-16 with a byte order mark (removed), or cp1252.

    Raises:
        OSError: the data has a different encoding.
    """
    is_wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    for encoding in ("utf-16",) if is_wide else ("utf-8-sig", "cp1252"):
        with suppress(UnicodeDecodeError):
            text = data.decode(encoding)
            if not UNPRINTABLE.search(text):
                return text
    found = "other bytes; save it as UTF-8"
    zero = data.find(b"\0")
    if zero >= 0 and any(data[zero + 2 : zero + 6 : 2]):  # every other byte is zero in UTF-16
        found = f"a zero at byte {zero}: the file is damaged, or no text; copy it again"
    if data.startswith(MATLAB):
        found = "a MATLAB file; write its columns with writetable(table(...), 'NAME.csv')"
    raise OSError(None, f"expected text in UTF-8, found {found}")


MATLAB = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
"""First bytes of a MATLAB file."""
UNPRINTABLE = re.compile("[\0-\x08\x0e-\x19]")
"""Control characters that do not occur in text; UTF-16 without a mark has zeros."""


@contextmanager
def reading(
    path: object, error: type[SaccadeError], expected: str = "text", *foreign: type[Exception]
) -> Iterator[None]:
    """Converts errors in the block to a one-line error that names the file.

    Args:
        path: the file or folder being read.
        error: exception type to raise.
        expected: format of the file.
        foreign: exceptions that a library raises for other formats; an OSError counts only if it
            has no system error code.
    """
    expectable: tuple[type[Exception], ...] = (OSError, UnicodeDecodeError, *foreign)
    try:
        yield
    except (SaccadeError, MemoryError):
        raise
    except expectable as caught:
        of_system = isinstance(caught, OSError) and (
            caught.strerror is not None or not isinstance(caught, foreign)
        )
        failed = "cannot be read" if of_system else f"expected {expected}"
        raise error(f"{path}: {failed}: {one_line(caught)}") from caught


def is_invalid_name(error: OutputError) -> bool:
    """Whether a file cannot be written because of its name alone."""
    return getattr(error.__cause__, "errno", None) in (ENAMETOOLONG, EILSEQ, EINVAL)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Converts system errors in the block to an `OutputError` that names the path."""
    try:
        yield
    except SaccadeError:  # already names a file
        raise
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {one_line(error)}") from error


def read_toml(path: Path, error: type[SaccadeError]) -> dict[str, Any]:
    """The table of a TOML file; raises `error`, as `reading`."""
    with reading(path, error, "TOML", tomllib.TOMLDecodeError, RecursionError):
        return tomllib.loads(read_text(path))


@contextmanager
def results_in(folder: Path) -> Iterator[Path]:
    """Publishes the results of a run together when the block ends without an error.

    Until then, files written by `atomic_write` below the folder are kept in a subfolder. A nested
    block for the same folder or a subfolder has no effect. Other processes write immediately.

    Args:
        folder: output folder; it is created.

    Yields:
        The subfolder of unpublished files, for files written without `atomic_write`.

    Raises:
        ConfigError: another run is writing to the folder.
        OutputError: the folder cannot be written.
    """
    outer = _waiting_path(folder)
    if outer is not None:
        outer.mkdir(parents=True, exist_ok=True)
        yield outer
        return
    existed, waiting = folder.exists(), folder / PARTIAL
    try:
        with locked(folder):
            shutil.rmtree(waiting, ignore_errors=True)  # left by a killed run
            with writing(folder):
                waiting.mkdir()
            token = _RESULTS.set(folder.absolute())
            try:
                yield waiting
                for temporary in sorted(waiting.rglob("*")):
                    if temporary.is_file():
                        _replace(temporary, folder / temporary.relative_to(waiting))
            finally:
                _RESULTS.reset(token)
                shutil.rmtree(waiting, ignore_errors=True)
    finally:
        if not existed:
            with suppress(OSError):  # it has results
                folder.rmdir()


@contextmanager
def joining_results(folder: Path) -> Iterator[None]:
    """Keeps the files of this process with the results that another process publishes.

    The other process, which is in a `results_in` block for the folder, waits for this one.
    """
    token = _RESULTS.set(folder.absolute())
    try:
        yield
    finally:
        _RESULTS.reset(token)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Creates an output folder and locks it against other runs.

    The operating system releases the lock when the process ends. There is no lock on Windows and
    on file systems without locks.

    Raises:
        ConfigError: another run has locked the folder.
        OutputError: the folder cannot be written.
    """
    lock = folder / LOCK
    with ExitStack() as stack:
        with writing(folder):
            stack.enter_context(_locked(lock, folder))
        stack.callback(lock.unlink, missing_ok=True)
        yield


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Yields a temporary path that is renamed to `path` when the block ends without an error.

    Inside a `results_in` block the renaming is deferred to its end.

    Args:
        path: the file to write; missing folders are created, an existing file is replaced.

    Yields:
        The path of an empty file to write to, with the same suffix as `path`.

    Raises:
        ConfigError: another run is writing the file.
        OutputError: the folder or the file cannot be written.
    """
    path = Path(path)
    with writing(path):
        if path.is_dir():
            raise IsADirectoryError(EISDIR, os.strerror(EISDIR))
        if path.exists():
            check_file(path)  # a device must not be replaced
        waiting = _waiting_path(path)
        temporary = waiting or _hidden_beside(path)
        with _locked(temporary, path):
            os.truncate(temporary, 0)  # left by a killed run
            try:
                yield temporary
                if waiting is None:
                    _replace(temporary, path)
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise


class _Probe(Exception):  # noqa: N818 - never leaves `check_writable`
    """Ends an attempt to write."""


def check_writable(path: str | Path) -> None:
    """Checks that a file can be written, before the work whose result it will have.

    Raises:
        ConfigError, OutputError: see `atomic_write`.
    """
    with suppress(_Probe), atomic_write(path):
        raise _Probe


def one_line(error: Exception) -> str:
    """Message of an error in one line; system errors are described by their code."""
    number = getattr(error, "errno", None)
    if number:
        return os.strerror(number)
    message = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(message.split())


_RESULTS: ContextVar[Path | None] = ContextVar("_RESULTS", default=None)
"""Absolute path of the folder of the current `results_in` block."""


def _waiting_path(path: Path) -> Path | None:
    """Temporary path of a result inside a `results_in` block; None outside."""
    folder, path = _RESULTS.get(), path.absolute()
    if folder is None or not path.is_relative_to(folder):
        return None
    waiting = folder / PARTIAL
    return None if path.is_relative_to(waiting) else waiting / path.relative_to(folder)


def _hidden_beside(path: Path) -> Path:
    """A hidden file name next to a file, of limited length for any name."""
    return path.parent / f".saccade-{crc32(os.fsencode(path.name)):08x}{path.suffix}"


def _replace(temporary: Path, path: Path) -> None:
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.replace(path)


@contextmanager
def _locked(file: Path, path: Path) -> Iterator[None]:
    """Creates and locks a file; the error names `path`."""
    with ExitStack() as stack:
        is_removed = True
        while is_removed:
            file.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(file.open("ab"))
            try:
                import fcntl

                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                expected = "wait until it has ended, or choose another output"
                raise ConfigError(f"{path}: another run writes to it; {expected}") from error
            except (ImportError, OSError):  # Windows; a file system without locks
                pass
            is_removed = os.fstat(lock.fileno()).st_nlink == 0  # removed by the run that just ended
        yield


# Increment the version when a format changes. Text files with named columns have no version.
FORMATS = {
    "run": 1,  # run.json of `saccade slam` and `saccade drive`
    "look": 1,  # NAME.look.npz of `saccade look`
    "slam_map": 7,  # of `Slam.save` and `saccade slam --save-map`
    "points": 1,  # of an image: .npz; of many: .parquet, .h5
    "extraction": 2,  # the folder of `saccade extract`: in manifest.json, for all files
}
"""Current versions by name."""


def check_format(name: str, version: object, path: object, error: type[Exception]) -> None:
    """Rejects files of a later version of this package.

    Args:
        name: one of `FORMATS`.
        version: version in the file; None for files of other programs.
        path: path of the file.
        error: exception type to raise.
    """
    known = FORMATS[name]
    if version is None:
        return
    if not isinstance(version, int) or version < 1:
        raise error(f"{path}: expected a format from 1 to {known}, found {version!r}")
    if version > known:
        raise error(
            f"{path}: expected a format up to {known}, found {version}: a later version of saccade "
            "has written it; upgrade this one"
        )
