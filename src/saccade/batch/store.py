"""The folder or bucket that results go to: files appear in it whole or not at all."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Protocol

from saccade.batch.sources import remote_system
from saccade.errors import OutputError
from saccade.files import atomic_write, make_folder, open_file, reason_of

LEFTOVERS = ".partial"
"""Folder of files that are being written; hidden from those who read the data set."""
LOCK = ".lock"


class Store(Protocol):
    """Named files; a name may have folders in it."""

    place: str

    def names(self, folder: str) -> list[str]:
        """What is in a folder, sorted; nothing if there is none."""

    def open(self, name: str) -> Any:
        """A file that can be read from and searched.

        Raises:
            FileNotFoundError: there is none of this name.
        """

    @contextmanager
    def writing(self, name: str) -> Iterator[Path]:
        """A temporary path on this machine; the file appears when the block ends well.

        Raises:
            OutputError: it cannot be written.
        """

    def remove(self, name: str) -> None:
        """Take a file away, if it is there."""

    @contextmanager
    def locked(self) -> Iterator[None]:
        """While the block runs nobody else runs one, where the store can promise that.

        Raises:
            OutputError: somebody does.
        """


def open_store(place: str) -> Store:
    """The store at a path, or at a URL that fsspec understands."""
    return Remote(place) if "://" in place else Folder(place)


class Folder:
    """A store in a folder of a file system."""

    def __init__(self, place: str) -> None:
        self.place = place
        self._root = Path(place)

    def names(self, folder: str) -> list[str]:
        """What is in a folder, sorted."""
        with suppress(FileNotFoundError, NotADirectoryError):
            return sorted(each.name for each in (self._root / folder).iterdir())
        return []

    def open(self, name: str) -> Any:
        """A file for reading."""
        return open_file(self._path(name))

    @contextmanager
    def writing(self, name: str) -> Iterator[Path]:
        """A temporary path; the file appears when the block ends well."""
        with atomic_write(self._path(name), self._root / LEFTOVERS) as temporary:
            yield temporary

    def remove(self, name: str) -> None:
        """Take a file away, if it is there."""
        self._path(name).unlink(missing_ok=True)

    def _path(self, name: str) -> Path:
        """Of a file that is in the folder: a table may hold any name."""
        path = Path(name)
        if path.is_absolute() or ".." in path.parts or "\0" in name:
            raise OutputError(f"{self.place}: expected a file in it, found {name!r}")
        return self._root / path

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Until the block ends, or the process: however it ends."""
        make_folder(self._root)
        try:
            with (self._root / LOCK).open("w") as file:
                _lock(file, self.place)
                shutil.rmtree(self._root / LEFTOVERS, ignore_errors=True)
                yield
                shutil.rmtree(self._root / LEFTOVERS, ignore_errors=True)
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(f"{self.place}: cannot be written: {reason_of(error)}") from error


class Remote:
    """A store in a bucket, where what is put is there at once and whole."""

    def __init__(self, place: str) -> None:
        self.place = place.rstrip("/")
        self._system, self._root = remote_system(self.place)

    def names(self, folder: str) -> list[str]:
        """What is in a folder, sorted."""
        self._system.invalidate_cache()
        with suppress(FileNotFoundError):
            found = self._system.ls(f"{self._root}/{folder}", detail=False)
            return sorted(name for each in found if (name := each.rpartition("/")[2]))
        return []

    def open(self, name: str) -> Any:
        """A file for reading."""
        return self._system.open(f"{self._root}/{name}", "rb")

    @contextmanager
    def writing(self, name: str) -> Iterator[Path]:
        """A temporary path; the file appears when the block ends well."""
        with tempfile.TemporaryDirectory(prefix="saccade-") as folder:
            temporary = Path(folder) / Path(name).name
            try:
                yield temporary
                self._system.put_file(str(temporary), f"{self._root}/{name}")
            except OutputError:
                raise
            except Exception as error:  # every store has its own
                raise OutputError(f"{self.place}/{name}: cannot be written: {error}") from error

    def remove(self, name: str) -> None:
        """Take a file away, if it is there."""
        with suppress(FileNotFoundError):
            self._system.rm_file(f"{self._root}/{name}")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """A bucket has no locks: who starts two runs at once does some work twice."""
        yield


def _lock(file: Any, place: str) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        message = f"{place}: another run writes to it; wait until it has ended"
        raise OutputError(message) from error
