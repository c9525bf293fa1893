"""`saccade slam`: a landmark log in, a trajectory and a map out."""

from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from saccade.cli.options import Json, Out, Preset, Settings

if TYPE_CHECKING:
    from saccade.slam import EkfConfig
    from saccade.types import LandmarkLog


def slam(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The recorded log, a file or folder.")],
    out: Out = Path("saccade-slam"),
    kind: Annotated[
        str,
        typer.Option("--format", help="victoria-park, mrclam, isam or dlr; auto finds out."),
    ] = "auto",
    robot: Annotated[
        int | None, typer.Option(min=1, help="Which robot, where a log has several.")
    ] = None,
    association: Annotated[
        str | None,
        typer.Option(help="known: the log says what was seen; nearest: find out; auto."),
    ] = None,
    preset: Preset = None,
    config: Settings = None,
    as_json: Json = False,
) -> None:
    """Map landmarks from a recorded log with an extended Kalman filter.

    In --out appear the trajectory (trajectory.tum, for evo), the landmarks
    with their covariance (landmarks.csv), the picture (map.png), and the
    settings with the figures (run.json).
    """
    from dataclasses import replace

    from rich.markup import escape
    from rich.progress import Progress

    from saccade import datasets
    from saccade.cli.output import messages, print_json, print_table
    from saccade.cli.settings import load_settings

    settings = load_settings("slam", preset, config)
    if association is not None:
        settings = replace(settings, association=association)
    recorded = datasets.load(cast("datasets.Kind", kind), log, robot=robot)
    console = messages()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(escape(recorded.name), total=None)
        row = map_log(
            recorded,
            out,
            settings,
            lambda done, total: progress.update(task, completed=done, total=total),
        )
    if as_json:
        print_json(row)
        return
    print_table(f"{recorded.name} -> {out}", ["", ""], facts(row).items())


def facts(row: dict[str, Any]) -> dict[str, str]:
    """The figures of a run as a person reads them: plain numbers only."""
    return {
        name.replace("_", " "): f"{value:.3f}" if isinstance(value, float) else str(value)
        for name, value in row.items()
        if isinstance(value, (int, float))
    }


def map_log(
    log: "LandmarkLog",
    out: Path,
    settings: "EkfConfig",
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Run the filter over a log: write trajectory, map, picture and run.json, give the row.

    Args:
        log: a LandmarkLog.
        out: folder for what is made.
        settings: an EkfConfig.
        progress: called with the steps done and their number.
    """
    import json
    from dataclasses import asdict

    import saccade
    from saccade.cli.output import write_text
    from saccade.datasets import write_landmarks, write_tum
    from saccade.errors import LogError
    from saccade.slam import run
    from saccade.viewing import map_figure, save_figure

    try:
        result = run(log, settings, progress=progress)
    except LogError as error:
        raise LogError(f"{log.name}: {error}") from error
    figure = map_figure(result.trajectory, result.map, result.dead_reckoning)
    files = {
        "picture": out / "map.png",
        "trajectory": out / "trajectory.tum",
        "landmarks": out / "landmarks.csv",
    }
    save_figure(figure, files["picture"])
    write_tum(files["trajectory"], result.trajectory)
    write_landmarks(files["landmarks"], result.map)
    low, high = result.consistency.band
    row = {
        "log": log.name,
        "poses": len(result.trajectory),
        "observations": len(log.observation),
        "observations_used": int((result.association >= 0).sum()),
        "landmarks": len(result.map),
        "nis_mean": finite(result.consistency.mean),
        "nis_band": [low, high],
        "version": saccade.__version__,
        "settings": asdict(settings),
        "files": {name: str(path) for name, path in files.items()},
    }
    write_text(out / "run.json", json.dumps(row, indent=2) + "\n")
    return row


def finite(value: float) -> float | None:
    """A number, or None where there is none: JSON has no NaN."""
    return value if isfinite(value) else None
