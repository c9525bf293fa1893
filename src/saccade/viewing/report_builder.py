"""Builds a report from its parts, within the size that a page may have."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from saccade.files import atomic_write
from saccade.viewing.page import Picture, Section
from saccade.viewing.report import Part, report_page
from saccade.viewing.report_table import table_part

MAX_LENGTH = 4_700_000
"""Characters of all parts together; the page stays under 5 MB."""

SORT_HINT = "Click a heading to sort by it, and once more to reverse the order."
"""Appended to the text of a table."""


class ReportBuilder:
    """Collects the parts of a report while there is room; the first is always kept.

    Args:
        title: title of the page.
        lead: first paragraph of the page.
    """

    def __init__(self, title: str, lead: str) -> None:
        self.title = title
        self.lead = lead
        self._parts: list[Part] = []
        self._length = 0
        self._omitted = 0

    def add(self, make: Callable[[], Part]) -> None:
        """Add a part if there is room; after the first without room none is made."""
        if self._omitted:
            self._omitted += 1
            return
        part = make()
        length = len(part.html)
        if self._parts and self._length + length > MAX_LENGTH:
            self._omitted += 1
            return
        self._parts.append(part)
        self._length += length

    def __len__(self) -> int:
        return len(self._parts)

    def write(self, path: Path) -> Path:
        """Write the page; returns its path."""
        lead = self.lead
        if self._omitted:
            lead += f" {self._omitted} more did not fit on this page."
        with atomic_write(path) as temporary:
            page = report_page(self.title, lead, self._parts)
            temporary.write_text(page, encoding="utf-8", errors="backslashreplace")
        return path


class Table(NamedTuple):
    """A sortable table of a report."""

    title: str
    columns: Sequence[str]
    """Headings; that of the first column may be empty."""
    rows: Sequence[Sequence[str]]
    """One cell for each column; the first names the row."""
    text: str = ""
    """Explains the columns."""
    first: str = "name"
    """Heading of the first column where that is empty."""
    figures: Sequence[Picture] = ()

    def part(self) -> Part:
        """The table as a part of a report."""
        section = Section(self.title, f"{self.text} {SORT_HINT}".strip(), self.figures)
        return table_part(section, self.columns, self.rows, self.first)


def write_tables(path: Path | None, command: str, lead: str, tables: Sequence[Table]) -> None:
    """Write tables as a report; None writes nothing.

    Args:
        path: the page.
        command: title of the page: the command that computed them.
        lead: first paragraph of the page.
        tables: those without rows are omitted.
    """
    if path is None:
        return
    builder = ReportBuilder(command, lead)
    for table in tables:
        if table.rows:
            builder.add(table.part)
    builder.write(path)
