"""Safe opening of files, atomic writes, limits on sizes, and versions of file formats."""

import os
import shutil
import stat
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from errno import EISDIR
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from zlib import crc32

from saccade.errors import ConfigError, OutputError, SaccadeError

LARGEST_IMAGE = 1 << 28
"""Pixels. As float32 RGB they take 3 GB, and what is computed from them several times that."""
LARGEST_FILE = 1 << 31
"""Bytes of a file that is read into memory."""
LARGEST_TEXT = 1 << 28
"""Bytes of a text file; parsed into lines and numbers it takes twenty times as much."""
IMAGE_SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp")
UNREAD_SUFFIXES = (".avif", ".gif", ".heic", ".heif")
"""Suffixes of pictures that are not read; folders are said to hold them."""
PARTIAL, LOCK = ".partial", "lock"
"""Folder of results that are being written, and the file in it that excludes other runs."""
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


@contextmanager
def reading(
    path: object, error: type[SaccadeError], expected: str = "text", *foreign: type[Exception]
) -> Iterator[None]:
    """Turn errors of the block into one line that names the file.

    Args:
        path: the file or folder that is read.
        error: to raise.
        expected: format of the file.
        foreign: what is raised for a file of another format, beside bytes that are not UTF-8; an
            OSError among them is one that a library raises without an error of the system.
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


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn errors of the operating system in the block into an `OutputError` that names a path."""
    try:
        yield
    except OutputError:  # of another file, in the block
        raise
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {reason_of(error)}") from error


def read_toml(path: Path, error: type[SaccadeError]) -> dict[str, Any]:
    """The table of a TOML file; raises `error`, as `reading`."""
    with reading(path, error, "TOML", tomllib.TOMLDecodeError, RecursionError):
        return tomllib.loads(read_text(path))


@contextmanager
def results_in(path: Path, *, is_file: bool = False) -> Iterator[None]:
    """The results of a run appear together when the block ends without an error, or not at all.

    Files that `atomic_write` writes to the folder meanwhile wait in a folder in it; those of a run
    that was killed are removed by the next one. Inside such a block for the same folder, or one
    that holds it, the block has no effect. Other processes write at once.

    Args:
        path: the output folder, which is created.
        is_file: whether it is a single file instead.

    Raises:
        ConfigError: another run writes to it.
        OutputError: it cannot be written.
    """
    outer = _RESULTS.get()
    if outer is not None and outer.holds(path):
        yield
        return
    existed = path.exists()
    try:
        with claimed(path, _beside(path) if is_file else path / PARTIAL) as work:
            results = _Results(path, work, {})
            token = _RESULTS.set(results)
            try:
                yield
            finally:
                _RESULTS.reset(token)
            for final, temporary in results.files.items():
                _appear(temporary, final)
    finally:
        if not existed and not is_file:
            with suppress(OSError):  # it has results
                path.rmdir()


@contextmanager
def written_at_once() -> Iterator[None]:
    """Files of the block do not wait for the other results of a run: it resumes from them."""
    token = _RESULTS.set(None)
    try:
        yield
    finally:
        _RESULTS.reset(token)


@contextmanager
def claimed(path: Path, work: Path | None = None) -> Iterator[Path]:
    """An empty folder for what will become `path`, which no other run writes meanwhile.

    The folder is removed with all that is left in it. The operating system releases the claim
    however the process ends; file systems without locks have none.

    Args:
        path: a file or folder.
        work: the folder, on the same disk; None for one beside `path`.

    Raises:
        ConfigError: another run has claimed it.
        OutputError: the folder cannot be created.
    """
    try:
        work = work or _beside(path)
        lock = _lock(path, work)
    except (OSError, ValueError) as error:  # ValueError: a null or a lone surrogate in the name
        if isinstance(error, SaccadeError):
            raise
        raise OutputError(f"{path}: cannot be written: {reason_of(error)}") from error
    with lock, written_at_once():
        _clear(work)
        try:
            yield work
        finally:
            _clear(work)
            with suppress(OSError):  # the next run has it already
                (work / LOCK).unlink()
                work.rmdir()


