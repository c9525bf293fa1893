"""`saccade evaluate consistency`: whether a filter's errors are as large as it says."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from saccade.cli.options import Json, Report, Settings

if TYPE_CHECKING:
    from saccade.simulation import WorldConfig

WORLDS = ("loop", "slippery", "car", "coarse")
FILTERS = ("standard", "first-estimates", "invariant")

MEANING = (
    "The squared error of the pose, normalized by the covariance that the filter gives it, is "
    "three on average if the filter knows how wrong it is; one that is sure of too much is above. "
    "ANEES: its mean over poses and runs; median: over the runs. 95 % band: where the mean of so "
    "many runs at one pose lies in 95 of 100 cases; in band: share of the poses at which it does. "
    "RMSE: distance from the true place."
)


def consistency(
    preset: Annotated[
        list[str] | None,
        typer.Option(
            "--preset", "-p", help="A world: loop, slippery, car or coarse; may be repeated."
        ),
    ] = None,
    config: Settings = None,
    kind: Annotated[
        list[str] | None,
        typer.Option("--filter", help="invariant, standard or first-estimates; may be repeated."),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, max=10000, help="Of each filter in each world.")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise of the first run.")] = 0,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Let filters loose on simulated worlds, association known, and weigh their errors.

    The squared error of the pose, normalized by the covariance that the filter gives it, is
    three on average if the filter knows how wrong it is (ANEES: mean over poses and runs, and
    median over the runs). Of that many runs the mean at one pose lies within the band in 95 of
    100 cases; a filter that is sure of too much is above it. In band: share of the poses.
    """
    from rich.progress import Progress

    from saccade.cli.output import messages, print_json, print_table
    from saccade.cli.report_builder import Table, write_table_page

    worlds = _worlds(preset, config)
    filters = kind or list(FILTERS)
    console = messages()
    results: dict[str, dict[str, dict[str, Any]]] = {}
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("driving", total=len(worlds) * len(filters) * runs)
        for name, world in worlds.items():
            results[name] = {
                each: _scores(world, each, runs, seed, lambda: progress.advance(task))
                for each in filters
            }
    columns = ["", "ANEES", "95 % band", "median", "RMSE [m]", "in band"]
    rows = [
        [f"{name}, {each}", *_cells(scores)]
        for name, of_world in results.items()
        for each, scores in of_world.items()
    ]
    title = f"Normalized squared error of the pose, {runs} runs each"
    lead = "Whether filters know how wrong they are."
    table = Table(title, columns, rows, MEANING, "world, filter")
    write_table_page(report, "saccade evaluate consistency", lead, [table])
    if as_json:
        print_json({"runs": runs, "seed": seed, "worlds": results})
        return
    print_table(title, columns, rows)


def _worlds(presets: list[str] | None, path: Path | None) -> "dict[str, WorldConfig]":
    from saccade.settings import load_settings

    if path is None:
        return {name: load_settings("world", name) for name in presets or WORLDS}
    return {path.stem: load_settings("world", presets[0] if presets else None, path)}


def _scores(
    world: "WorldConfig", kind: str, runs: int, seed: int, done: Callable[[], object]
) -> dict[str, Any]:
    import numpy as np

    from saccade.simulation import MonteCarloRuns, run_monte_carlo
    from saccade.slam import EkfConfig

    found = []
    for trial in run_monte_carlo(world, EkfConfig(filter=cast("Any", kind)), runs, seed):
        found.append(trial)
        done()
    nees, squared = (np.array(each) for each in zip(*found, strict=True))
    trials = MonteCarloRuns(nees, squared)
    return {
        "anees": trials.anees,
        "band": list(trials.band),
        "median": trials.median,
        "rmse_m": trials.rmse,
        "in_band": trials.in_band,
    }


def _cells(scores: dict[str, Any]) -> list[str]:
    low, high = scores["band"]
    return [
        f"{scores['anees']:.2f}",
        f"{low:.2f} to {high:.2f}",
        f"{scores['median']:.2f}",
        f"{scores['rmse_m']:.3f}",
        f"{scores['in_band']:.0%}",
    ]
