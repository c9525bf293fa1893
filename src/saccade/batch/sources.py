"""Where the images are: files, lists, tars, videos and object stores, all as one numbered list."""

import os
import tarfile
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from saccade.errors import ImageError
from saccade.extras import import_optional
from saccade.files import IMAGE_SUFFIXES, VIDEO_SUFFIXES, as_text, open_file, read_text

LIST_SUFFIXES = (".txt", ".lst")
TAR_SUFFIX = ".tar"
SIGNS = "*?["
"""Of a pattern."""


class Item(NamedTuple):
    """One image: what it is called, and where its bytes are."""

    name: str
    """In the data set: its path below the source."""
    place: str
    """A path, or a URL that fsspec understands."""
    start: int = -1
    """Its first byte in a tar, or its number in a video; -1 for a file of its own."""
    size: int = -1
    """Bytes in a tar; -1 for a frame of a video."""


class Source(Protocol):
    """Images by their numbers, in the order of their names."""

    def __len__(self) -> int: ...

    def __getitem__(self, number: int) -> Item: ...

    def find(self, name: str) -> int | None:
        """The number of an image."""


@dataclass(frozen=True)
class Files:
    """Files of their own; some hundred bytes of memory each."""

    root: str
    """What stands before every path."""
    names: Sequence[str]
    """Sorted."""
    odd: Mapping[str, str]
    """By name, the paths that are no text."""

    @classmethod
    def of(cls, root: str, paths: Sequence[str]) -> "Files":
        """Of paths below a root.

        Raises:
            ImageError: two would share a name.
        """
        odd = {name: path for path in paths if (name := as_text(path)) != path}
        if shared := odd.keys() & set(paths) if odd else ():
            raise ImageError(
                f"{as_text(root)}{min(shared)}: expected one file of this name, and "
                f"another whose name is no UTF-8 would share it; rename one"
            )
        return cls(root, sorted(map(as_text, paths)), odd)

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, number: int) -> Item:
        name = self.names[number]
        return Item(name, self.root + self.odd.get(name, name))

    def find(self, name: str) -> int | None:
        """The number of an image."""
        number = bisect_left(self.names, name)
        return number if number < len(self) and self.names[number] == name else None


@dataclass(frozen=True)
class Listed:
    """The places of a list, in its order."""

    places: dict[str, str]
    """By name."""
    order: Sequence[str]
    """Names."""

    @classmethod
    def of(cls, lines: Sequence[str], root: str) -> "Listed":
        """Of lines with a path or URL each; a relative one is meant from `root`."""
        meant = [line.strip() for line in lines if line.strip() and not line.startswith("#")]
        places = {name_of(line): _from(root, line) for line in meant}
        return cls(places, list(places))

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.order)}

    def __len__(self) -> int:
        return len(self.order)

    def __getitem__(self, number: int) -> Item:
        name = self.order[number]
        return Item(name, self.places[name])

    def find(self, name: str) -> int | None:
        """The number of an image."""
        return self._numbers.get(name)


@dataclass(frozen=True)
class Tar:
    """The images in a tar, as WebDataset has them; they are read from where they lie."""

    place: str
    prefix: str
    """Of the names of its images: that of the tar."""
    members: Sequence[tuple[str, int, int]]
    """Name, first byte and size, sorted."""

    @classmethod
    def of(cls, place: str) -> "Tar":
        """Go through a tar once, and remember where each image lies."""
        prefix = f"{as_text(Path(place).name)}/"
        try:
            with open_place(place) as file, tarfile.open(fileobj=file, mode="r:") as archive:
                members = sorted(
                    (as_text(each.name).removeprefix("./"), each.offset_data, each.size)
                    for each in archive
                    if each.isfile() and is_image(each.name)
                )
        except (tarfile.TarError, EOFError) as error:
            found = " ".join(str(error).split())
            raise ImageError(f"{place}: expected a tar without compression: {found}") from error
        return cls(place, prefix, members)

    def __len__(self) -> int:
        return len(self.members)

    def __getitem__(self, number: int) -> Item:
        name, start, size = self.members[number]
        return Item(self.prefix + name, self.place, start, size)

    def find(self, name: str) -> int | None:
        """The number of an image."""
        wanted = name.removeprefix(self.prefix)
        number = bisect_left(self.members, (wanted, -1, -1))
        found = number < len(self) and self.members[number][0] == wanted
        return number if found and name.startswith(self.prefix) else None


