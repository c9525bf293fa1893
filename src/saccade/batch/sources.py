"""Sources of images: folders, patterns, lists, tars, videos and object stores."""

import os
import tarfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from saccade.batch.items import Item, is_url, open_location, remote_filesystem
from saccade.errors import ImageError
from saccade.files import IMAGE_SUFFIXES, VIDEO_SUFFIXES, as_text, read_text, reason_of

LIST_SUFFIXES = (".txt", ".lst")
TAR_SUFFIX = ".tar"
WILDCARDS = "*?["


class Source(Protocol):
    """A numbered sequence of images."""

    def __len__(self) -> int: ...

    def __getitem__(self, number: int, /) -> Item: ...


@dataclass(frozen=True)
class ImageFiles:
    """Image files below a root, sorted by name; about 100 bytes of memory each."""

    root: str
    """Prefix of every path."""
    names: Sequence[str]
    """Sorted."""
    raw_paths: Mapping[str, str]
    """By name, the paths that are not UTF-8."""

    @classmethod
    def below(cls, root: str, paths: Sequence[str]) -> "ImageFiles":
        """The images at paths below a root.

        Raises:
            ImageError: two would have the same name.
        """
        raw_paths = {name: path for path in paths if (name := as_text(path)) != path}
        if shared := raw_paths.keys() & set(paths) if raw_paths else ():
            raise ImageError(
                f"{as_text(root)}{min(shared)}: expected one file of this name, and "
                f"another whose name is no UTF-8 would share it; rename one"
            )
        return cls(root, sorted(map(as_text, paths)), raw_paths)

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, number: int, /) -> Item:
        name = self.names[number]
        return Item(name, self.root + self.raw_paths.get(name, name))


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
    try:
        images = _open_remote(source) if is_url(source) else _open_local(source, every)
    except OSError as error:
        raise ImageError(f"{source}: cannot be read: {reason_of(error)}") from error
    if not len(images):
        expected = ", ".join(IMAGE_SUFFIXES)
        hint = f"; for those of its folders: '{source}/**/*'" if Path(source).is_dir() else ""
        raise ImageError(f"{source}: expected images ({expected}), found none{hint}")
    return images


def _open_local(source: str, every: int) -> Source:
    path = Path(source)
    if path.is_dir():
        with os.scandir(source) as entries:
            found = [entry.name for entry in entries]
        from saccade.image import warn_of_unread

        warn_of_unread(found, source)
        names = [name for name in found if _is_image(name)]
        return ImageFiles.below(f"{source.rstrip('/')}/", names)
    if not path.exists() and _is_pattern(source):
        root = _root_of_pattern(source)
        matches = Path(root).glob(source.removeprefix(root))
        names = [match.relative_to(root).as_posix() for match in matches if not match.is_dir()]
        return _open_files(sorted(_supported(names, source)), root, every)
    if not path.exists():
        raise ImageError(f"{source}: cannot be read: no such file or folder")
    if source.lower().endswith(LIST_SUFFIXES):
        try:
            return _listed(read_text(path).splitlines(), str(path.parent))
        except UnicodeDecodeError as error:
            raise ImageError(f"{path}: expected a list of images, found no text") from error
    return _open_files([path.name], source[: source.rfind("/") + 1], every)


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
    files = ImageFiles.below(root, images)
    if not contained:
        return files
    return [files[number] for number in range(len(files))] + contained


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
    from saccade.video import VideoFrames

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
