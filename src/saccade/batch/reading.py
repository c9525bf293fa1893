"""The bytes of an image, from wherever it is."""

import hashlib
import threading
from pathlib import Path
from typing import Any

from saccade.batch.sources import Item, remote_system
from saccade.errors import ImageError
from saccade.files import open_file, read_bytes, reason_of
from saccade.types import Image

_open = threading.local()
"""The video that a thread read from last: one goes through it once."""


def read_content(item: Item) -> "bytes | Image":
    """The bytes of a file, or the (H, W, 3) uint8 frame of a video.

    Raises:
        ImageError: it cannot be read.
    """
    try:
        if "://" in item.place:
            return _remote(item)
        if item.start < 0:
            return read_bytes(Path(item.place))
        if item.size < 0:
            return _frame(item)
        with open_file(Path(item.place)) as file:
            file.seek(item.start)
            return file.read(item.size)
    except ImageError:
        raise
    except Exception as error:  # every object store has its own
        known = isinstance(error, OSError | ValueError)  # no name can hold a null
        if not known and "://" not in item.place:
            raise
        raise ImageError(f"{item.place}: cannot be read: {reason_of(error)}") from error


def digest_of(content: "bytes | Image") -> str:
    """32 hexadecimal digits that tell a content from all others."""
    whole: Any = content
    return hashlib.blake2b(whole, digest_size=16).hexdigest()


def decoded(content: "bytes | Image", name: str) -> Image:
    """The image that was read.

    Raises:
        ImageError: it is none.
    """
    from saccade.image import decode_image

    return decode_image(content, name) if isinstance(content, bytes) else content


def _remote(item: Item) -> bytes:
    system, path = remote_system(item.place)
    start = max(item.start, 0)
    end = start + item.size if item.size >= 0 else None
    data: Any = system.cat_file(path, start=start or None, end=end)
    return bytes(data)


def _frame(item: Item) -> Image:
    from saccade.video import VideoFrames

    if getattr(_open, "place", None) != item.place:
        _open.frames, _open.place = VideoFrames(item.place), item.place
    frames: VideoFrames = _open.frames
    return frames[item.start]
