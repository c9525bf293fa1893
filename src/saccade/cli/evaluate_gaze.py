"""`saccade evaluate gaze`: gaze policies compared."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from saccade.cli.group import option
from saccade.cli.options import ReportOptions
from saccade.cli.output import Result, progress_bar
from saccade.evaluation.gaze import COURSES, GazeRun, compare, map_in_processes, result_of
from saccade.gaze import POLICIES
from saccade.io.files import results_in
from saccade.viewing.report import Table

LEAD = "Gaze policies compared, in the same worlds with the same noise."
MEANING = (
    "ATE: absolute trajectory error, the median. Relative to fixed and to sweep: geometric mean "
    "over worlds and seeds of its ratio to that of the policy, with the 95 % interval over the "
    "seeds; lower is better. Closed: drives that saw known landmarks again in a later lap. Inside: "
    "poses whose true position lies in the 99.7 % ellipse."
)
BY_WORLD = "Geometric mean over the seeds. Worst drive: greatest ratio of a single drive."


@dataclass(frozen=True, kw_only=True)
class GazeOptions(ReportOptions):
    """Options of `saccade evaluate gaze`."""

    out: Path = option(Path("saccade-gaze"), "--out", "-o", metavar="DIR")
    """Output folder, in which the runs are stored."""
    known: Literal["new", "known"] = option("new", "--map")
    """Whether the map is new or known."""
    worlds: list[str] | None = option(None, "--world", show_default="all of them")
    """pond, clover, island, park, yard or campus, uneven worlds of 62 to 114 m. Several with
    commas."""
    policies: list[str] | None = option(None, "--policy", show_default="all names")
    """fixed, sweep, random, salient or active. Several with commas."""
    seeds: int = option(10, min=1)
    """Number of drives of each, with consecutive seeds."""
    first_seed: int = option(0, min=0)
    """Seed of the first drive."""
    jobs: int = option(1, min=1)
    """Number of processes."""


def gaze(options: GazeOptions) -> Result:
    """Compare gaze policies: where a camera that turns shall look.

    Wheels have systematic errors, and the map is made or known. --out receives
    every run: an interrupted evaluation resumes, and more seeds add to it.
    """
    seeds, first_seed = options.seeds, options.first_seed
    runs = [
        GazeRun(world, policy, seed, options.known)
        for seed in range(first_seed, first_seed + seeds)
        for world in dict.fromkeys(options.worlds or COURSES)
        for policy in dict.fromkeys(options.policies or POLICIES)
    ]
    work = partial(result_of, out=options.out)
    with results_in(options.out), progress_bar("driving", len(runs)) as progress:
        rows = compare(map_in_processes(work, runs, options.jobs, progress))
    title = f"landmarks, {options.known} map, motion by wheels, {seeds} seeds"
    tables = [Table(title, *_table(rows), MEANING, "policy", [])]
    if "worlds" in rows[0]:
        by_world = _world_table(rows)
        tables.append(Table("ATE relative to fixed, by world", *by_world, BY_WORLD, "policy", []))
    row = {"map": options.known, "seeds": seeds, "first_seed": first_seed, "rows": rows}
    return Result(row, tables, lead=LEAD)


def _table(rows: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of the means over all worlds."""
    cells = [
        [
            row["policy"],
            f"{row['ate_m']:.3f}",
            *(_ratio(row[name]) for name in ("to_fixed", "to_sweep")),
            f"{row['closed']} of {row['drives']}",
            f"{100 * row['inside_3sigma']:.1f}",
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


def _ratio(value: list[float] | None) -> str:
    """Mean and interval."""
    if value is None:
        return "-"
    mean, low, high = value
    return f"{mean:.2f} [{low:.2f} {high:.2f}]"
