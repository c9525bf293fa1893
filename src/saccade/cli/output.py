"""What commands print and write."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from saccade.errors import OutputError, SaccadeError
from saccade.files import atomic_write

if TYPE_CHECKING:
    from rich.console import Console

T = TypeVar("T")


def print_message(message: str) -> None:
    """A message for the person at the terminal, on stderr."""
    print(f"saccade: {message}", file=sys.stderr)


@contextmanager
def resumable(checkpoint: Path) -> Iterator[None]:
    """Tell who interrupts a run how to go on with it."""
    try:
        yield
    except KeyboardInterrupt:
        if checkpoint.exists():
            print_message(f"the same command goes on from {checkpoint}")
        raise


def messages() -> "Console":
    """The console of stderr; progress is shown only where it is a terminal."""
    from rich.console import Console

    return Console(stderr=True)


def tracked(items: Iterable[T], description: str, total: int) -> Iterable[T]:
    """The items one by one, with a progress bar on stderr where that is a terminal."""
    from rich.progress import track

    console = messages()
    return track(
        items,
        description=description,
        total=total,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def print_json(result: Mapping[str, Any]) -> None:
    """A result for programs, on stdout."""
    print(json.dumps(result, indent=2, allow_nan=False))


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A result for people, on stdout; without a head where no column has a name."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(title), title_justify="left", box=box.SIMPLE_HEAD, show_header=any(columns)
    )
    for number, column in enumerate(columns):
        table.add_column(Text(column), justify="left" if number == 0 else "right")
    for row in rows:
        table.add_row(*map(Text, row))  # brackets are no markup
    Console().print(table)


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all; what is no text in a name is escaped."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write named arrays as .npz, whole or not at all."""
    import numpy as np

    with atomic_write(path) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays)


def names_for(paths: Sequence[Path]) -> dict[Path, str]:
    """A name for the results of each input: its stem, numbered where two share one."""
    names: dict[Path, str] = {}
    taken: set[str] = set()
    for path in dict.fromkeys(paths):
        name, number = path.stem, 2
        while name in taken:
            name, number = f"{path.stem}-{number}", number + 1
        names[path] = name
        taken.add(name)
    return names


def for_each_image(
    paths: Sequence[Path], out: Path, work: Callable[[Path, str], dict[str, Any]]
) -> list[dict[str, Any]]:
    """Do `work(path, name)` for every image; a bad one is told and the others still done.

    Shows a progress bar on stderr where there are several.

    Args:
        paths: the images.
        out: folder that is named where something was left out.
        work: what to do for one; gives the row of the result.

    Returns:
        The rows of those that went well.

    Raises:
        SaccadeError: at the end, where an image was bad; the message of a single one as it is.
    """
    rows: list[dict[str, Any]] = []
    errors: list[SaccadeError] = []
    named: Iterable[tuple[Path, str]] = names_for(paths).items()
    if len(paths) > 1:
        named = tracked(named, f"{len(paths)} images", len(paths))
    for path, name in named:
        try:
            rows.append(work(path, name))
        except OutputError:
            raise
        except SaccadeError as error:
            errors.append(error)
            if len(paths) > 1:
                print_message(str(error))
    if errors and len(paths) > 1:
        message = f"{len(errors)} of {len(paths)} images left out; the others are in {out}"
        raise SaccadeError(message)
    if errors:
        raise errors[0]
    return rows
