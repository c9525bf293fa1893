"""`saccade evaluate gaze`: gaze policies compared."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from typer import Option

from saccade.cli.evaluate_selection import Score, score_cells
from saccade.cli.options import EgomotionName, FigureFormats, Json, Report, figure_formats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from saccade.evaluation.gaze import GazeScores
    from saccade.simulation.drive_config import WorldName
    from saccade.visual.config import EgomotionSource

MAIN = "ate_m", "end_m", "closed", "frames_to_close"
"""Scores of the first of two tables, which fit into 80 columns."""
LEAD = "Gaze policies compared, at equal numbers of frames."
COMPARED = "All worlds, relative to {}"
MEANING_OF_COMPARISON = (
    "ATE ratio: geometric mean over worlds and seeds, with its 95 % interval over the seeds; lower "
    "is better. Closed: drives in which the loop was closed. Inside: frames whose true position "
    "lies in the 99.7 % ellipse."
)
MEANING = (
    "ATE: absolute trajectory error. Return: position error at the end, where the robot is back "
    "at its start. Closed: drives in which at least three landmarks were re-identified in a frame "
    "5 m of travel after they were last observed; frames: until then. Entropy: of the pose, mean "
    "over the drive, in nats. Again: landmarks re-identified. Right: correct ones of the "
    "re-identifications. Inside: frames whose true position lies in the 99.7 % ellipse."
)
SCORES = {
    "ate_m": Score("ATE [m]", 1, 3),
    "end_m": Score("return [m]", 1, 3),
    "closed": Score("closed [%]", 100, 0, 100),
    "frames_to_close": Score("frames"),
    "entropy": Score("entropy", 1, 1),
    "redetected": Score("again"),
    "association_precision": Score("right [%]", 100, 1, 100),
    "inside_3sigma": Score("inside [%]", 100, 1, 100),
}


def gaze(
    out: Annotated[
        Path, Option("--out", "-o", help="Output folder, in which the runs are stored.")
    ] = Path("saccade-gaze"),
    worlds: Annotated[
        list[str] | None,
        Option(
            "--world",
            help="ring, crossing or rooms. Several with commas.",
            show_default="all of them",
        ),
    ] = None,
    policies: Annotated[
        list[str] | None,
        Option(
            "--policy",
            help="fixed, random, sweep, salient or informative. Several with commas.",
            show_default="all of them",
        ),
    ] = None,
    egomotion: EgomotionName = "camera",
    seeds: Annotated[
        int, Option(min=1, help="Number of drives of each, with consecutive seeds.")
    ] = 10,
    first_seed: Annotated[int, Option(min=0, help="Seed of the first drive.")] = 0,
    frames: Annotated[int, Option(min=8, metavar="N", help="Frames of each drive, at most.")] = 200,
    jobs: Annotated[int, Option(min=1, help="Number of processes.")] = 1,
    figures: FigureFormats = None,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Compare gaze policies: where a camera that turns shall look.

    Each table has the means over the seeds, with half of their 95 % bootstrap intervals. The last
    ones compare each policy with a camera that does not turn and with a steady sweep.

    --out receives a figure (gaze.png) and every run: an interrupted evaluation resumes, and more
    seeds add to it.
    """
    from saccade.cli.output import print_json, print_message, print_table, progress_bar
    from saccade.errors import require
    from saccade.evaluation.gaze import GazeScores
    from saccade.evaluation.gaze_drives import LAPS
    from saccade.evaluation.gaze_runs import GazeRun, run_all
    from saccade.files import results_in
    from saccade.viewing import save_figures
    from saccade.visual.config import EGOMOTIONS
    from saccade.visual.gaze_policies import POLICIES

    chosen = list(dict.fromkeys(policies or POLICIES))
    for each in chosen:
        require(each in POLICIES, "policy", f"one of {', '.join(POLICIES)}", each)
    places = list(dict.fromkeys(worlds or LAPS))
    for each in places:
        require(each in LAPS, "world", f"one of {', '.join(LAPS)}", each)
    require(egomotion in EGOMOTIONS, "egomotion", f"one of {', '.join(EGOMOTIONS)}", egomotion)
    runs = [
        GazeRun(cast("WorldName", world), policy, seed, frames, cast("EgomotionSource", egomotion))
        for seed in range(first_seed, first_seed + seeds)
        for world in places
        for policy in chosen
    ]
    with results_in(out), progress_bar("driving", len(runs)) as progress:
        scores = GazeScores.of(run_all(runs, out, jobs, progress))
        figure = _figure(scores)
        picture = save_figures(figure, out / "gaze", figure_formats(figures))
    rows = list(scores.rows())
    references = [name for name in ("fixed", "sweep") if name in scores.policy]
    comparisons = {name: scores.comparison(name) for name in references}
    _write_report(report, figure, rows, comparisons)
    if as_json:
        print_json(
            {
                "egomotion": egomotion,
                "frames": frames,
                "seeds": scores.seed,
                "rows": rows,
                "comparisons": comparisons,
            }
        )
    else:
        shown = _shown(rows)
        for world in scores.world:
            for names in (MAIN, [name for name in shown if name not in MAIN]):
                part = {name: shown[name] for name in names if name in shown}
                title = f"{world}, at most {frames} frames, {seeds} seeds"
                headings = ["", *(score.heading for score in part.values())]
                of_world = [row for row in rows if row["world"] == world]
                cells = [[row["policy"], *score_cells(row, part)] for row in of_world]
                print_table(title, headings, cells)
        for name, comparison in comparisons.items():
            print_table(COMPARED.format(name), *_comparison_table(comparison))
    print_message(f"wrote {picture}")