@contextmanager
def atomic_write(path: str | Path, folder: Path | None = None) -> Iterator[Path]:
    """A temporary path that is renamed to `path` when the block ends without an error.

    In a block of `results_in` it is renamed at the end of that.

    Args:
        path: the file to write; missing folders are created, an old file is replaced.
        folder: of the temporary path, claimed and on the same disk; None to choose it.

    Yields:
        The path to write to; it has the same suffix as `path`.

    Raises:
        ConfigError: another run writes it.
        OutputError: the folder or the file cannot be written.
    """
    path, results = Path(path), _RESULTS.get()
    if folder is not None or (results is not None and not results.holds(path)):
        results = None
    with ExitStack() as stack, writing(path):
        if path.is_dir():
            raise IsADirectoryError(EISDIR, os.strerror(EISDIR))
        if path.exists():
            check_file(path)  # a device would be replaced
        if folder is None:
            folder = stack.enter_context(claimed(path)) if results is None else results.work
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(suffix=path.suffix, dir=folder)
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            temporary.chmod(0o644)
            if results is None:
                _appear(temporary, path)
            else:
                results.files[path] = temporary
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


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


class _Results(NamedTuple):
    """Files that a run has written and that have not appeared yet."""

    path: Path
    work: Path
    files: dict[Path, Path]
    """The temporary file of each."""

    def holds(self, path: Path) -> bool:
        """Whether a path belongs to these results."""
        return path.absolute().is_relative_to(self.path.absolute())


_RESULTS: ContextVar[_Results | None] = ContextVar("_RESULTS", default=None)


def _appear(temporary: Path, path: Path) -> None:
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.replace(path)


def _beside(path: Path) -> Path:
    """A hidden name for each name in a folder; any name may be as long as names can be."""
    return path.parent / f".saccade-{crc32(os.fsencode(path.name)):08x}"


def _clear(work: Path) -> None:
    """Remove all but the lock."""
    for each in work.iterdir():
        if each.is_dir():
            shutil.rmtree(each, ignore_errors=True)
        elif each.name != LOCK:
            each.unlink(missing_ok=True)


def _lock(path: Path, work: Path) -> BinaryIO:
    """The locked file in a folder, which is created."""
    while True:
        work.mkdir(parents=True, exist_ok=True)
        with suppress(FileNotFoundError), ExitStack() as stack:  # the run that had it just ended
            file = stack.enter_context((work / LOCK).open("wb"))
            _lock_file(file, path)
            if os.path.samestat(os.fstat(file.fileno()), (work / LOCK).stat()):
                stack.pop_all()
                return file


def _lock_file(file: BinaryIO, path: Path) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ConfigError(
            f"{path}: another run writes to it; wait until it has ended, or choose another output"
        ) from error
    except OSError:  # a file system without locks
        return


# A change to a format adds 1 here, and files of the older versions must stay readable:
# `tests/data/release-0.1` has one of each. Text files with named columns have no version.
FORMATS = {
    "run": 1,  # run.json of `saccade slam` and `saccade drive`
    "map": 1,  # map.npz of `saccade drive`
    "look": 1,  # NAME.look.npz of `saccade look`
    "slam_map": 4,  # of `Slam.save` and `saccade slam --save-map`
    "checkpoint": 10,  # of an interrupted run; other versions are ignored
    "points": 1,  # of an image: .npz; of many: .parquet, .h5
    "extraction": 1,  # the folder of `saccade extract`: in manifest.json, for all files
    "index": 1,  # the index of `saccade find`: in images.json, for all files
}
"""Current versions by name; older ones are read too."""


def check_format(name: str, version: object, path: object, error: type[Exception]) -> None:
    """Refuse files of a later version of this package.

    Args:
        name: one of `FORMATS`.
        version: in the file; None if it has none, as files of other programs.
        path: of the file.
        error: exception to raise.
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
