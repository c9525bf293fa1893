"""`saccade evaluate gaze`: gaze policies compared over simulated worlds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from saccade.cli.evaluate_selection import Score
from saccade.cli.options import FigureFormats, Json, Report, figure_formats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from saccade.evaluation.gaze import GazeScores

LEAD = "Gaze policies compared, at equal numbers of frames and of pixels."
COMPARED = "All worlds, relative to {}"
MEANING_OF_COMPARISON = (
    "ATE ratio: geometric mean over worlds and seeds, with its 95 % interval over the seeds; lower "
    "is better. Closed: drives in which the loop was closed. Consistent: frames whose true "
    "position lies in the 99.7 % ellipse."
)
MEANING = (
    "ATE: absolute trajectory error. Return: position error at the end, where the robot is back "
    "at its start. Closed: drives in which at least three landmarks were re-identified in a frame "
    "5 m of travel after they were last observed; frames: until then. Entropy: of the pose, mean "
    "over the drive, in nats. Again: landmarks re-identified. Precision: correct ones of the "
    "re-identifications. Consistent: frames whose true position lies in the 99.7 % ellipse."
)
SCORES = {
    "ate_m": Score("ATE [m]", 1, 3),
    "end_m": Score("return [m]", 1, 3),
    "closed": Score("closed [%]", 100, 0, 100),
    "frames_to_close": Score("frames"),
    "entropy": Score("entropy", 1, 1),
    "redetected": Score("again"),
    "association_precision": Score("precision [%]", 100, 1, 100),
    "inside_3sigma": Score("consistent [%]", 100, 1, 100),
}
HEADINGS = [score.heading for score in SCORES.values()]


def gaze(
    out: Annotated[
        Path, Option("--out", "-o", help="Output folder, in which the runs are stored.")
    ] = Path("saccade-gaze"),
    worlds: Annotated[
        list[str] | None,
        Option(
            "--world", help="ring, crossing or rooms; may be repeated.", show_default="all of them"
        ),
    ] = None,
    policies: Annotated[
        list[str] | None,
        Option(
            "--policy",
            help="fixed, random, sweep, salient, informative or behaviors; may be repeated.",
            show_default="all of them",
        ),
    ] = None,
    seeds: Annotated[
        int, Option(min=1, help="Number of drives of each, with consecutive seeds.")
    ] = 10,
    first_seed: Annotated[int, Option(min=0, help="Seed of the first drive.")] = 0,
    frames: Annotated[int, Option(min=8, metavar="N", help="Frames of each drive.")] = 200,
    jobs: Annotated[int, Option(min=1, help="Number of processes.")] = 1,
    figures: FigureFormats = None,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Compare gaze policies in simulated worlds, with a camera that turns.

    Each table has the means over the seeds, with half of their 95 % bootstrap intervals. The last
    ones compare each policy with a camera that does not turn and with a steady sweep.

    --out receives a figure (gaze.png) and every run: an interrupted evaluation resumes, and more
    seeds add to it.
    """
    from saccade.cli.output import print_json, print_message, print_table, progress_bar
    from saccade.errors import require
    from saccade.evaluation.gaze import GazeScores
    from saccade.evaluation.gaze_runs import WORLDS, GazeRun, run_all
    from saccade.files import make_folder
    from saccade.viewing import save_figures
    from saccade.visual.gaze_policies import POLICIES

    chosen = list(dict.fromkeys(policies or POLICIES))
    for each in chosen:
        require(each in POLICIES, "policy", f"one of {', '.join(POLICIES)}", each)
    places = list(dict.fromkeys(worlds or WORLDS))
    for each in places:
        require(each in WORLDS, "world", f"one of {', '.join(WORLDS)}", each)
    runs = [
        GazeRun(world, policy, seed, frames)
        for seed in range(first_seed, first_seed + seeds)
        for world in places
        for policy in chosen
    ]
    make_folder(out)
    with progress_bar("driving", len(runs)) as progress:
        scores = GazeScores.of(run_all(runs, out, jobs, progress))
    rows = list(scores.rows())
    references = [name for name in ("fixed", "sweep") if name in scores.policy]
    comparisons = {name: scores.comparison(name) for name in references}
    figure = _figure(scores)
    picture = save_figures(figure, out / "gaze", figure_formats(figures))
    _write_report(report, figure, rows, comparisons)
    if as_json:
        print_json(
            {"frames": frames, "seeds": scores.seed, "rows": rows, "comparisons": comparisons}
        )
    else:
        for world in scores.world:
            shown = [[row["policy"], *_cells(row)] for row in rows if row["world"] == world]
            print_table(f"{world}, {frames} frames, {seeds} seeds", ["", *HEADINGS], shown)
        for name, comparison in comparisons.items():
            print_table(COMPARED.format(name), *_comparison_table(comparison))
    print_message(f"wrote {picture}")


def _cells(row: dict[str, Any]) -> list[str]:
    """Mean and half of the interval of each score."""
    cells = []
    for name, score in SCORES.items():
        if row[name] is None:
            cells.append("-")
            continue
        mean, low, high = (score.factor * value for value in row[name])
        cells.append(f"{mean:.{score.decimals}f} ±{(high - low) / 2:.{score.decimals}f}")
    return cells


def _comparison_table(comparison: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of a comparison."""
    cells = []
    for row in comparison:
        mean, low, high = row["ate_m_ratio"]
        ratio = "-" if mean is None else f"{mean:.2f} [{low:.2f} {high:.2f}]"
        inside = "-" if row["inside_3sigma"] is None else f"{100 * row['inside_3sigma']:.1f}"
        cells.append([row["policy"], ratio, f"{row['closed']} of {row['drives']}", inside])
    return ["", "ATE ratio", "closed", "consistent [%]"], cells


def _figure(scores: "GazeScores") -> "Figure":
    from saccade.evaluation.gaze import means
    from saccade.viewing.gaze import gaze_figure
    from saccade.viewing.selection import Panel

    panels = [
        Panel(score.heading, score.factor * means(scores.tables[name]), score.limit)
        for name, score in SCORES.items()
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
    cells = [[row["policy"], row["world"], *_cells(row)] for row in rows]
    columns = ["", "world", *HEADINGS]
    tables.append(
        Table("Each world", columns, cells, MEANING, "policy", [] if tables else [picture])
    )
    write_tables(path, "saccade evaluate gaze", LEAD, tables)
