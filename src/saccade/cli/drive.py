"""`saccade drive`: camera frames and odometry in, a trajectory and a map out."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from saccade.cli.options import Json, Out, Preset, Settings
from saccade.cli.report_builder import ReportBuilder

if TYPE_CHECKING:
    from saccade import datasets
    from saccade.frames import Drive
    from saccade.visual import VisualConfig

LEAD = "What a robot's camera saw on its way, and the map that came of it."
Watch = Callable[[str, int, int], None]
"""Told what is being done, how much of it is, and how much there is."""


def drive(
    sequence: Annotated[
        Path, typer.Argument(metavar="SEQUENCE", help="The recorded drive, a folder or file.")
    ],
    out: Out = Path("saccade-drive"),
    kind: Annotated[
        str,
        typer.Option(
            "--format",
            help="kitti, tum-rgbd, euroc, rosbag, tracks, folder or video; auto finds out.",
        ),
    ] = "auto",
    frames: Annotated[
        int | None, typer.Option(min=1, help="Only so many frames from the start.")
    ] = None,
    detector: Annotated[str | None, typer.Option(help="sift, must or symroid.")] = None,
    selection: Annotated[
        str | None,
        typer.Option(
            help="Which points become landmarks: strength, random, range, contrast, symmetry, "
            "rematch-rate, rematch-rate-range or rematch-rate-spread."
        ),
    ] = None,
    landmarks: Annotated[int | None, typer.Option(min=1, help="In the map at most.")] = None,
    film: Annotated[bool, typer.Option(help="Make a film of what is seen and mapped.")] = True,
    checkpoint: Annotated[
        float, typer.Option(min=0.0, help="Seconds between checkpoints, to go on from.")
    ] = 10.0,
    preset: Preset = None,
    config: Settings = None,
    as_json: Json = False,
) -> None:
    """Map what a camera sees on a drive: the whole system.

    In --out appear the trajectory (trajectory.tum, for evo; poses.csv with
    covariances), the map (landmarks.csv; map.npz with descriptors), what was
    seen of which landmark when (sightings.csv), a picture (map.png), a
    film (drive.mp4) and a still of it (drive.png), a page to scrub through
    time and click (report.html), and the settings with the figures (run.json).

    A run that was interrupted goes on from its last checkpoint.
    """
    from dataclasses import replace

    from rich.markup import escape
    from rich.progress import Progress

    from saccade import datasets
    from saccade.cli.output import messages, print_json, print_message
    from saccade.settings import load_settings

    settings = load_settings("visual", preset, config)
    given = {"detector": detector, "selection": selection, "max_landmarks": landmarks}
    settings = replace(settings, **{k: v for k, v in given.items() if v is not None})
    recorded = datasets.load_drive(cast("datasets.DriveKind", kind), sequence)
    if frames is not None:
        recorded = recorded.until(frames)
    for remark in recorded.remarks:
        print_message(remark)
    console = messages()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(escape(recorded.name), total=None)
        row = map_drive(
            recorded,
            out,
            settings,
            lambda what, done, total: progress.update(
                task, description=f"{escape(recorded.name)}: {what}", completed=done, total=total
            ),
            film=film,
            checkpoint=checkpoint,
        )
    for remark in row["remarks"]:
        print_message(remark)
    if as_json:
        print_json(row)
        return
    show(recorded.name, out, row)


def map_drive(
    recorded: "Drive",
    out: Path,
    settings: "VisualConfig",
    watch: Watch,
    *,
    film: bool = True,
    pictures: int = 240,
    checkpoint: float = 10.0,
    builder: ReportBuilder | None = None,
) -> dict[str, Any]:
    """Map a drive, write all that comes of it, give the row for run.json.

    Args:
        recorded: the drive.
        out: folder for what is made.
        settings: how to map.
        watch: told of the progress.
        film: whether a film is made.
        pictures: in the film, at most.
        checkpoint: seconds between checkpoints.
        builder: takes the map, in the place of a report of its own.
    """
    import json
    from dataclasses import asdict

    import saccade
    from saccade import visual
    from saccade.cli.drive_files import summary, write_film, write_pictures, write_tables
    from saccade.cli.drive_report import drive_part
    from saccade.cli.output import resumable, write_text
    from saccade.formats import FORMATS
    from saccade.slam import Checkpoint, Recorder

    recorder, kept = Recorder(pictures), Checkpoint(out / "checkpoint.npz", checkpoint)
    with resumable(kept.path), visual.dedicated_process():
        result = visual.run(
            recorded,
            settings,
            lambda done, of: watch("map", done, of),
            recorder=recorder,
            checkpoint=kept,
        )
    files = write_tables(out, result)
    files |= write_pictures(out, recorded, result)
    if film:
        files |= write_film(
            out / "drive.mp4",
            recorded,
            recorder.snapshots,
            result,
            settings,
            lambda done, of: watch("film", done, of),
        )
    numbers = summary(recorded, result)
    own = ReportBuilder(f"saccade drive: {recorded.name}", LEAD) if builder is None else builder
    own.add(lambda: drive_part(recorded, recorder.snapshots, result, numbers))
    if builder is None:
        files["report"] = own.write(out / "report.html")
    row = {
        **numbers,
        "remarks": list(result.remarks),
        "format": FORMATS["run"],
        "version": saccade.__version__,
        "seed": settings.seed,
        "settings": asdict(settings),
        "files": {name: str(path) for name, path in files.items()},
    }
    write_text(out / "run.json", json.dumps(row, indent=2) + "\n")
    kept.remove()
    return row


def show(name: str, out: Path, row: dict[str, Any]) -> None:
    """The figures of a drive as a person reads them."""
    from saccade.cli.output import print_table

    if row["ate_m"] is not None:
        ways = {"with the map": row, "odometry": row["odometry"]}
        ways["visual odometry"] = row["visual_odometry"]
        columns = {
            "ate_m": "ATE (m)",
            "rpe_m": "RPE (m)",
            "end_m": "at the end (m)",
            "inside_3sigma": "in 3 sigma",
        }
        print_table(
            f"{name} -> {out}",
            ["", *columns.values()],
            [
                [way, *("" if (v := found.get(c)) is None else f"{v:.3f}" for c in columns)]
                for way, found in ways.items()
            ],
        )
    facts = {
        "frames": str(row["frames"]),
        "landmarks": str(row["landmarks"]),
        "sightings": str(row["sightings"]),
        "recognized again": str(row["recognized"]),
        "ms per frame": f"{row['ms_per_frame']:.1f}",
        **{f"  {step}": f"{value:.1f}" for step, value in row["ms"].items()},
    }
    if row["association_precision"] is not None:
        facts["right associations"] = f"{row['association_precision']:.1%}"
    print_table("" if row["ate_m"] is not None else f"{name} -> {out}", ["", ""], facts.items())
