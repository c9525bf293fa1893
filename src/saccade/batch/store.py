"""The folder or bucket of a data set: files appear in it whole or not at all."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from saccade.batch.sources import is_url, remote_filesystem
from saccade.errors import OutputError
from saccade.io.files import PARTIAL, atomic_write, open_file, results_in


def open_store(location: str) -> "Store":
    """The store at a path, or at a URL that fsspec understands."""
    return RemoteStore(location) if is_url(location) else Store(location)


class Store:
    """Named files in a folder of a file system; a name may have folders in it."""

    def __init__(self, location: str) -> None:
        self.location = location

    def list_files(self, folder: str) -> list[str]:
        """Names of the files in a folder, sorted; empty if the folder does not exist."""
        with suppress(FileNotFoundError, NotADirectoryError):
            return sorted(path.name for path in Path(self.location, folder).iterdir())
        return []

    def open(self, name: str) -> Any:
        """A file, open for reading and seeking.

        Raises:
            FileNotFoundError: there is none of this name.
        """
        return open_file(self._path(name))

    @contextmanager
    def writing(self, name: str) -> Iterator[Path]:
        """A temporary local path; the file appears when the block ends without an error.

        Raises:
            OutputError: it cannot be written.
        """
        with atomic_write(self._path(name), Path(self.location, PARTIAL)) as temporary:
            yield temporary

    def remove(self, name: str) -> None:
        """Delete a file, if it exists."""
        self._path(name).unlink(missing_ok=True)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Exclude other runs while the block lasts, where the store can.

        Raises:
            ConfigError: another run holds the lock.
        """
        with results_in(Path(self.location)):
            yield

    def _path(self, name: str) -> Path:
        """Refuses paths out of the folder: a broken table may hold any name."""
        path = Path(name)
        if path.is_absolute() or ".." in path.parts or "\0" in name:
            raise OutputError(f"{self.location}: expected a file in it, found {name!r}")
        return self.location / path


class RemoteStore(Store):
    """Named files in a bucket, where an upload appears at once and whole."""

    def __init__(self, location: str) -> None:
        super().__init__(location.rstrip("/"))
        self._system, self._root = remote_filesystem(self.location)

    def list_files(self, folder: str) -> list[str]:
        """See `Store`."""
        self._system.invalidate_cache()
        with suppress(FileNotFoundError):
            paths = self._system.ls(f"{self._root}/{folder}", detail=False)
            return sorted(name for path in paths if (name := path.rpartition("/")[2]))
        return []

    def open(self, name: str) -> Any:
        """See `Store`."""
        return self._system.open(f"{self._root}/{name}", "rb")

    @contextmanager
    def writing(self, name: str) -> Iterator[Path]:
        """See `Store`."""
        with tempfile.TemporaryDirectory(prefix="saccade-") as folder:
            temporary = Path(folder) / Path(name).name
            try:
                yield temporary
                self._system.put_file(str(temporary), f"{self._root}/{name}")
            except OutputError:
                raise
            except Exception as error:  # every object store raises its own
                message = f"{self.location}/{name}: cannot be written: {error}"
                raise OutputError(message) from error

    def remove(self, name: str) -> None:
        """See `Store`."""
        with suppress(FileNotFoundError):
            self._system.rm_file(f"{self._root}/{name}")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Buckets have no locks: two runs at once do some work twice."""
        yield