def _shown(rows: list[dict[str, Any]]) -> dict[str, Score]:
    """The scores that any run has."""
    return {
        name: score for name, score in SCORES.items() if any(row[name] is not None for row in rows)
    }


def _comparison_table(comparison: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of a comparison."""
    cells = []
    for row in comparison:
        mean, low, high = row["ate_m_ratio"]
        ratio = "-" if mean is None else f"{mean:.2f} [{low:.2f} {high:.2f}]"
        inside = "-" if row["inside_3sigma"] is None else f"{100 * row['inside_3sigma']:.1f}"
        cells.append([row["policy"], ratio, f"{row['closed']} of {row['drives']}", inside])
    return ["", "ATE ratio", "closed", "inside [%]"], cells


def _figure(scores: "GazeScores") -> "Figure":
    from saccade.evaluation.gaze import means
    from saccade.viewing.gaze import gaze_figure
    from saccade.viewing.selection import Panel

    panels = [
        Panel(score.heading, score.factor * means(scores.tables[name]), score.limit)
        for name, score in _shown(list(scores.rows())).items()
    ]
    return gaze_figure(panels, scores.world, scores.policy, scores.entropy)


def _write_report(
    path: Path | None,
    figure: "Figure",
    rows: list[dict[str, Any]],
    comparisons: dict[str, list[dict[str, Any]]],
) -> None:
    from saccade.viewing.embedding import figure_uri
    from saccade.viewing.page import Picture
    from saccade.viewing.report import Table, write_tables

    if path is None:
        return
    picture = Picture(
        figure_uri(figure),
        "Each score of each policy in each world, with intervals; the tables have the same",
        "Means over the seeds, with 95 % bootstrap intervals.",
        wide=True,
    )
    tables = [
        Table(
            COMPARED.format(name),
            *_comparison_table(comparison),
            MEANING_OF_COMPARISON,
            "policy",
            [picture] if i == 0 else [],
        )
        for i, (name, comparison) in enumerate(comparisons.items())
    ]
    shown = _shown(rows)
    cells = [[row["policy"], row["world"], *score_cells(row, shown)] for row in rows]
    columns = ["", "world", *(score.heading for score in shown.values())]
    tables.append(
        Table("Each world", columns, cells, MEANING, "policy", [] if tables else [picture])
    )
    write_tables(path, "saccade evaluate gaze", LEAD, tables)
