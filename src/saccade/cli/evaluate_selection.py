"""`saccade evaluate selection`: landmark selection criteria compared at equal budgets."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from typer import Argument, Option

from saccade.cli.options import FigureFormats, Json, Report, figure_formats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from saccade.evaluation.selection import SelectionScores

LEAD = "Landmark selection criteria compared at equal budgets."
RANKING = "All drives and budgets, relative to {}"
MEANING_OF_RANKING = (
    "Mean rank: among the criteria, by ATE and by re-identification rate; 1 is best. Ratio: to "
    "{}, with its 95 % interval; lower is better for the ATE, higher for the "
    "re-identification rate."
)
MEANING = (
    "Re-id: fraction of the reappearances of a landmark at which it was re-identified. "
    "Precision: fraction of the re-identifications that are correct. ATE: absolute trajectory "
    "error. Consistent: frames whose true position lies in the 99.7 % ellipse. Map: landmarks at "
    "the end."
)


class Score(NamedTuple):
    """How a score is shown."""

    heading: str
    factor: float = 1.0
    decimals: int = 0
    limit: float = float("inf")
    """The largest value that it can have."""


SCORES = {
    "reidentification_rate": Score("re-id [%]", 100, 1, 100),
    "association_precision": Score("precision [%]", 100, 1, 100),
    "ate_m": Score("ATE [m]", 1, 3),
    "inside_3sigma": Score("consistent [%]", 100, 1, 100),
    "landmarks": Score("map"),
}
HEADINGS = [score.heading for score in SCORES.values()]


def selection(
    drives: Annotated[
        list[Path] | None,
        Argument(
            metavar="SEQUENCE", help="Recorded drives with ground truth, driven out and back."
        ),
    ] = None,
    out: Annotated[
        Path, Option("--out", "-o", help="Output folder, in which the runs are stored.")
    ] = Path("saccade-selection"),
    simulator: Annotated[
        bool, Option(help="Also drive around a simulated ring and a simulated room.")
    ] = True,
    budgets: Annotated[
        list[int] | None,
        Option(
            "--budget",
            min=4,
            metavar="N",
            help="Landmarks tracked at a time; several with commas.",
            show_default="5, 10, 20, 50",
        ),
    ] = None,
    criteria: Annotated[
        list[str] | None,
        Option(
            "--criterion",
            help="A ranking of SIFT points: strength, random, range, contrast, symmetry, "
            "rematch-rate, rematch-rate-range or rematch-rate-spread; or of the points of another "
            "detector: must, symroid (by strength), must-rematch-rate, ...; several with commas.",
            show_default="eight of them",
        ),
    ] = None,
    reference: Annotated[
        str, Option(metavar="CRITERION", help="Criterion to which the others are compared.")
    ] = "rematch-rate",
    seeds: Annotated[
        int, Option(min=1, help="Number of runs of each, with consecutive seeds.")
    ] = 5,
    first_seed: Annotated[int, Option(min=0, help="Seed of the first run.")] = 0,
    frames: Annotated[
        int, Option(min=8, metavar="N", help="Maximum number of frames of each drive.")
    ] = 160,
    jobs: Annotated[int, Option(min=1, help="Number of processes.")] = 1,
    figures: FigureFormats = None,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Compare landmark selection criteria at equal budgets.

    Each table has the means over the seeds, with half of their 95 % bootstrap intervals. The last
    ranks the criteria over all drives and budgets, and compares them with one of them. The motion
    from frame to frame is the same for all: landmarks are tracked beside the points from which it
    is estimated.

    --out receives a figure (selection.png) and every run: an interrupted evaluation resumes, and
    more seeds add to it.
    """
    from saccade.cli.output import print_json, print_message, print_table, progress_bar
    from saccade.errors import require
    from saccade.evaluation.selection import SelectionScores
    from saccade.evaluation.selection_runs import COMPARED, CRITERIA, WORLDS, RunSeries, run_all
    from saccade.files import results_in
    from saccade.viewing import save_figures

    chosen = list(dict.fromkeys(criteria or COMPARED))
    for each in [*chosen, reference]:
        require(each in CRITERIA, "criterion", f"one of {', '.join(CRITERIA)}", each)
    sources = [*(WORLDS if simulator else ()), *(drives or [])]
    require(len(sources) > 0, "sequence", "at least one without the simulator", "none")
    limits = tuple(dict.fromkeys(budgets or (5, 10, 20, 50)))
    series = [
        RunSeries(source, seed, frames, limits, tuple(chosen))
        for seed in range(first_seed, first_seed + seeds)
        for source in sources
    ]
    with results_in(out), progress_bar("driving", len(series)) as progress:
        scores = SelectionScores.of(run_all(series, out, jobs, progress))
        rows, ranking = list(scores.rows()), scores.ranking(reference)
        figure = _figure(scores, ranking, reference)
        picture = save_figures(figure, out / "selection", figure_formats(figures))
    _write_report(report, figure, rows, ranking, reference)
    if as_json:
        print_json({"frames": frames, "seeds": scores.seed, "rows": rows, "ranking": ranking})
    else:
        for drive in scores.drive:
            for budget in scores.budget:
                shown = [
                    [row["criterion"], *score_cells(row, SCORES)]
                    for row in rows
                    if (row["drive"], row["budget"]) == (drive, budget)
                ]
                print_table(f"{drive}, {budget} landmarks", ["", *HEADINGS], shown)
        print_table(RANKING.format(reference), *_ranking_table(ranking))
    print_message(f"wrote {picture}")


