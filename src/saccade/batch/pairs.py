"""Which pairs of images are matched."""

from collections.abc import Collection, Sequence
from itertools import combinations
from pathlib import Path
from typing import TypeAlias

from saccade.batch.sources import ImageFiles, Source, open_source
from saccade.errors import ConfigError
from saccade.exchange.fields import check_name
from saccade.files import atomic_write, is_file, read_text, reason_of

Pair: TypeAlias = tuple[str, str]
"""The names of two images."""


def read_pairs(path: Path) -> list[Pair]:
    """The pairs in a list, as hloc and COLMAP have it; each once, in the first of its orders.

    Args:
        path: two names to a line, separated by blanks, or by a tab where names have blanks;
            empty lines and those that begin with # are skipped.

    Raises:
        ConfigError: the list cannot be read or is empty, or a line is no pair; tells which.
    """
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {reason_of(error)}") from error
    pairs: dict[Pair, None] = {}
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.startswith("#"):
            continue
        names = line.split("\t") if "\t" in line else line.split()
        if len(names) != 2 or names[0] == names[1] or not all(names):
            raise ConfigError(f"{path}, line {number}: expected two images, found {line[:80]!r}")
        if (names[1], names[0]) not in pairs:
            pairs[names[0], names[1]] = None
    if not pairs:
        raise ConfigError(f"{path}: expected pairs of images, found none")
    return list(pairs)


def write_pairs(path: Path, pairs: Sequence[Pair]) -> None:
    """Write a list that `read_pairs` and hloc read."""
    lines = (("\t" if " " in "".join(pair) else " ").join(pair) for pair in pairs)
    with atomic_write(path) as temporary:
        temporary.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def images_and_pairs(source: str, listed: Path | None) -> tuple[Source, list[Pair]]:
    """The images of a source, and their pairs.

    Args:
        source: as for `saccade extract`; with a list also a folder whose subfolders it names.
        listed: a list of pairs; None for all pairs.

    Raises:
        ImageError: the source does not exist, or holds no image.
        ConfigError: the list is broken, or names an image that is not in the source; or the
            source has only one image.
        KeypointsError: a name that the formats cannot hold, such as an absolute path.
    """
    if listed is None:
        images = open_source(source)
        pairs = list(combinations([images[number].name for number in range(len(images))], 2))
        if not pairs:
            raise ConfigError(f"{source}: expected two images or more, found one")
        return images, pairs
    pairs = read_pairs(listed)
    names = sorted({check_name(name) for pair in pairs for name in pair})
    if Path(source).is_dir():
        root = f"{source.rstrip('/')}/"
        _check_names(listed, names, [name for name in names if is_file(Path(root, name))], source)
        return ImageFiles.below(root, names), pairs
    images = open_source(source)
    items = {images[number].name: images[number] for number in range(len(images))}
    _check_names(listed, names, items, source)
    return [items[name] for name in names], pairs


def _check_names(listed: Path, names: Sequence[str], known: Collection[str], source: str) -> None:
    absent = [name for name in names if name not in known]
    if absent:
        raise ConfigError(
            f"{listed}: expected images of {source}, found {absent[0][:80]!r}, which is not there"
            + (f", and {len(absent) - 1} more" if absent[1:] else "")
        )
