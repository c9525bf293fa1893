"""Output of commands: messages, progress, tables, JSON and files."""

import json
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from threading import Event
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

from saccade.errors import ImageWarning, LogWarning, printable
from saccade.io.files import atomic_write

if TYPE_CHECKING:
    from saccade.evaluation.intervals import Estimate, Scores

T = TypeVar("T")
LINE_SECONDS = 10.0
"""Seconds between progress lines if stderr is not a terminal."""
INTERRUPTED = 130
"""Exit code."""


class Progress(Protocol):
    """Callback that reports the progress of a run."""

    def __call__(self, done: int, total: int | None = None, stage: str = "") -> None:
        """Report the steps done, the total, and the stage of the run."""


def print_message(message: str) -> None:
    """Print a message for the user on stderr."""
    print(f"saccade: {printable(message)}", file=sys.stderr)


def print_data_warnings() -> None:
    """Print warnings about images and logs as messages; library warnings are unchanged."""
    show = warnings.showwarning

    def print_warning(
        message: Warning | str, category: type[Warning], *place: Any, **kwargs: Any
    ) -> None:
        if issubclass(category, (ImageWarning, LogWarning)):
            print_message(str(message))
        else:
            show(message, category, *place, **kwargs)

    warnings.showwarning = print_warning


@contextmanager
def stop_on_interrupt(
    message: str = "stopping after the shards in progress",
) -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether Ctrl-C was pressed; a second Ctrl-C raises."""
    pressed = Event()

    def stop(*_: Any) -> None:
        pressed.set()
        signal.signal(signal.SIGINT, previous)
        print_message(f"{message}; press Ctrl-C again to stop at once")

    previous = signal.signal(signal.SIGINT, stop)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, previous)


@contextmanager
def progress_bar(description: str, total: int | None = None) -> Iterator[Progress]:
    """A progress bar on stderr; yields the callback that advances it.

    If stderr is not a terminal, a line is printed every `LINE_SECONDS`.
    """
    from rich import progress
    from rich.console import Console
    from rich.markup import escape

    console = Console(stderr=True)
    hidden, known = not console.is_terminal, total
    bar = progress.Progress(console=console, transient=True)
    with nullcontext() if hidden else bar:  # Rich before 14.3 ends a hidden bar with an empty line
        task, printed = bar.add_task(escape(description), total=total), time.monotonic()

        def update(done: int, total: int | None = None, stage: str = "") -> None:
            nonlocal printed
            label = f"{description}: {stage}" if stage else description
            if hidden and time.monotonic() - printed >= LINE_SECONDS:
                printed = time.monotonic()
                print_message(f"{label}: {done}" + f" of {total or known}" * bool(total or known))
            bar.update(task, description=escape(label), completed=done, total=total)

        yield update


def tracked(items: Iterable[T], description: str, total: int) -> Iterator[T]:
    """Iterate with a progress bar."""
    with progress_bar(description, total) as update:
        for number, item in enumerate(items):
            yield item
            update(number + 1)


class Table(NamedTuple):
    """A table on the terminal."""

    title: str
    columns: Sequence[str]
    """Column titles; the header is omitted if all are empty."""
    rows: Sequence[Sequence[str]]


MAX_CELL = 60
"""Maximum length of a number with its unit or remark; longer cells are left-aligned text."""


def print_table(table: Table) -> None:
    """Print a table on stdout."""
    from rich import box
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    title, columns, rows = table
    shown = RichTable(
        title=Text(printable(title)),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        show_header=any(columns),
    )
    for heading, *cells in zip(columns, *rows, strict=True):
        is_text = not shown.columns or max(map(len, cells), default=0) > MAX_CELL
        shown.add_column(Text(heading), justify="left" if is_text else "right", overflow="fold")
    for row in rows:
        shown.add_row(*(Text(printable(cell)) for cell in row))  # brackets are not markup
    Console().print(shown)


@dataclass(frozen=True)
class Result:
    """The output and the exit code of a command."""

    row: Mapping[str, Any]
    """Figures for --json."""
    tables: Sequence[Table] = ()
    code: int = 0
    """Exit code."""


LABELS = {
    "odometry_end_from_estimate_m": "odometry at the end, from the filter's estimate",
    "nis_mean": "mean normalized innovation squared",
    "nis_band": "mean for a consistent filter",
    "nonlinearity": "fraction of second-order terms (RMS)",
    "ate_m": "ATE",
    "ate_unaligned_m": "ATE, unaligned",
    "rpe_m": "RPE",
    "inside_3sigma": "fraction in the 99.7 % ellipse",
    "missed": "expected, not re-identified",
}
"""Labels for figures whose names are unclear when spelled out."""


def facts(row: Mapping[str, Any]) -> dict[str, str]:
    """Formatted numbers and texts of a row for --json, by label or spelled-out name.

    The suffix of a name is its unit: "odometry_rmse_m" is in meters. None, empty texts, Booleans
    and nested values are omitted.
    """
    shown = {}
    for name, value in row.items():
        unit = " m" if name.endswith("_m") else ""
        words = LABELS.get(name, name.removesuffix("_m").replace("_", " ").replace("rmse", "RMSE"))
        if isinstance(value, float):
            shown[words] = f"{value:.3f}{unit}"
        elif isinstance(value, str | Path) and str(value):
            shown[words] = str(value)
        elif isinstance(value, int) and not isinstance(value, bool):
            shown[words] = f"{value:,}"
    return shown


def facts_table(title: str, row: Mapping[str, Any]) -> Table:
    """The facts of a row as a table."""
    return Table(title, ["", ""], [*facts(row).items()])


def comparison(
    title: str,
    means: "Mapping[str, Estimate[Scores]]",
    difference: str,
    gains: "Mapping[str, Estimate[Scores]]",
    columns: Iterable[str],
    cells: "Callable[[Scores], Sequence[str]]",
) -> list[Table]:
    """Tables of means and of paired differences, titled `difference`, with confidence intervals."""
    tables = {title: means} | ({difference: gains} if gains else {})
    return [
        Table(
            heading,
            ["", *columns],
            [
                [label, *cells(scores)]
                for name, each in estimates.items()
                for label, scores in zip((name, "  95 % from", "  95 % to"), each, strict=True)
            ],
        )
        for heading, estimates in tables.items()
    ]


def emit(result: Result, *, as_json: bool) -> None:
    """Print a result on stdout, as JSON or as tables."""
    if as_json:
        print(json.dumps(result.row, indent=2, allow_nan=False))
        return
    for table in result.tables:
        print_table(table)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically; undecodable bytes of file names are escaped."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write named arrays as .npz atomically."""
    from saccade.io.npz import save_arrays

    with atomic_write(path) as temporary:
        save_arrays(temporary, arrays)


def names_for(paths: Sequence[Path]) -> dict[Path, str]:
    """Unique result names for the inputs.

    The stem; if stems repeat, the path relative to the common folder without suffix, or with it if
    that repeats too. The maps of images in several folders are thus found by their images' paths.
    """
    unique = list(dict.fromkeys(paths))
    relative = relative_names(unique)
    for name_of in (
        lambda path: path.stem,
        lambda path: PurePosixPath(relative[path]).with_suffix("").as_posix(),
    ):
        names = {path: name_of(path) for path in unique}
        if len({*names.values()}) == len(unique):
            return names
    return relative


def relative_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Paths relative to their common folder, as COLMAP and hloc name images."""
    if not paths:
        return {}
    absolute = [path.absolute() for path in paths]
    root = os.path.commonpath([path.parent for path in absolute])
    return {
        path: each.relative_to(root).as_posix() for path, each in zip(paths, absolute, strict=True)
    }
