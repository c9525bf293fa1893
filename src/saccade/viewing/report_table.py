"""Part of a report: a sortable table."""

from collections.abc import Sequence

from saccade.viewing.page import Section
from saccade.viewing.report import Part, with_notes

MAX_CHARACTERS = 3_000_000
"""Of all cells."""


def table_part(
    section: Section, columns: Sequence[str], rows: Sequence[Sequence[str]], first: str = "name"
) -> Part:
    """A table of text and numbers.

    Args:
        section: heading, text, facts and links.
        columns: their headings.
        rows: one cell for each column; the first names the row.
        first: the heading of the first column where it has none.
    """
    characters = sum(len(cell) + 3 for row in rows for cell in row)
    stride = -(-characters // MAX_CHARACTERS) or 1
    section = with_notes(section, {"rows": (len(rows), stride)})
    cells = [list(row) for row in rows[::stride]]
    data = {"title": section.heading, "columns": list(columns), "rows": cells, "first": first}
    return Part(section, "table", data)
