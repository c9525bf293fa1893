"""Where a job reads its images, and the folder or bucket of its results."""

import hashlib
import os
import tarfile
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from saccade.errors import ImageError, OutputError
from saccade.extras import import_optional
from saccade.io.files import (
    IMAGE_SUFFIXES,
    VIDEO_SUFFIXES,
    as_text,
    atomic_write,
    locked,
    open_file,
    read_bytes,
    read_text,
    reading,
    reason_of,
)
from saccade.types import Image

LIST_SUFFIXES = (".txt", ".lst")
TAR_SUFFIX = ".tar"
WILDCARDS = "*?["

Content: TypeAlias = "bytes | Image"
"""The bytes of an image file, or the (H, W, 3) uint8 frame of a video."""

_thread = threading.local()
"""Keeps the video that a thread read from last: its frames are read in order."""


class Item(NamedTuple):
    """One image: its name, and the location of its bytes."""

    name: str
    """In the data set: its path below the source."""
    location: str
    """Path, or a URL that fsspec understands, of the file that holds it."""
    offset: int | None = None
    """First byte in a tar; None for a file of its own and for a video frame."""
    size: int | None = None
    """Bytes in a tar."""
    frame: int | None = None
    """Number of the frame in a video."""


Source: TypeAlias = Sequence[Item]
"""Numbered images."""


def open_source(source: str, every: int = 1) -> Source:
    """The images of a source, given as on the command line.

    Args:
        source: a folder (images in its subfolders are not taken); a pattern such as
            `photos/**/*.jpg`; a list with a path or URL on each line (.txt); an image; a video; an
            uncompressed tar; or the URL of any of them but a video, such as `s3://bucket/photos`.
            A pattern may match tars and videos; one that ends in `*` skips all other files.
        every: of a video, take one frame of this many.

    Raises:
        ImageError: it does not exist, or holds no image.
    """
    if not source:
        raise ImageError("source: expected a folder, a pattern or a file, found an empty name")
    with reading(source, ImageError):
        images = _open_remote(source) if is_url(source) else _open_local(source, every)
    if not len(images):
        raise ImageError(f"{source}: expected images ({', '.join(IMAGE_SUFFIXES)}), found none")
    return images


def image_files(root: str, paths: Sequence[str]) -> list[Item]:
    """Image files at paths below a root, sorted by name.

    Args:
        root: prefix of every path.
        paths: of the files; a byte that is not UTF-8 is escaped in the name.

    Raises:
        ImageError: two would have the same name.
    """
    path_of: dict[str, str] = {}
    for path in paths:
        name = as_text(path)
        if path_of.setdefault(name, path) != path:
            raise ImageError(
                f"{as_text(root)}{name}: expected one file of this name, and another whose name "
                "is no UTF-8 would share it; rename one"
            )
    return [Item(name, root + path_of[name]) for name in sorted(path_of)]


def read_content(item: Item) -> Content:
    """The bytes of an image file, or the frame of a video.

    Raises:
        ImageError: it cannot be read.
    """
    try:
        if is_url(item.location):
            return _read_remote(item)
        if item.frame is not None:
            return _read_frame(item.location, item.frame)
        if item.offset is None or item.size is None:
            return read_bytes(Path(item.location))
        with open_file(Path(item.location)) as file:
            file.seek(item.offset)
            return file.read(item.size)
    except ImageError:
        raise
    except Exception as error:  # every object store raises its own
        known = isinstance(error, OSError | ValueError)  # ValueError: a null in the name
        if not known and not is_url(item.location):
            raise
        raise ImageError(f"{item.location}: cannot be read: {reason_of(error)}") from error


def content_hash(content: Content) -> str:
    """BLAKE2b of a content, 128 bits as 32 hexadecimal digits."""
    buffer: Any = content
    return hashlib.blake2b(buffer, digest_size=16).hexdigest()


def decode(content: Content, name: str) -> Image:
    """The image of a content.

    Raises:
        ImageError: the bytes are no image.
    """
    from saccade.io.image import decode_image

    return decode_image(content, name) if isinstance(content, bytes) else content


def is_url(location: str) -> bool:
    """Whether a location is a URL for fsspec, such as s3://bucket/photos, and not a path."""
    return "://" in location


def open_location(location: str) -> Any:
    """A file or an object behind a URL, open for reading bytes."""
    if not is_url(location):
        return open_file(Path(location))
    system, path = remote_filesystem(location)
    return system.open(path, "rb")


def remote_filesystem(url: str) -> tuple[Any, str]:
    """The fsspec file system of a URL, and the path in it.

    Raises:
        ConfigError: fsspec is not installed.
        ImageError: the scheme is unknown, or its library is not installed.
    """
    fsspec = import_optional("fsspec", "remote")
    import_optional("fsspec.core", "remote")
    try:
        system, path = fsspec.core.url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise ImageError(f"{url}: cannot be opened: {error}") from error
    return system, path


