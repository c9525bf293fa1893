"""`saccade evaluate consistency`: Monte Carlo runs of the filters on simulated worlds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from typer import Option

from saccade.cli.options import Config, Json, Report, Seed

if TYPE_CHECKING:
    from saccade.cli.output import Progress
    from saccade.simulation import WorldConfig

WORLDS = ("loop", "slippery", "car", "coarse")
WIDE = (
    *("far", "sonar", "precise", "turning", "skidding"),
    *("sparse", "narrow", "laps", "exploring", "radar"),
)
FILTERS = ("standard", "first-estimates", "invariant")
COLUMNS = ["", "ANEES", "landmarks", "RMSE [m]", "in band", "nonlinear"]
MEANING = (
    "ANEES: normalized estimation error squared of the pose, averaged over poses and runs; 3 for "
    "a consistent filter, more for an overconfident one. Band: 95 % of the mean over the runs at "
    "one pose; in band: fraction of the poses at which it is inside. "
    "Landmarks: the same of the landmarks at the end; 2 if consistent. RMSE: of the position. "
    "Nonlinear: the root mean share of second-order terms in the innovations' variance; doubtful "
    "over 0.12."
)


def consistency(
    preset: Annotated[
        list[str] | None,
        Option(
            "--preset",
            "-p",
            help="World: loop, slippery, car, coarse or one of --wide; several with commas.",
            show_default="the first four",
        ),
    ] = None,
    wide: Annotated[bool, Option("--wide", help=f"Ten other worlds: {', '.join(WIDE)}.")] = False,
    config: Config = None,
    kind: Annotated[
        list[str] | None,
        Option(
            "--filter",
            help="standard, first-estimates or invariant; several with commas.",
            show_default="all",
        ),
    ] = None,
    runs: Annotated[int, Option(min=1, max=10000, help="Runs of each filter in each world.")] = 50,
    seed: Seed = 0,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Test the consistency of the filters by Monte Carlo runs, with known association."""
    from saccade.cli.output import print_json, print_table, progress_bar
    from saccade.slam.consistency import chi_square_band
    from saccade.viewing.report import Table, write_tables

    results: dict[str, dict[str, dict[str, Any]]] = {}
    for name, world in _worlds(preset, config, wide).items():
        results[name] = {}
        for each in kind or FILTERS:
            with progress_bar(f"{name}, {each}", runs) as progress:
                results[name][each] = _score(world, each, runs, seed, progress)
    rows = [
        [f"{name}, {each}", *_cells(scores)]
        for name, filters in results.items()
        for each, scores in filters.items()
    ]
    low, high = chi_square_band(3, runs)
    title = f"NEES of the pose, {runs} runs each, band {low:.2f} to {high:.2f}"
    table = Table(title, COLUMNS, rows, MEANING, "world, filter")
    lead = "Consistency of the filters: whether their errors match their covariances."
    write_tables(report, "saccade evaluate consistency", lead, [table])
    if as_json:
        print_json({"runs": runs, "seed": seed, "worlds": results})
        return
    print_table(title, COLUMNS, rows)


def _worlds(presets: list[str] | None, path: Path | None, wide: bool) -> "dict[str, WorldConfig]":
    from saccade.settings import load_settings

    if path is None:
        names = presets or (WIDE if wide else WORLDS)
        return {name: load_settings("world", name) for name in names}
    return {path.stem: load_settings("world", presets[0] if presets else None, path)}


def _score(
    world: "WorldConfig", kind: str, runs: int, seed: int, progress: "Progress"
) -> dict[str, Any]:
    import numpy as np

    from saccade.evaluation.trajectory import none_if_nan
    from saccade.simulation import MonteCarloRuns, run_monte_carlo
    from saccade.slam import EkfConfig

    trials = []
    for trial in run_monte_carlo(
        world, EkfConfig(filter=cast("Any", kind), association="known"), runs, seed
    ):
        trials.append(trial)
        progress(len(trials))
    result = MonteCarloRuns(*(np.array(each) for each in zip(*trials, strict=True)))
    return {
        "anees": result.anees,
        "band": list(result.band),
        "median": result.median,
        "landmark_anees": none_if_nan(result.landmark_anees),
        "rmse_m": result.rmse,
        "in_band": result.in_band,
        "nonlinearity": result.mean_nonlinearity,
    }


def _cells(scores: dict[str, Any]) -> list[str]:
    landmarks = scores["landmark_anees"]
    return [
        f"{scores['anees']:.2f}",
        "-" if landmarks is None else f"{landmarks:.2f}",
        f"{scores['rmse_m']:.3f}",
        f"{scores['in_band']:.0%}",
        f"{scores['nonlinearity']:.3f}",
    ]