def score_cells(row: dict[str, Any], scores: Mapping[str, Score]) -> list[str]:
    """Mean and half of the interval of each score."""
    cells = []
    for name, score in scores.items():
        if row[name] is None:
            cells.append("-")
            continue
        mean, low, high = (score.factor * value for value in row[name])
        cells.append(f"{mean:.{score.decimals}f} ±{(high - low) / 2:.{score.decimals}f}")
    return cells


def _ranking_table(ranking: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of the ranking."""
    columns = ["", "mean rank"]
    cells = [[row["criterion"], f"{row['mean_rank']:.2f}"] for row in ranking]
    if "ate_m_ratio" in ranking[0]:
        columns += ["ATE ratio", "re-id ratio"]
        for line, row in zip(cells, ranking, strict=True):
            for name in ("ate_m_ratio", "reidentification_rate_ratio"):
                mean, low, high = row[name]
                line.append("-" if mean is None else f"{mean:.2f} [{low:.2f} {high:.2f}]")
    return columns, cells


def _figure(scores: "SelectionScores", ranking: list[dict[str, Any]], reference: str) -> "Figure":
    from saccade.evaluation.selection import means
    from saccade.viewing.selection import Panel, selection_figure

    panels = [
        Panel(score.heading, score.factor * means(scores.tables[name]), score.limit)
        for name, score in SCORES.items()
    ]
    order = [scores.criterion.index(row["criterion"]) for row in ranking]
    marked = scores.criterion.index(reference) if reference in scores.criterion else None
    return selection_figure(panels, scores.drive, scores.budget, scores.criterion, order, marked)


def _write_report(
    path: Path | None,
    figure: "Figure",
    rows: list[dict[str, Any]],
    ranking: list[dict[str, Any]],
    reference: str,
) -> None:
    from saccade.viewing.embedding import figure_uri
    from saccade.viewing.page import Picture
    from saccade.viewing.report import Table, write_tables

    if path is None:
        return
    picture = Picture(
        figure_uri(figure),
        "Each score of each criterion over the budgets, with intervals; the tables have the same",
        "Means over the seeds, with 95 % bootstrap intervals.",
        wide=True,
    )
    cells = [
        [row["criterion"], row["drive"], str(row["budget"]), *score_cells(row, SCORES)]
        for row in rows
    ]
    columns = ["", "drive", "landmarks", *HEADINGS]
    write_tables(
        path,
        "saccade evaluate selection",
        LEAD,
        [
            Table(
                RANKING.format(reference),
                *_ranking_table(ranking),
                MEANING_OF_RANKING.format(reference),
                "criterion",
                [picture],
            ),
            Table("Each drive and budget", columns, cells, MEANING, "criterion"),
        ],
    )