@dataclass(frozen=True)
class Video:
    """Every so many frames of a video."""

    place: str
    frames: int
    """That it has."""
    every: int = 1

    @classmethod
    def of(cls, place: str, every: int) -> "Video":
        """Go through a video once, and count."""
        from saccade.video import VideoFrames

        return cls(place, len(VideoFrames(place)), every)

    @property
    def _prefix(self) -> str:
        return f"{as_text(Path(self.place).name)}/"

    def __len__(self) -> int:
        return -(-self.frames // self.every)

    def __getitem__(self, number: int) -> Item:
        frame = number * self.every
        return Item(f"{self._prefix}{frame:08d}", self.place, frame)

    def find(self, name: str) -> int | None:
        """The number of a frame."""
        frame = name.removeprefix(self._prefix)
        if frame == name or not frame.isdigit() or int(frame) % self.every:
            return None
        return int(frame) // self.every if int(frame) < self.frames else None


@dataclass(frozen=True)
class ConcatenatedSources:
    """Sources one after the other."""

    parts: Sequence[Source]

    def __len__(self) -> int:
        return sum(map(len, self.parts))

    def __getitem__(self, number: int) -> Item:
        for part in self.parts:
            if number < len(part):
                return part[number]
            number -= len(part)
        raise IndexError(number)

    def find(self, name: str) -> int | None:
        """The number of an image."""
        before = 0
        for part in self.parts:
            number = part.find(name)
            if number is not None:
                return before + number
            before += len(part)
        return None


def open_source(source: str, every: int = 1) -> Source:
    """The images that a word of the command line names.

    Args:
        source: a folder, whose images are taken but not those of folders in it; a pattern such
            as `photos/**/*.jpg`; a list with a path or URL on each line (.txt); an image; a
            video; a tar without compression; or the URL of any of them but the video, such as
            `s3://bucket/photos`. What a pattern names may be tars and videos; one that ends in
            `*` takes nothing else.
        every: of a video, take one frame of so many.

    Raises:
        ImageError: there is no such thing, or no image in it.
    """
    if not source:
        raise ImageError("source: expected a folder, a pattern or a file, found an empty name")
    try:
        found = _remote(source) if "://" in source else _local(source, every)
    except OSError as error:
        reason = error.strerror or str(error) or type(error).__name__
        raise ImageError(f"{source}: cannot be read: {reason}") from error
    if not len(found):
        expected = ", ".join(IMAGE_SUFFIXES)
        deeper = f"; for those of its folders: '{source}/**/*'" if Path(source).is_dir() else ""
        raise ImageError(f"{source}: expected images ({expected}), found none{deeper}")
    return found


def is_image(name: str) -> bool:
    """Whether a name ends as those of images do."""
    return name.lower().endswith(IMAGE_SUFFIXES)


def _from(root: str, line: str) -> str:
    return line if "://" in line or line.startswith("/") or not root else f"{root}/{line}"


def name_of(place: str) -> str:
    """What an image of a list is called: its place, without what no name may begin with."""
    path = place.partition("://")[2] or os.path.normpath(place)
    return path.lstrip("/").removeprefix("../").strip("/")


def open_place(place: str) -> Any:
    """A file or what a URL names, open for reading bytes."""
    if "://" not in place:
        return open_file(Path(place))
    system, path = remote_system(place)
    return system.open(path, "rb")


def remote_system(url: str) -> tuple[Any, str]:
    """The file system that a URL names, and the path in it."""
    fsspec = import_optional("fsspec", "remote")
    import_optional("fsspec.core", "remote")
    try:
        system, path = fsspec.core.url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise ImageError(f"{url}: cannot be opened: {error}") from error
    return system, path


def _local(source: str, every: int) -> Source:
    path = Path(source)
    if path.is_dir():
        with os.scandir(source) as entries:
            names = [each.name for each in entries if is_image(each.name)]
        return Files.of(f"{source.rstrip('/')}/", names)
    if not path.exists() and any(sign in source for sign in SIGNS):
        root = _before_signs(source)
        found = Path(root).glob(source.removeprefix(root))
        names = [each.relative_to(root).as_posix() for each in found if not each.is_dir()]
        return _mixed(sorted(_meant(names, source)), root, every)
    if not path.exists():
        raise ImageError(f"{source}: cannot be read: no such file or folder")
    if source.lower().endswith(LIST_SUFFIXES):
        return Listed.of(_lines(path), str(path.parent))
    folder = source[: source.rfind("/") + 1]
    return _mixed([path.name], folder, every)


def _meant(names: Sequence[str], pattern: str) -> Sequence[str]:
    """Of what a pattern names: all if it says how names end, otherwise what may hold images."""
    suffixes = (*IMAGE_SUFFIXES, *VIDEO_SUFFIXES, TAR_SUFFIX)
    if not pattern.endswith("*"):
        return names
    return [name for name in names if name.lower().endswith(suffixes)]


def _before_signs(pattern: str) -> str:
    """The folders of a pattern that are no pattern yet, with their last slash."""
    first = min(pattern.find(sign) for sign in SIGNS if sign in pattern)
    return pattern[: pattern.rfind("/", 0, first) + 1]


def _mixed(names: Sequence[str], root: str, every: int = 0) -> Source:
    """Files, and among them tars and videos."""
    containers: list[Source] = []
    plain = []
    for name in names:
        lower = name.lower()
        if lower.endswith(TAR_SUFFIX):
            containers.append(Tar.of(root + name))
        elif lower.endswith(VIDEO_SUFFIXES) and every:
            containers.append(Video.of(root + name, every))
        else:
            plain.append(name)
    files = Files.of(root, plain)
    return (
        ConcatenatedSources([files, *containers] if plain else containers) if containers else files
    )


def _lines(path: Path) -> list[str]:
    try:
        return read_text(path).splitlines()
    except UnicodeDecodeError as error:
        raise ImageError(f"{path}: expected a list of images, found no text") from error


def _remote(url: str) -> Source:
    system, path = remote_system(url)
    scheme = url.partition("://")[0]
    if any(sign in path for sign in SIGNS):
        base = _before_signs(path).rstrip("/")
        found = _meant(system.glob(path), path)
    elif path.lower().endswith((TAR_SUFFIX, *IMAGE_SUFFIXES)):
        base, found = path.rpartition("/")[0], [path]
    elif path.lower().endswith(LIST_SUFFIXES):
        lines = system.cat_file(path).decode("utf-8-sig").splitlines()
        return Listed.of(lines, url.rpartition("/")[0])
    else:
        base = path.rstrip("/")
        found = [each for each in system.ls(path, detail=False) if is_image(each)]
    names = sorted(each.removeprefix(f"{base}/") for each in found)
    return _mixed(names, f"{scheme}://{base}/")
