"""`saccade slam`: a landmark log in, a trajectory and a map out."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from saccade.cli.options import Json, Out, Preset, Settings
from saccade.cli.report_builder import ReportBuilder

if TYPE_CHECKING:
    from saccade.slam import Checkpoint, EkfConfig, Recorder, SlamResult, SmoothConfig, SmoothResult
    from saccade.types import LandmarkLog

LEAD = "What a robot drove and saw, and the map that an extended Kalman filter makes of it."
Watch = Callable[[str, int, int], None]
"""Told what is being done, how much of it is, and how much there is."""


def slam(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The recorded log, a file or folder.")],
    out: Out = Path("saccade-slam"),
    kind: Annotated[
        str,
        typer.Option(
            "--format", help="csv, g2o, isam, mrclam, victoria-park or dlr; auto finds out."
        ),
    ] = "auto",
    robot: Annotated[
        int | None, typer.Option(min=1, help="Which robot, where a log has several.")
    ] = None,
    association: Annotated[
        str | None,
        typer.Option(
            help="known: the log says what was seen; nearest, mutual, joint: find out; auto."
        ),
    ] = None,
    tune: Annotated[
        bool, typer.Option("--tune", help="Find the noise by the innovations, and use it.")
    ] = False,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Smooth the whole drive at the end (needs GTSAM).")
    ] = False,
    lag: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Smooth each pose only by what is seen until so long after it.",
        ),
    ] = None,
    film: Annotated[bool, typer.Option(help="Make a film of the map while it grows.")] = True,
    live: Annotated[
        bool, typer.Option("--live", help="Watch in the rerun viewer (needs rerun-sdk).")
    ] = False,
    rrd: Annotated[
        Path | None, typer.Option(help="Save for the rerun viewer (needs rerun-sdk).")
    ] = None,
    checkpoint: Annotated[
        float, typer.Option(min=0.0, help="Seconds between checkpoints, to go on from.")
    ] = 10.0,
    preset: Preset = None,
    config: Settings = None,
    as_json: Json = False,
) -> None:
    """Map landmarks from a recorded log with an extended Kalman filter.

    In --out appear the trajectory (trajectory.tum, for evo; poses.csv with
    covariances), the landmarks with theirs (landmarks.csv), every innovation
    (innovations.csv), pictures (map.png, innovations.png), a film (map.mp4),
    a page to scrub through time and click (report.html), and the settings
    with the figures (run.json).

    A run that was interrupted goes on from its last checkpoint.
    """
    from rich.markup import escape
    from rich.progress import Progress

    from saccade import datasets
    from saccade.cli.output import messages, print_json, print_message, print_table
    from saccade.cli.slam_report import facts
    from saccade.settings import load_settings
    from saccade.slam.tuning import tune as tuned

    settings = load_settings("slam", preset, config)
    if association is not None:
        settings = replace(settings, association=association)
    recorded = datasets.load(cast("datasets.Kind", kind), log, robot=robot)
    if tune:
        found = tuned(recorded, settings)
        settings = found.config
        print_message(found.words)
    console = messages()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(escape(recorded.name), total=None)
        row = map_log(
            recorded,
            out,
            settings,
            lambda what, done, total: progress.update(
                task, description=f"{escape(recorded.name)}: {what}", completed=done, total=total
            ),
            smooth=smoothing_of(settings, smooth, lag),
            film=film,
            live=live,
            rrd=rrd,
            checkpoint=checkpoint,
        )
    if row["warning"]:
        print_message(f"warning: {row['warning']}")
    if row["remark"]:
        print_message(row["remark"])
    if as_json:
        print_json(row)
        return
    print_table(f"{recorded.name} -> {out}", ["", ""], facts(row).items())


def map_log(
    log: "LandmarkLog",
    out: Path,
    settings: "EkfConfig",
    watch: Watch,
    *,
    smooth: "SmoothConfig | None" = None,
    film: bool = True,
    live: bool = False,
    rrd: Path | None = None,
    checkpoint: float = 10.0,
    builder: ReportBuilder | None = None,
) -> dict[str, Any]:
    """Run the filter over a log, write all that comes of it, give the row for run.json.

    Args:
        log: a LandmarkLog.
        out: folder for what is made.
        settings: an EkfConfig.
        watch: told of the progress.
        smooth: how the drive is smoothed at the end, if it is.
        film: whether a film is made.
        live: whether the rerun viewer is opened.
        rrd: a file for that viewer.
        checkpoint: seconds between checkpoints.
        builder: takes the map, in the place of a report of its own.
    """
    import json
    from dataclasses import asdict

    import saccade
    from saccade.cli.output import write_text
    from saccade.cli.slam_files import summary, write_film, write_pictures, write_tables
    from saccade.cli.slam_report import facts, slam_part
    from saccade.errors import LogError
    from saccade.extras import import_optional
    from saccade.formats import FORMATS
    from saccade.slam import Checkpoint, Recorder, dead_reckon
    from saccade.viewing.live import LiveMap, save_rrd

    if smooth is not None:
        import_optional("gtsam", "smooth")  # before the work, not after it
    if rrd is not None:
        import_optional("rerun", "live")
    try:
        show = LiveMap(log.name, log.time, dead_reckon(log, settings)) if live else None
        recorder, kept = Recorder(on_snapshot=show), Checkpoint(out / "checkpoint.npz", checkpoint)
        result, smoothed = _estimate(log, settings, watch, smooth, recorder, kept)
    except LogError as error:
        raise LogError(f"{log.name}: {error}") from error
    files = write_tables(out, log, result, smoothed)
    files |= write_pictures(out, log, result, smoothed)
    snapshots, reckoned = recorder.snapshots, result.dead_reckoning
    if film:
        files["film"] = write_film(
            out / "map.mp4", snapshots, log, result, lambda done, of: watch("film", done, of)
        )
    if rrd is not None:
        files["rrd"] = save_rrd(rrd, log.name, snapshots, log.time, reckoned)
    numbers = summary(log, result, smoothed)
    own = ReportBuilder(f"saccade slam: {log.name}", LEAD) if builder is None else builder
    own.add(lambda: slam_part(log, result, smoothed, snapshots, facts(numbers)))
    if builder is None:
        files["report"] = own.write(out / "report.html")
    row = {
        **numbers,
        "format": FORMATS["run"],
        "version": saccade.__version__,
        "seed": None,  # nothing is drawn at random
        "settings": asdict(settings),
        "smooth": None if smooth is None else asdict(smooth),
        "files": {name: str(path) for name, path in files.items()},
    }
    write_text(out / "run.json", json.dumps(row, indent=2) + "\n")
    kept.remove()
    return row


def _estimate(
    log: "LandmarkLog",
    settings: "EkfConfig",
    watch: Watch,
    smooth: "SmoothConfig | None",
    recorder: "Recorder",
    checkpoint: "Checkpoint",
) -> "tuple[SlamResult, SmoothResult | None]":
    from saccade import slam
    from saccade.cli.output import resumable

    with resumable(checkpoint.path):
        result = slam.run(
            log,
            settings,
            lambda done, of: watch("filter", done, of),
            recorder=recorder,
            checkpoint=checkpoint,
        )
    if smooth is None:
        return result, None
    watch("smoothing", 0, 1)
    return result, slam.smooth(log, result, smooth)


def smoothing_of(settings: "EkfConfig", smooth: bool, lag: float | None) -> "SmoothConfig | None":
    """How a drive is smoothed that is filtered with some settings; None where it is not."""
    from saccade.slam import SmoothConfig

    if not smooth and lag is None:
        return None
    noise = SmoothConfig(
        motion_noise_scale=settings.motion_noise_scale,
        sensor_noise_scale=settings.sensor_noise_scale,
        start_sigma=settings.start_sigma,
    )
    return noise if lag is None else replace(noise, method="fixed-lag", lag=lag)
