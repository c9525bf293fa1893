"""Sources of images: folders, patterns, lists, videos and buckets."""

import hashlib
import os
import re
from collections.abc import Callable, Sequence
from errno import EFBIG, ENOENT
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from pyarrow import fs

from saccade.batch.storage import ANONYMOUS, is_url, locate
from saccade.errors import ImageError, require
from saccade.io.files import (
    IMAGE_SUFFIXES,
    LARGEST_FILE,
    LARGEST_TEXT,
    VIDEO_SUFFIXES,
    decode_text,
    natural_order,
    read_bytes,
    reading,
)
from saccade.io.image import decode_image, orientation_of_bytes, warn_of_unread
from saccade.io.video import VideoFrames
from saccade.types import Image

LIST_SUFFIXES = (".txt", ".lst")
WILDCARDS = "*?["
CAMERA = re.compile(r"\s+[A-Z][A-Z0-9_]+(\s+\d+){2}(\s+[-+.\deE]+)+$")
"""Model, width, height and parameters of a camera after the name of an image."""

Content: TypeAlias = "bytes | Image"
"""The bytes of an image file, or the (H, W, 3) uint8 frame of a video."""


class Item(NamedTuple):
    """One image: its name, and the location of its bytes."""

    name: str
    """Path below the source."""
    location: str
    """Path or URL of the file that holds it."""
    stamp: str
    """Size and modification time of the file; empty where there is no file."""
    frame: int | None = None
    """Number of the frame in a video."""


Source: TypeAlias = Sequence[Item]
"""Images with different names."""


def open_source(
    source: str, every: int = 1, *, root: str | None = None, without: str | None = None
) -> Source:
    """The images of a source, given as on the command line.

    Args:
        source: a folder with its subfolders, but hidden ones; a pattern such as
            `photos/**/*.jpg`; a list with a path or URL on each line (.txt), perhaps followed by a
            camera; an image; a video; or a URL of images, such as `s3://bucket/photos`. A pattern
            may match videos; one that ends in `*` skips files that are neither images nor videos.
        every: of a video, take one frame of this many.
        root: folder or URL from which the relative paths of a list start; None for the list's own.
        without: folder of results, whose images do not count.

    Raises:
        ImageError: it does not exist, or holds no image.
        ConfigError: a URL that cannot be opened.
    """
    if not source:
        raise ImageError("source: expected a folder, a pattern or a file, found an empty name")
    with reading(source, ImageError, "names in UTF-8", ValueError):
        is_list = source.lower().endswith(LIST_SUFFIXES) and not Path(source).is_dir()
        require(is_list or root is None, "root", "a list of images (.txt) with a root", source)
        images = _listed(source, root) if is_list else _find(source, every)
        images = [each for each in images if not _is_below(each.location, without)]
    if not images:
        expected = f"expected images ({', '.join(IMAGE_SUFFIXES)}), found none"
        raise ImageError(f"{source}: {expected}")
    return images


def stamp_of(info: fs.FileInfo) -> str:
    """Size and modification time of a file; empty where there is no file."""
    return f"{info.size} {info.mtime_ns}" if info.is_file else ""


def is_local_file(item: Item) -> bool:
    """Whether an image is a file of its own on this machine."""
    return item.frame is None and not is_url(item.location)


def content_reader() -> Callable[[Item], Content]:
    """A function that reads images for one thread; raises `ImageError` where it cannot.

    It keeps the video of the last frame open: frames are read fastest in their order.
    """
    open_video = lru_cache(maxsize=1)(VideoFrames)

    def read(item: Item) -> Content:
        with reading(item.location, ImageError, "an image", ValueError):
            if item.frame is not None:
                return open_video(item.location)[item.frame]
            return _read(item.location)

    return read


def content_hash(content: Content) -> str:
    """BLAKE2b of a content, 128 bits as 32 hexadecimal digits."""
    buffer: Any = content
    return hashlib.blake2b(buffer, digest_size=16).hexdigest()


def decode(content: Content, name: str, *, keep_alpha: bool = False) -> Image:
    """The image of a content; raises `ImageError` where the bytes are no image."""
    return (
        decode_image(content, name, keep_alpha=keep_alpha)
        if isinstance(content, bytes)
        else content
    )


def orientation_of(content: Content) -> int:
    """The EXIF orientation of a content, 1 to 8."""
    return orientation_of_bytes(content) if isinstance(content, bytes) else 1


