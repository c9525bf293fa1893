"""Files in folders and in buckets, through the file systems of PyArrow."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

from pyarrow import fs

from saccade.errors import ConfigError
from saccade.io.files import atomic_write, locked, one_line, read_bytes, writing

ANONYMOUS = "anonymous@"
"""Prefix of the bucket in a URL that is read without credentials."""


def is_url(location: str) -> bool:
    """Whether a location is a URL, such as s3://bucket/photos, and not a path."""
    return "://" in location


def locate(location: str) -> tuple[fs.FileSystem, str]:
    """The file system of a location, and the path in it.

    Args:
        location: a path; or a URL that begins with s3://BUCKET/, gs://BUCKET/ or
            abfs://CONTAINER@ACCOUNT.dfs.core.windows.net/, where "anonymous@" before the bucket or
            container is for access without credentials.

    Raises:
        ConfigError: an unknown scheme, or a bucket that cannot be reached.
    """
    if not is_url(location):
        return fs.LocalFileSystem(), str(Path(location).absolute())
    scheme, _, rest = location.partition("://")
    bucket, _, path = rest.partition("/")
    try:
        system, root = _open_bucket(scheme, bucket)
    except (OSError, ValueError, NotImplementedError) as error:
        raise ConfigError(f"{location}: cannot be opened: {one_line(error)}") from error
    return system, f"{root}/{path}".rstrip("/")


@lru_cache
def _open_bucket(scheme: str, bucket: str) -> tuple[fs.FileSystem, str]:
    name, endpoint = bucket.removeprefix(ANONYMOUS), os.environ.get("AWS_ENDPOINT_URL")
    if name != bucket and scheme == "s3":
        region = None if endpoint else fs.resolve_s3_region(name)
        return fs.S3FileSystem(anonymous=True, region=region, endpoint_override=endpoint), name
    url = f"{scheme}://{bucket}"
    if name != bucket and scheme in ("abfs", "abfss"):
        url = f"{scheme}://{name}?credential_kind=anonymous"
    system, root = fs.FileSystem.from_uri(url)
    return system, root


class Store:
    """Named files in a folder or bucket; a name may have folders in it.

    Buckets have no locks. Two runs at once do some work twice; the next run removes duplicates.

    Args:
        location: path or URL of the folder, which need not exist.
    """

    def __init__(self, location: str | Path) -> None:
        self.location = str(location)
        self._system, self._root = locate(self.location)

    def list_files(self, folder: str) -> list[str]:
        """Names of the files in a folder with the folder, sorted; empty without the folder."""
        selector = fs.FileSelector(f"{self._root}/{folder}", allow_not_found=True)
        found = self._system.get_file_info(selector)
        names = [each.base_name for each in found if each.is_file]
        return sorted(f"{folder}/{name}" for name in names if not name.startswith("."))

    def open(self, name: str) -> Any:
        """A file, open for reading and seeking; raises `FileNotFoundError` without a file."""
        return self._system.open_input_file(f"{self._root}/{name}")

    @contextmanager
    def writing(self, name: str) -> Iterator[Path]:
        """A temporary local path; the file appears whole when the block ends without an error."""
        if not is_url(self.location):
            with atomic_write(Path(self.location, name)) as temporary:
                yield temporary
            return
        with tempfile.TemporaryDirectory(prefix="saccade-") as local:
            yield Path(local, "file")
            with (
                writing(Path(self.location, name)),
                self._system.open_output_stream(f"{self._root}/{name}") as stream,
            ):
                stream.write(read_bytes(Path(local, "file")))

    def remove(self, name: str) -> None:
        """Deletes a file."""
        self._system.delete_file(f"{self._root}/{name}")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Excludes other runs from a folder while the block lasts."""
        if is_url(self.location):
            yield
            return
        with locked(Path(self.location)):
            for remainder in Path(self.location).glob("*/.saccade-*"):  # of a killed run
                remainder.unlink()
            yield
