"""A table that can be sorted, as a part of a report."""

from collections.abc import Sequence

from saccade.viewing.page import Section
from saccade.viewing.report import Part, with_notes

MAX_LETTERS = 3_000_000
"""Of all cells."""


def table_part(
    section: Section, columns: Sequence[str], rows: Sequence[Sequence[str]], first: str = "name"
) -> Part:
    """A table of words and numbers.

    Args:
        section: heading, text, facts and links.
        columns: their headings.
        rows: one cell for each column; the first names the row.
        first: the heading of the first column where it has none.
    """
    rows = [list(row) for row in rows]
    letters = sum(len(cell) + 3 for row in rows for cell in row)
    stride = -(-letters // MAX_LETTERS) or 1
    section, rows = with_notes(section, {"rows": (len(rows), stride)}), rows[::stride]
    data = {"title": section.heading, "columns": list(columns), "rows": rows, "first": first}
    return Part(section, "table", data)
