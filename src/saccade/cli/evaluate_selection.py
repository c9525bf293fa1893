"""`saccade evaluate selection`: which choice of landmarks makes the best map."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from saccade.cli.options import Json, Report
from saccade.cli.selection_runs import CHOICES, SCORES, Series

if TYPE_CHECKING:
    from saccade.types import FloatArray

SHOWN = {
    "found_again": ("again [%]", 100.0, 1),
    "association_precision": ("right [%]", 100.0, 1),
    "ate_m": ("ATE [m]", 1.0, 3),
    "inside_3sigma": ("3 sigma [%]", 100.0, 1),
    "landmarks": ("map", 1.0, 0),
}
"""Heading, factor and decimals of the columns of the tables."""
TITLES = {
    "found_again": "found again [%]",
    "association_precision": "associations right [%]",
    "ate_m": "ATE [m]",
    "inside_3sigma": "inside 3 sigma [%]",
    "landmarks": "landmarks in the map",
}
"""The same in the figure."""
HEADINGS = [heading for heading, _, _ in SHOWN.values()]
REFERENCE = "random"
"""The choice with which the others are compared."""
OVERALL = f"All drives and budgets, against {REFERENCE}"
EVERY = "Every drive and budget"
MEANING = (
    "Mean place: of each choice among all, by ATE and by what was found again; 1 is the best. "
    f"Times: as a multiple of what the {REFERENCE} choice had, with its 95 % interval; of the ATE "
    "less is better, of found again more."
)
MEANING_OF_EACH = (
    "Again: share of the times that a landmark should have been in view after it was out of sight, "
    "and was recognized. Right: share of the recognized that were what they were taken for. ATE: "
    "distance of the drive from the true one. 3 sigma: share of the frames at which the true place "
    "is in the ellipse of three sigma, 98.9 % if it is honest. Map: landmarks at the end."
)
LEAD = "Which landmarks to keep: the maps that each choice makes, at equal budgets."


class Axes(NamedTuple):
    """What the runs differ by."""

    drive: list[str]
    budget: list[int]
    choice: list[str]
    seed: list[int]


def selection(
    drives: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[SEQUENCE]...", help="Recorded drives with truth, driven out and back."
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for what is made; runs in it are kept.")
    ] = Path("saccade-selection"),
    simulator: Annotated[bool, typer.Option(help="Also drive round a simulated ring.")] = True,
    budgets: Annotated[
        list[int] | None,
        typer.Option("--budget", min=1, help="New landmarks per frame; may be repeated."),
    ] = None,
    choices: Annotated[
        list[str] | None, typer.Option("--choice", help=f"{', '.join(CHOICES)}; may be repeated.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each, with other noise.")] = 5,
    first_seed: Annotated[int, typer.Option(min=0, help="Of them.")] = 0,
    frames: Annotated[int, typer.Option(min=8, help="Of each drive, at most.")] = 300,
    jobs: Annotated[int, typer.Option(min=1, help="Processes that drive at a time.")] = 1,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Choose landmarks in several ways, at equal budgets, and see which maps are best.

    Again: share of the times that a landmark should have been in view after it was out of sight,
    and was recognized. Right: share of the recognized that were what they were taken for. 3 sigma:
    share of the frames at which the true place is in the ellipse of three sigma. Map: landmarks at
    the end. Means over the seeds, with half of their 95 % bootstrap intervals. At the end all
    choices are compared with a random one: the mean of their places by ATE and by what was found
    again, and both as multiples of what it had.

    In --out appears a figure, selection.png. Each run is kept there: an evaluation that was
    interrupted goes on, and more seeds add to it.
    """
    from saccade.cli.output import print_json, print_message, print_table
    from saccade.cli.selection_runs import run_all
    from saccade.errors import require
    from saccade.files import make_folder

    wanted = list(dict.fromkeys(choices or CHOICES))
    for each in wanted:
        require(each in CHOICES, "choice", f"one of {', '.join(CHOICES)}", each)
    sources = [*([None] if simulator else []), *(drives or [])]
    require(len(sources) > 0, "sequence", "one at least where the simulator is left out", "none")
    limits, numbers = list(dict.fromkeys(budgets or [1, 2, 4, 8])), range(seeds)
    series = [
        Series(source, first_seed + number, frames, tuple(limits), tuple(wanted))
        for number in numbers
        for source in sources
    ]
    worlds = list(dict.fromkeys(each.world for each in series))
    axes = Axes(worlds, limits, wanted, [first_seed + number for number in numbers])
    make_folder(out)
    tables = _tables(run_all(series, out, jobs), axes)
    picture = _drawn(out / "selection.png", tables, axes)
    overall, rows = _overall(tables, wanted), list(_rows(tables, axes))
    _write_page(report, picture, overall, rows)
    if as_json:
        print_json({"frames": frames, "seeds": axes.seed, "rows": rows, "overall": overall})
    else:
        _print_tables(rows, axes)
        print_table(OVERALL, *_overall_table(overall))
    print_message(f"wrote {picture}")


def _tables(rows: list[dict[str, Any]], axes: Axes) -> "dict[str, FloatArray]":
    """Each score of all runs, (drives, budgets, choices, seeds), NaN where there is none."""
    import numpy as np

    tables = {name: np.full([len(each) for each in axes], np.nan) for name in SCORES}
    for row in rows:
        at = tuple(each.index(row[name]) for name, each in axes._asdict().items())
        for name in SCORES:
            if row[name] is not None:
                tables[name][at] = row[name]
    return tables