def _open_local(source: str, every: int) -> Source:
    from saccade.io.image import find_images

    path = Path(source)
    if source.lower().endswith(LIST_SUFFIXES) and not path.is_dir():
        return _listed(read_text(path).splitlines(), str(path.parent))
    if path.is_dir():
        root = f"{source.rstrip('/')}/"
    elif path.exists() or not _is_pattern(source):
        path.stat()  # an error where there is none
        return _open_files([path.name], source[: source.rfind("/") + 1], every)
    else:
        root = _root_of_pattern(source)
    names = [each.relative_to(root).as_posix() for each in find_images(source)]
    return _open_files(_supported(names, source), root, every)


def _open_remote(url: str) -> Source:
    system, path = remote_filesystem(url)
    scheme = url.partition("://")[0]
    if _is_pattern(path):
        root = _root_of_pattern(path).rstrip("/")
        paths = _supported(system.glob(path), path)
    elif path.lower().endswith((TAR_SUFFIX, *IMAGE_SUFFIXES)):
        root, paths = path.rpartition("/")[0], [path]
    elif path.lower().endswith(LIST_SUFFIXES):
        lines = system.cat_file(path).decode("utf-8-sig").splitlines()
        return _listed(lines, url.rpartition("/")[0])
    else:
        root = path.rstrip("/")
        paths = [entry for entry in system.ls(path, detail=False) if _is_image(entry)]
    names = sorted(each.removeprefix(f"{root}/") for each in paths)
    return _open_files(names, f"{scheme}://{root}/", every=None)


def _open_files(names: Sequence[str], root: str, every: int | None) -> Source:
    """Images, and those in the tars and videos among the files; no videos if `every` is None."""
    images: list[str] = []
    contained: list[Item] = []
    for name in names:
        lower = name.lower()
        if lower.endswith(TAR_SUFFIX):
            contained += _tar_members(root + name)
        elif lower.endswith(VIDEO_SUFFIXES) and every is not None:
            contained += _video_frames(root + name, every)
        else:
            images.append(name)
    return image_files(root, images) + contained


def _tar_members(location: str) -> list[Item]:
    """The images in an uncompressed tar, such as those of WebDataset, sorted by name.

    They are read where they lie, without unpacking.
    """
    prefix = f"{as_text(Path(location).name)}/"
    try:
        with open_location(location) as file, tarfile.open(fileobj=file, mode="r:") as archive:
            return sorted(
                Item(
                    prefix + as_text(member.name).removeprefix("./"),
                    location,
                    member.offset_data,
                    member.size,
                )
                for member in archive
                if member.isfile() and _is_image(member.name)
            )
    except (tarfile.TarError, EOFError) as error:
        found = " ".join(str(error).split())
        raise ImageError(f"{location}: expected a tar without compression: {found}") from error


def _video_frames(location: str, every: int) -> list[Item]:
    """Every n-th frame of a video, which is decoded once to count its frames."""
    from saccade.io.video import VideoFrames

    prefix = f"{as_text(Path(location).name)}/"
    frames = range(0, len(VideoFrames(location)), every)
    return [Item(f"{prefix}{frame:08d}", location, frame=frame) for frame in frames]


def _listed(lines: Sequence[str], root: str) -> list[Item]:
    """The images of a list, in its order; relative paths start from `root`."""
    locations = {}
    for line in lines:
        entry = line.strip()
        if entry and not line.startswith("#"):
            absolute = is_url(entry) or entry.startswith("/") or not root
            locations[_name_in_list(entry)] = entry if absolute else f"{root}/{entry}"
    return [Item(name, location) for name, location in locations.items()]


def _name_in_list(entry: str) -> str:
    """Name of an image of a list: its path, without a leading slash or `..`."""
    path = entry.partition("://")[2] or os.path.normpath(entry)
    return path.lstrip("/").removeprefix("../").strip("/")


def _supported(names: Sequence[str], pattern: str) -> Sequence[str]:
    """The matches of a pattern: all if it names a suffix, else those that may hold images."""
    if not pattern.endswith("*"):
        return names
    suffixes = (*IMAGE_SUFFIXES, *VIDEO_SUFFIXES, TAR_SUFFIX)
    return [name for name in names if name.lower().endswith(suffixes)]


def _is_image(name: str) -> bool:
    return name.lower().endswith(IMAGE_SUFFIXES)


def _is_pattern(path: str) -> bool:
    return any(wildcard in path for wildcard in WILDCARDS)


def _root_of_pattern(pattern: str) -> str:
    """The folders before the first wildcard, with their last slash."""
    first = min(pattern.find(wildcard) for wildcard in WILDCARDS if wildcard in pattern)
    return pattern[: pattern.rfind("/", 0, first) + 1]


def _read_remote(item: Item) -> bytes:
    system, path = remote_filesystem(item.location)
    start = item.offset or 0
    end = None if item.size is None else start + item.size
    data: Any = system.cat_file(path, start=start or None, end=end)
    return bytes(data)


def _read_frame(location: str, number: int) -> Image:
    from saccade.io.video import VideoFrames

    if getattr(_thread, "location", None) != location:
        _thread.video, _thread.location = VideoFrames(location), location
    video: VideoFrames = _thread.video
    return video[number]


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
        with atomic_write(self._path(name)) as temporary:
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
        with locked(Path(self.location)):
            for left in Path(self.location).glob("*/.saccade-*"):  # by a run that was killed
                left.unlink()
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
