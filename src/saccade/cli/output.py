"""What commands print and write."""

import json
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TextIO, TypeVar

from saccade.cli.batch_run import INTERRUPTED, stop_on_interrupt
from saccade.errors import ImageWarning, LogWarning, OutputError, SaccadeError
from saccade.io.files import as_text, atomic_write

T = TypeVar("T")


class Progress(Protocol):
    """Callback that reports the progress of a run."""

    def __call__(self, done: int, total: int | None = None, stage: str = "") -> None:
        """Report the steps done, their number, and the stage of the run."""


def print_message(message: str) -> None:
    """Print a message for the user on stderr."""
    print(f"saccade: {message}", file=sys.stderr)


def print_data_warnings() -> None:
    """Print warnings of images and logs as messages; those of libraries stay as they are."""
    show = warnings.showwarning

    def print_warning(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if issubclass(category, (ImageWarning, LogWarning)):
            print_message(str(message))
        else:
            show(message, category, filename, lineno, file, line)

    warnings.showwarning = print_warning


@contextmanager
def resumable(checkpoint: Path) -> Iterator[None]:
    """On Ctrl-C, say how to resume the run."""
    try:
        yield
    except KeyboardInterrupt:
        if checkpoint.exists():
            print_message(f"run the same command again to resume from {checkpoint}")
        raise


@contextmanager
def progress_bar(description: str, total: int | None = None) -> Iterator[Progress]:
    """A progress bar on stderr if that is a terminal; yields the callback that advances it."""
    from rich import progress
    from rich.console import Console
    from rich.markup import escape

    console = Console(stderr=True)
    hidden = not console.is_terminal
    with progress.Progress(console=console, transient=True, disable=hidden) as bar:
        task = bar.add_task(escape(description), total=total)

        def update(done: int, total: int | None = None, stage: str = "") -> None:
            label = f"{description}: {stage}" if stage else description
            bar.update(task, description=escape(label), completed=done, total=total)

        yield update


def tracked(items: Iterable[T], description: str, total: int) -> Iterator[T]:
    """Iterate with a progress bar."""
    with progress_bar(description, total) as update:
        for number, item in enumerate(items):
            yield item
            update(number + 1)


def print_json(result: Mapping[str, Any]) -> None:
    """Print a result as JSON on stdout."""
    print(json.dumps(result, indent=2, allow_nan=False))


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table on stdout, without a header where no column has a name."""
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


class Table(NamedTuple):
    """A table on the terminal; those of reports begin alike."""

    title: str
    columns: Sequence[str]
    """Without a header where all are empty."""
    rows: Sequence[Sequence[str]]


class _Tabular(Protocol):
    """A table of a terminal or of a report."""

    @property
    def title(self) -> str: ...
    @property
    def columns(self) -> Sequence[str]: ...
    @property
    def rows(self) -> Sequence[Sequence[str]]: ...


def emit(row: Mapping[str, Any], as_json: bool, *tables: _Tabular) -> None:
    """Print a result on stdout: `row` as JSON, or tables."""
    if as_json:
        print_json(row)
        return
    for table in tables:
        print_table(table.title, table.columns, table.rows)


def emit_facts(
    row: Mapping[str, Any],
    as_json: bool,
    title: str,
    facts: Mapping[str, object] | None = None,
) -> None:
    """Print a result as JSON, or as a table of names and values; of `facts` where given."""
    named = (row if facts is None else facts).items()
    emit(row, as_json, Table(title, ["", ""], [(name, str(value)) for name, value in named]))


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically; surrogates in file names are escaped."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write named arrays as .npz atomically."""
    from saccade.io.npz import save_arrays

    with atomic_write(path) as temporary:
        save_arrays(temporary, arrays)


def names_for(paths: Sequence[Path]) -> dict[Path, str]:
    """Unique names for the results of each input: its stem, numbered where it is taken."""
    names: dict[Path, str] = {}
    taken: set[str] = set()
    for path in dict.fromkeys(paths):
        name, number = path.stem, 2
        while name in taken:
            name, number = f"{path.stem}-{number}", number + 1
        names[path] = name
        taken.add(name)
    return names


def relative_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Each path relative to the common folder, as COLMAP and hloc name images."""
    if not paths:
        return {}
    absolute = [path.absolute() for path in paths]
    root = os.path.commonpath([path.parent for path in absolute])
    return {
        path: as_text(each.relative_to(root).as_posix())
        for path, each in zip(paths, absolute, strict=True)
    }


def for_each_image(
    paths: Sequence[Path], out: Path, process: Callable[[Path, str], dict[str, Any]]
) -> tuple[list[dict[str, Any]], int]:
    """Process every image, with a progress bar; errors of single images do not stop the others.

    Ctrl-C stops after the image in progress.

    Args:
        paths: the images.
        out: the output folder, for messages.
        process: gets a path and its unique name, and returns the row of the result.

    Returns:
        The rows, and the exit code with which the command ends.

    Raises:
        SaccadeError: no image could be processed, or the results cannot be written.
    """
    if len(paths) == 1:
        return [process(paths[0], paths[0].stem)], 0
    rows: list[dict[str, Any]] = []
    failed = 0
    with stop_on_interrupt("stopping after this image") as stopped:
        for path, name in tracked(names_for(paths).items(), f"{len(paths)} images", len(paths)):
            try:
                rows.append(process(path, name))
            except OutputError:
                raise
            except SaccadeError as error:
                failed += 1
                print_message(str(error))
            if stopped():
                break
    if failed and not rows:
        raise SaccadeError(f"none of {failed} images could be used")
    if failed:
        print_message(f"{failed} of {len(paths)} images left out; the others are in {out}")
    if stopped():
        print_message(f"stopped after {len(rows) + failed} of {len(paths)} images")
    return rows, INTERRUPTED if stopped() else int(failed > 0)
