"""`saccade evaluate gaze`: gaze policies compared."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

from typer import Option

from saccade.cli.options import EgomotionName, ReportOptions
from saccade.cli.output import emit, progress_bar
from saccade.errors import require
from saccade.evaluation.gaze import LEVELS, GazeRun, compare, map_in_processes, result_of
from saccade.gaze import POLICIES
from saccade.io.files import results_in
from saccade.viewing.report import Table

LEAD = "Gaze policies compared, in the same worlds with the same noise."
MEANING = (
    "ATE: absolute trajectory error, the median. Relative to fixed and to sweep: geometric mean "
    "over worlds and seeds of its ratio to that of the policy, with the 95 % interval over the "
    "seeds; lower is better. Closed: drives that saw known landmarks again in a later lap. Inside: "
    "poses whose true position lies in the 99.7 % ellipse. A number is a constant pan in degrees, "
    "360 a view in all directions."
)
BY_WORLD = "Geometric mean over the seeds. Worst drive: greatest ratio of a single drive."


def gaze(
    shown: ReportOptions,
    out: Annotated[
        Path, Option("--out", "-o", help="Output folder, in which the runs are stored.")
    ] = Path("saccade-gaze"),
    level: Annotated[
        str, Option(help="landmarks, in uneven worlds of 62 to 114 m, or rendered images.")
    ] = "landmarks",
    known: Annotated[str, Option("--map", help="new or known.")] = "new",
    egomotion: EgomotionName = "wheels",
    worlds: Annotated[
        list[str] | None,
        Option(
            "--world",
            help="pond, clover, island, park, yard or campus; with images ring, crossing or rooms. "
            "Several with commas.",
            show_default="all of them",
        ),
    ] = None,
    policies: Annotated[
        list[str] | None,
        Option(
            "--policy",
            help="fixed, sweep, random, salient, active, a constant pan in degrees, or 360. "
            "Several with commas.",
            show_default="all names",
        ),
    ] = None,
    seeds: Annotated[
        int, Option(min=1, help="Number of drives of each, with consecutive seeds.")
    ] = 10,
    first_seed: Annotated[int, Option(min=0, help="Seed of the first drive.")] = 0,
    jobs: Annotated[int, Option(min=1, help="Number of processes.")] = 1,
) -> None:
    """Compare gaze policies: where a camera that turns shall look.

    Wheels have systematic errors, and the map is made or known. --out receives
    every run: an interrupted evaluation resumes, and more seeds add to it.
    """
    require(level in LEVELS, "level", f"one of {', '.join(LEVELS)}", level)
    setting: Any = {"level": level, "map": known, "egomotion": egomotion}
    runs = [
        GazeRun(world, policy, seed, **setting)
        for seed in range(first_seed, first_seed + seeds)
        for world in dict.fromkeys(worlds or LEVELS[level])
        for policy in dict.fromkeys(policies or POLICIES)
    ]
    with results_in(out), progress_bar("driving", len(runs)) as progress:
        rows = compare(map_in_processes(partial(result_of, out=out), runs, jobs, progress))
    title = f"{level}, {known} map, motion by {egomotion}, {seeds} seeds"
    tables = [Table(title, *_table(rows), MEANING, "policy", [])]
    if "worlds" in rows[0]:
        by_world = _world_table(rows)
        tables.append(Table("ATE relative to fixed, by world", *by_world, BY_WORLD, "policy", []))
    shown.write("evaluate gaze", LEAD, tables)
    row = setting | {"seeds": seeds, "first_seed": first_seed, "rows": rows}
    emit(row, shown.as_json, *tables)


def _table(rows: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of the means over all worlds."""
    cells = [
        [
            row["policy"],
            f"{row['ate_m']:.3f}",
            *(_ratio(row[name]) for name in ("to_fixed", "to_sweep")),
            f"{row['closed']} of {row['drives']}",
            "-" if row["inside_3sigma"] is None else f"{100 * row['inside_3sigma']:.1f}",
        ]
        for row in rows
    ]
    return ["", "ATE [m]", "to fixed", "to sweep", "closed", "inside [%]"], cells


def _world_table(rows: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of the ratios to `fixed` in each world."""
    worlds = list(rows[0]["worlds"])
    cells = [
        [row["policy"], *(f"{row['worlds'][world]:.2f}" for world in worlds), f"{row['worst']:.2f}"]
        for row in rows
    ]
    return ["", *worlds, "worst drive"], cells


def _ratio(value: list[float | None] | None) -> str:
    """Mean and interval."""
    if value is None or None in value:
        return "-"
    mean, low, high = value
    return f"{mean:.2f} [{low:.2f} {high:.2f}]"
