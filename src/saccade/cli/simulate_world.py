"""`saccade simulate world`: a landmark log with ground truth."""

from pathlib import Path
from typing import Annotated

from typer import Option

from saccade.cli.options import Config, Json, Out, Seed


def world(
    out: Out = Path("saccade-world"),
    seed: Seed = 0,
    preset: Annotated[
        str | None, Option("--preset", "-p", help="loop, slippery, coarse or car.")
    ] = None,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Simulate the landmark log of a robot or a car.

    --out receives the log (log.csv, for saccade slam), the true trajectory
    (truth.tum) and the true landmarks (landmarks.csv). The seed determines the
    noise, but not the landmarks.
    """
    from saccade import datasets
    from saccade.cli.output import print_result
    from saccade.io.files import results_in
    from saccade.settings import load_settings
    from saccade.simulation import simulate_world

    log = simulate_world(load_settings("world", preset, config), seed)
    assert log.truth is not None
    assert log.landmark_truth is not None
    with results_in(out):
        datasets.save(out / "log.csv", log)
        datasets.write_tum(out / "truth.tum", log.truth)
        datasets.write_landmarks(out / "landmarks.csv", log.landmark_truth)
    row = {
        "log": str(out / "log.csv"),
        "poses": len(log.time),
        "observations": len(log.observation),
        "landmarks": len(log.landmark_truth),
    }
    print_result(row, as_json, f"{log.name} -> {out}")
