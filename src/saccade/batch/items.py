"""One image of a source: the location of its bytes, and how they are read."""

import hashlib
import threading
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from saccade.errors import ImageError
from saccade.extras import import_optional
from saccade.files import open_file, read_bytes, reason_of
from saccade.types import Image

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
    from saccade.image import decode_image

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


def _read_remote(item: Item) -> bytes:
    system, path = remote_filesystem(item.location)
    start = item.offset or 0
    end = None if item.size is None else start + item.size
    data: Any = system.cat_file(path, start=start or None, end=end)
    return bytes(data)


def _read_frame(location: str, number: int) -> Image:
    from saccade.video import VideoFrames

    if getattr(_thread, "location", None) != location:
        _thread.video, _thread.location = VideoFrames(location), location
    video: VideoFrames = _thread.video
    return video[number]
