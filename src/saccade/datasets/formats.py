"""Formats of recorded data: the row that every format has in the table of its kind."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from saccade.errors import ConfigError, SaccadeError
from saccade.extras import import_function
from saccade.io.files import decode_text, open_file, reading

AUTO = "auto"
"""Name of the format that is detected."""
LARGEST_START = 1 << 16
"""Maximum number of bytes of a file that are read to recognize its format."""


class Format(NamedTuple):
    """A format of files or folders."""

    read: Callable[..., Any]
    """Reads a path; its other parameters are the options that the format has."""
    suffixes: tuple[str, ...] = ()
    """Suffixes of its files, in lower case."""
    files: tuple[str, ...] = ()
    """Files or folders of which its folder has at least one."""
    recognizes: Callable[[Path], bool] | None = None
    """Whether the content of a file with another suffix, or of a folder, is in this format; None if
    the suffix and the `files` decide."""
    write: Callable[..., None] | None = None
    """Writes a path; None if the format is only read."""

    def matches(self, path: Path) -> bool:
        """Whether a folder or the content of a file is in this format."""
        if not (self.files and path.is_dir()):
            return self.recognizes is not None and self.recognizes(path)
        is_marked = any((path / name).exists() for name in self.files)
        return is_marked and (self.recognizes is None or self.recognizes(path))


def describe(formats: Mapping[str, Format]) -> str:
    """The names of formats in a list, for help and messages."""
    *some, last = formats
    return f"{', '.join(some)} or {last}"


def candidates(path: Path, formats: Mapping[str, Format]) -> list[str]:
    """Names of the formats of an existing path: those of its suffix, else those of its content."""
    suffix = path.suffix.lower()
    names = [name for name, form in formats.items() if path.is_file() and suffix in form.suffixes]
    return names or [name for name, form in formats.items() if form.matches(path)]


def detect(path: Path, formats: Mapping[str, Format], what: str, error: type[SaccadeError]) -> str:
    """Name of the format of a file or folder: by its suffix, else by its content.

    Args:
        path: the file or folder.
        formats: the table of its kind.
        what: what the file should be, for the message, such as "a landmark log".
        error: exception for a path that no format has.
    """
    with reading(path, error):
        names = candidates(path, formats)
    if names:
        return names[0]
    found = "none of these"
    if path.is_dir():
        known = {name: ", ".join(form.files) for name, form in formats.items() if form.files}
        expected = f"a folder with any of {', '.join(f'{v} ({k})' for k, v in known.items())}"
    else:
        known = {name: ", ".join(form.suffixes) for name, form in formats.items()}
        expected = f"{what}: {', '.join(f'{k} ({v})' if v else k for k, v in known.items())}"
        try:
            decode_text(_start_of(path))
        except OSError as caught:
            found = str(caught.strerror).partition("found ")[2]
    raise error(f"{path}: expected {expected}; found {found}")


def find_reader(
    kind: str | Callable[..., Any],
    path: Path,
    formats: Mapping[str, Format],
    what: str,
    error: type[SaccadeError],
) -> tuple[str, Callable[..., Any]]:
    """Name and reader of a format.

    Args:
        kind: a name in the table, "auto", module:function, or a function of the path.
        path: the file or folder.
        formats: see `detect`.
        what: see `detect`.
        error: see `detect`.

    Raises:
        ConfigError: an unknown name, or no such function.
        SaccadeError: the path is missing; with "auto", none of the formats.
    """
    if not path.exists():
        raise error(f"{path}: expected {what}, found no such file or folder")
    if callable(kind):
        return getattr(kind, "__name__", "a function"), kind
    if kind == AUTO:
        kind = detect(path, formats, what, error)
    elif ":" in kind:
        return kind, import_function("kind", kind)
    if kind not in formats:
        names = ", ".join((AUTO, *formats))
        raise ConfigError(f"kind: expected one of {names}, or module:function, found {kind!r}")
    return kind, formats[kind].read


def first_lines(path: Path, count: int = 100) -> list[str]:
    """The first lines of a text file; none of a folder, or of a file that is no text."""
    if not path.is_file():
        return []
    data = _start_of(path)
    with suppress(OSError):
        lines = decode_text(data).splitlines()
        return lines[: count if len(data) < LARGEST_START else min(count, len(lines) - 1)]
    return []


def _start_of(path: Path) -> bytes:
    with open_file(path) as opened:
        return opened.read(LARGEST_START)
