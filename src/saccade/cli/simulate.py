"""`saccade simulate`: made worlds with truth."""

from pathlib import Path
from typing import Annotated

import typer

from saccade.cli.options import Json, Out, Settings

simulate = typer.Typer(help="Make worlds whose truth is known.", no_args_is_help=True)


@simulate.callback()
def _simulate() -> None:
    """Keep the name of the one command there is."""


@simulate.command(epilog="Example: saccade simulate world --preset car --seed 7 --out drive")
def world(
    out: Out = Path("saccade-world"),
    seed: Annotated[int, typer.Option(min=0, help="Of the noise.")] = 0,
    preset: Annotated[
        str | None, typer.Option("--preset", "-p", help="loop, slippery, coarse or car.")
    ] = None,
    config: Settings = None,
    as_json: Json = False,
) -> None:
    """Drive a robot or a car once through a world of landmarks.

    In --out appear what it measured (log.csv, for saccade slam), where it
    was (truth.tum), and where the landmarks are (landmarks.csv). The same
    seed gives the same files; the landmarks do not change with it.
    """
    from saccade import datasets
    from saccade.cli.output import print_json, print_table
    from saccade.cli.settings import load_settings
    from saccade.simulation import simulate_world

    log = simulate_world(load_settings("world", preset, config), seed)
    assert log.truth is not None
    assert log.landmark_truth is not None
    out.mkdir(parents=True, exist_ok=True)
    datasets.write_log_csv(out / "log.csv", log)
    datasets.write_tum(out / "truth.tum", log.truth)
    datasets.write_landmarks(out / "landmarks.csv", log.landmark_truth)
    row = {
        "log": str(out / "log.csv"),
        "poses": len(log.time),
        "observations": len(log.observation),
        "landmarks": len(log.landmark_truth),
    }
    if as_json:
        print_json(row)
        return
    print_table(f"{log.name} -> {out}", ["", ""], [(k, str(v)) for k, v in row.items()])
