"""The parts of a report, gathered by what makes them."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from saccade.viewing.report import Part

MAX_LENGTH = 4_700_000
"""Letters of all parts together; the page stays under 5 MB."""

SORT_HINT = "Click a heading to sort by it, and once more for the other way round."
"""What is said of a table."""


class ReportBuilder:
    """Parts of one report, as many as there is room for; the first is always kept.

    Args:
        title: of the page.
        lead: its first paragraph.
    """

    def __init__(self, title: str, lead: str) -> None:
        self.title = title
        self.lead = lead
        self._parts: list[Part] = []
        self._letters = 0
        self._left_out = 0

    def add(self, make: "Callable[[], Part]") -> None:
        """Make a part and keep it if there is room; after the first without room none is made."""
        if self._left_out:
            self._left_out += 1
            return
        part = make()
        letters = len(part.html)
        if self._parts and self._letters + letters > MAX_LENGTH:
            self._left_out += 1
            return
        self._parts.append(part)
        self._letters += letters

    def __len__(self) -> int:
        return len(self._parts)

    def write(self, path: Path) -> Path:
        """Write the page; returns where it is."""
        from saccade.cli.output import write_text
        from saccade.viewing.report import report_page

        lead = self.lead
        if self._left_out:
            lead += f" {self._left_out} more did not fit on this page."
        write_text(path, report_page(self.title, lead, self._parts))
        return path


class Table(NamedTuple):
    """A table of a report."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    """One cell for each column; the first names the row."""
    text: str = ""
    """What its columns mean."""
    first: str = "name"
    """The heading of the first column where it has none."""


def write_table_page(path: Path | None, command: str, lead: str, tables: Sequence[Table]) -> None:
    """Write tables as a report; None writes nothing.

    Args:
        path: the page.
        command: what made it, the title of the page.
        lead: its first paragraph.
        tables: one without rows is left out.
    """
    from saccade.viewing.page import Section
    from saccade.viewing.report_table import table_part

    if path is None:
        return
    builder = ReportBuilder(command, lead)
    for title, columns, rows, text, first in (table for table in tables if table.rows):
        section = Section(title, f"{text} {SORT_HINT}".strip())
        builder.add(partial(table_part, section, columns, rows, first))
    builder.write(path)
