"""`saccade simulate`: simulated worlds and drives with ground truth."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from saccade.cli.options import Json, Out, Settings

if TYPE_CHECKING:
    from saccade.frames import Drive

simulate = typer.Typer(help="Make worlds whose truth is known.", no_args_is_help=True)


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
    from saccade.files import make_folder
    from saccade.settings import load_settings
    from saccade.simulation import simulate_world

    log = simulate_world(load_settings("world", preset, config), seed)
    assert log.truth is not None
    assert log.landmark_truth is not None
    make_folder(out)
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


@simulate.command(epilog="Example: saccade simulate drive --preset repeated --seed 7 --out ring")
def drive(
    out: Out = Path("saccade-drive"),
    seed: Annotated[int, typer.Option(min=0, help="Of all that is drawn.")] = 0,
    preset: Annotated[
        str | None,
        typer.Option("--preset", "-p", help="ring, mono, repeated, mirror, dark or flicker."),
    ] = None,
    frames: Annotated[
        int | None, typer.Option(min=2, help="How many; a lap has 300, a drive two laps.")
    ] = None,
    color: Annotated[bool, typer.Option("--color", help="Images in color.")] = False,
    depth: Annotated[bool, typer.Option("--depth", help="The true depth of every pixel.")] = False,
    config: Settings = None,
    as_json: Json = False,
) -> None:
    """Drive a robot with a camera twice round a courtyard hung with posters.

    In --out appear the images of the left (image_0) and the right camera
    (image_1), calibration (calib.txt, camera.toml), times.txt, the odometry
    with its noise (odometry.csv) and where the robot was (groundtruth.tum),
    all in the layout of KITTI's odometry benchmark: hand it to saccade drive.
    The same seed gives the same files; another one other walls and posters, too.
    """
    from saccade.cli.output import print_json, print_table
    from saccade.settings import load_settings
    from saccade.simulation import simulate_drive

    wanted = load_settings("drive", preset, config)
    if frames is not None:
        wanted = replace(wanted, frames=frames)
    wanted = replace(wanted, color=wanted.color or color, depth=wanted.depth or depth)
    made = simulate_drive(wanted, seed)
    _save(made, out)
    row = {
        "sequence": str(out),
        "frames": len(made),
        "cameras": 2 if made.camera.baseline > 0 else 1,
        "truth": repr(made.truth),
    }
    if as_json:
        print_json(row)
        return
    print_table(f"{made.name} -> {out}", ["", ""], [(k, str(v)) for k, v in row.items()])


def _save(made: "Drive", out: Path) -> None:
    """Write the drive, with a progress bar where someone watches."""
    from rich.progress import Progress

    from saccade.cli.output import messages
    from saccade.datasets import save_drive

    console = messages()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("rendering", total=len(made))
        save_drive(out, made, lambda done, _: progress.update(task, completed=done))