def _rows(tables: "dict[str, FloatArray]", axes: Axes) -> Iterator[dict[str, Any]]:
    """Mean, low and high of each score of one choice at one budget; None where there is none."""
    from itertools import product

    import numpy as np

    from saccade.evaluation.selection import means

    found = {name: means(table) for name, table in tables.items()}
    ranges = [range(len(each)) for each in axes[:3]]
    for w, b, c in product(*ranges):
        row: dict[str, Any] = {
            "drive": axes.drive[w],
            "budget": axes.budget[b],
            "choice": axes.choice[c],
        }
        for name, mean in found.items():
            there = bool(np.isfinite(mean[w, b, c, 0]))
            row[name] = mean[w, b, c].tolist() if there else None
        yield row


def _overall(tables: "dict[str, FloatArray]", choices: Sequence[str]) -> list[dict[str, Any]]:
    """The choices over all drives and budgets, the best first."""
    import numpy as np

    from saccade.cli.slam_files import finite
    from saccade.evaluation.selection import mean_ranks, ratios

    ranks = [mean_ranks(tables["ate_m"], False), mean_ranks(tables["found_again"], True)]
    rank = np.mean(ranks, axis=0)
    rows = [{"choice": choice, "place": float(rank[i])} for i, choice in enumerate(choices)]
    if REFERENCE in choices:
        for name in ("ate_m", "found_again"):
            ratio = ratios(tables[name], choices.index(REFERENCE))
            for row, values in zip(rows, ratio.tolist(), strict=True):
                row[f"{name}_ratio"] = [finite(value) for value in values]
    return sorted(rows, key=lambda row: row["place"])


def _print_tables(rows: Sequence[dict[str, Any]], axes: Axes) -> None:
    from saccade.cli.output import print_table

    for drive in axes.drive:
        for budget in axes.budget:
            here = [row for row in rows if (row["drive"], row["budget"]) == (drive, budget)]
            shown = [[row["choice"], *_scores(row)] for row in here]
            print_table(f"{drive}, {budget} new per frame", ["", *HEADINGS], shown)


def _scores(row: dict[str, Any]) -> list[str]:
    return [_shown(row[name], *SHOWN[name][1:]) for name in SHOWN]


def _overall_table(overall: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of the choices over all drives and budgets."""
    columns = ["", "mean place"]
    shown = [[row["choice"], f"{row['place']:.2f}"] for row in overall]
    if "ate_m_ratio" in overall[0]:
        columns += ["ATE, times", "found again, times"]
        for line, row in zip(shown, overall, strict=True):
            for name in ("ate_m_ratio", "found_again_ratio"):
                mean, low, high = row[name]
                line.append("-" if mean is None else f"{mean:.2f} [{low:.2f} {high:.2f}]")
    return columns, shown


def _write_page(
    path: Path | None,
    picture: Path,
    overall: list[dict[str, Any]],
    rows: Sequence[dict[str, Any]],
) -> None:
    """All of it as a page, the figure among it; None writes nothing."""
    from saccade.cli.report_builder import SORT_HINT, ReportBuilder
    from saccade.viewing.embedding import png_file
    from saccade.viewing.page import Picture, Section
    from saccade.viewing.report_table import table_part

    if path is None:
        return
    figure = Picture(
        png_file(picture),
        "Each score of each choice over the budgets, with intervals; the tables say the same",
        "Means over the seeds, with 95 % bootstrap intervals.",
        wide=True,
    )
    every = [[row["choice"], row["drive"], str(row["budget"]), *_scores(row)] for row in rows]
    columns = ["", "drive", "new per frame", *HEADINGS]
    builder = ReportBuilder("saccade evaluate selection", LEAD)
    builder.add(
        lambda: table_part(
            Section(OVERALL, f"{MEANING} {SORT_HINT}", [figure]), *_overall_table(overall), "choice"
        )
    )
    builder.add(
        lambda: table_part(
            Section(EVERY, f"{MEANING_OF_EACH} {SORT_HINT}"), columns, every, "choice"
        )
    )
    builder.write(path)


def _shown(score: list[float] | None, factor: float, decimals: int) -> str:
    """Mean and half of its interval."""
    if score is None:
        return "-"
    mean, low, high = (factor * value for value in score)
    return f"{mean:.{decimals}f} ±{(high - low) / 2:.{decimals}f}"


def _drawn(path: Path, tables: "dict[str, FloatArray]", axes: Axes) -> Path:
    import numpy as np

    from saccade.evaluation.selection import means
    from saccade.viewing import save_figure
    from saccade.viewing.selection import Panel, selection_figure

    panels = [
        Panel(TITLES[name], factor * means(tables[name]), 100.0 if factor == 100 else np.inf)
        for name, (_, factor, _) in SHOWN.items()
    ]
    order = [axes.choice.index(row["choice"]) for row in _overall(tables, axes.choice)]
    usual = axes.choice.index(REFERENCE) if REFERENCE in axes.choice else None
    figure = selection_figure(panels, axes.drive, axes.budget, axes.choice, order, usual)
    return save_figure(figure, path)