def _read(location: str, max_bytes: int = LARGEST_FILE) -> bytes:
    """The content of a file of limited size."""
    if not is_url(location):
        return read_bytes(Path(location), max_bytes)
    system, path = locate(location)
    with system.open_input_file(path) as file:
        if file.size() > max_bytes:
            raise OSError(EFBIG, os.strerror(EFBIG))
        return bytes(file.read())


def _find(source: str, every: int) -> list[Item]:
    """The images of a source that is no list."""
    system, path = locate(source)
    info = system.get_file_info(path)
    suffixes: tuple[str, ...] = ("",)
    folder = path[: path.rfind("/") + 1]
    if info.type == fs.FileType.Directory:
        folder, suffixes = f"{path}/", IMAGE_SUFFIXES
        every_file = system.get_file_info(fs.FileSelector(path, recursive=True))
        found = [each for each in every_file if not _is_hidden(each.path.removeprefix(folder))]
        warn_of_unread((each.base_name for each in found), source)
    elif info.is_file:
        found = [info]
    elif any(wildcard in path for wildcard in WILDCARDS):
        folder = re.split(r"[^/]*[*?\[]", path, maxsplit=1)[0]
        every_file = system.get_file_info(fs.FileSelector(folder.rstrip("/"), recursive=True))
        found = [each for each in every_file if re.fullmatch(_expression_of(path), each.path)]
        if path.endswith("*"):
            suffixes = IMAGE_SUFFIXES + VIDEO_SUFFIXES
            warn_of_unread((each.base_name for each in found), source)
    else:
        raise FileNotFoundError(ENOENT, os.strerror(ENOENT))
    location = (source if is_url(source) else path).rstrip("/")
    base = location.removesuffix(path[len(folder) :]).rstrip("/")
    images, frames = [], []
    for each in sorted(found, key=lambda info: natural_order(info.path)):
        name, lower = each.path.removeprefix(folder), each.path.lower()
        if not each.is_file or not lower.endswith(suffixes):
            continue
        if lower.endswith(VIDEO_SUFFIXES):
            frames += _video_frames(f"{base}/{name}", stamp_of(each), every)
        else:
            images.append(Item(name, f"{base}/{name}", stamp_of(each)))
    return images + frames


def _expression_of(pattern: str) -> str:
    """The regular expression of a pattern with `**/`, `*`, `?` and `[...]`."""
    escaped = re.sub(r"\\([\[\]\-])", r"\1", re.escape(pattern)).replace("[!", "[^")
    escaped = escaped.replace(r"\*\*/", "(?:.*/)?")
    return escaped.replace(r"\*", "[^/]*").replace(r"\?", "[^/]")


def _video_frames(location: str, stamp: str, every: int) -> list[Item]:
    """Every n-th frame of a video, which is decoded once to count its frames."""
    frames = range(0, len(VideoFrames(location)), every)
    return [Item(f"{Path(location).name}/{n:08d}", location, stamp, n) for n in frames]


def _is_hidden(path: str) -> bool:
    """Whether a file is hidden or in a hidden folder."""
    return any(part.startswith(".") for part in path.split("/"))


def _is_below(location: str, folder: str | None) -> bool:
    """Whether a local file is in a folder."""
    if folder is None or is_url(location) or is_url(folder):
        return False
    return Path(location).absolute().is_relative_to(Path(folder).absolute())


def _listed(source: str, root: str | None) -> list[Item]:
    """The images of a list, in its order; relative paths start from a root, or its folder."""
    system, path = locate(source)
    lines = decode_text(_read(source, LARGEST_TEXT)).splitlines()
    root = (root or (source if is_url(source) else path).rpartition("/")[0]).rstrip("/")
    items = {}
    for line in map(str.strip, lines):
        if line and not line.startswith("#"):
            entry = CAMERA.sub("", line)
            location = entry if is_url(entry) or entry.startswith("/") else f"{root}/{entry}"
            system, path = locate(location)
            name = _name_in_list(entry)
            items[name] = Item(name, location, stamp_of(system.get_file_info(path)))
    return list(items.values())


def _name_in_list(entry: str) -> str:
    """Name of an image of a list: its path, without leading slashes and `..`."""
    path = entry.partition("://")[2].removeprefix(ANONYMOUS) or os.path.normpath(entry)
    return re.sub(r"^(\.\.?/|/)+", "", path).strip("/")
