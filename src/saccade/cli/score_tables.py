"""Rows of mean scores with their intervals, which several evaluations print."""

from collections.abc import Callable, Sequence

from saccade.evaluation.intervals import Estimate, Scores
from saccade.viewing.report import Table


def interval_rows(
    name: str, estimate: Estimate[Scores], cells: Callable[[Scores], Sequence[str]]
) -> list[list[str]]:
    """A row of means, and below it the ends of their intervals."""
    names = name, "  95 % from", "  95 % to"
    return [[label, *cells(scores)] for label, scores in zip(names, estimate, strict=True)]


def side_by_side(table: Table, *parts: Sequence[str]) -> list[Table]:
    """A table as several of some of its columns each, which fit into 80 characters."""
    indices = [[table.columns.index(name) for name in part] for part in parts]
    return [
        table._replace(
            title="" if number else table.title,
            columns=part,
            rows=[[row[i] for i in chosen] for row in table.rows],
        )
        for number, (part, chosen) in enumerate(zip(parts, indices, strict=True))
    ]
