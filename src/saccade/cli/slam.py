"""`saccade slam`: EKF-SLAM over a landmark log."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from saccade.cli.options import (
    CheckpointInterval,
    Config,
    Film,
    Json,
    Log,
    LogFormat,
    Out,
    Preset,
    Robot,
)
from saccade.cli.run_output import RunOutput

if TYPE_CHECKING:
    from saccade.cli.output import Progress
    from saccade.slam import EkfConfig, SlamResult, SmoothConfig, SmoothResult
    from saccade.types import LandmarkLog

LEAD = "The trajectory of a robot and the map of its landmarks, by an extended Kalman filter."


def slam(
    log: Log,
    out: Out = Path("saccade-slam"),
    kind: LogFormat = None,
    robot: Robot = None,
    association: Annotated[
        str | None,
        typer.Option(
            help="Data association: known (identities of the log), nearest, mutual, joint (JCBB), "
            "or auto: known if the log has identities, else mutual."
        ),
    ] = None,
    tune: Annotated[
        bool, typer.Option("--tune", help="First fit the noise to the innovations.")
    ] = False,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Batch-smooth the trajectory at the end (needs GTSAM).")
    ] = False,
    lag: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Smooth with this fixed lag instead of in one batch."),
    ] = None,
    film: Film = True,
    live: Annotated[
        bool, typer.Option("--live", help="Show the run in the rerun viewer (needs rerun-sdk).")
    ] = False,
    rrd: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Record the run for the rerun viewer (needs rerun-sdk)."),
    ] = None,
    checkpoint: CheckpointInterval = 10.0,
    preset: Preset = None,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Map the landmarks of a recorded log with an extended Kalman filter.

    --out receives the trajectory (trajectory.tum, for evo; poses.csv with
    covariances), the landmarks with covariances (landmarks.csv), the
    innovations (innovations.csv), figures (map.png, innovations.png), a film
    (map.mp4), an interactive report (report.html), and settings and scores
    (run.json).

    An interrupted run resumes from its last checkpoint.
    """
    from saccade import datasets
    from saccade.cli.output import print_message, print_result, progress_bar
    from saccade.cli.slam_report import facts
    from saccade.settings import load_settings
    from saccade.slam.tuning import tune as fit_noise

    settings = load_settings("slam", preset, config)
    if association is not None:
        settings = replace(settings, association=association)
    kind = "auto" if kind is None else kind
    recorded = datasets.load(cast("datasets.Kind", kind), log, robot=robot)
    if tune:
        tuned = fit_noise(recorded, settings)
        settings = tuned.config
        print_message(tuned.words)
    output = RunOutput(out, film, checkpoint_interval=checkpoint)
    smoothing = smooth_config(settings, smooth, lag)
    with progress_bar(recorded.name) as progress:
        row = map_log(recorded, settings, output, progress, smoothing, live=live, rrd=rrd)
    if row["warning"]:
        print_message(f"warning: {row['warning']}")
    if row["remark"]:
        print_message(row["remark"])
    print_result(row, as_json, f"{recorded.name} -> {out}", facts(row))


def map_log(
    log: "LandmarkLog",
    settings: "EkfConfig",
    output: RunOutput,
    progress: "Progress",
    smoothing: "SmoothConfig | None" = None,
    *,
    live: bool = False,
    rrd: Path | None = None,
) -> dict[str, Any]:
    """Run the filter over a log, write the results, and return the content of run.json.

    Args:
        log: the log.
        settings: configuration of the filter.
        output: where the results are written.
        progress: reports the progress.
        smoothing: configuration of the smoother; None for none.
        live: whether the rerun viewer shows the run.
        rrd: a recording for that viewer.
    """
    from dataclasses import asdict

    from saccade.cli.output import resumable
    from saccade.cli.run_output import write_film, write_run
    from saccade.cli.slam_files import write_figures, write_tables
    from saccade.cli.slam_report import facts, slam_part
    from saccade.errors import LogError
    from saccade.evaluation.slam_runs import summarize_run
    from saccade.extras import import_optional
    from saccade.slam import Checkpoint, Recorder, dead_reckon, run
    from saccade.slam import smooth as smooth_run
    from saccade.viewing import map_frames
    from saccade.viewing.live import LiveMap, save_rrd

    if smoothing is not None:
        import_optional("gtsam", "smooth")  # before the work, not after it
    if rrd is not None:
        import_optional("rerun", "live")
    out = output.folder
    checkpoint = Checkpoint(out / "checkpoint.npz", output.checkpoint_interval)
    smoothed: SmoothResult | None = None
    try:
        viewer = LiveMap(log.name, log.time, dead_reckon(log, settings)) if live else None
        recorder = Recorder(output.snapshots, viewer)

        def report(done: int, total: int) -> None:
            progress(done, total, "filter")

        with resumable(checkpoint.path):
            result: SlamResult = run(
                log, settings, report, recorder=recorder, checkpoint=checkpoint
            )
        if smoothing is not None:
            progress(0, 1, "smoothing")
            smoothed = smooth_run(log, result, smoothing)
    except LogError as error:
        raise LogError(f"{log.name}: {error}") from error
    files = write_tables(out, log, result, smoothed) | write_figures(out, log, result, smoothed)
    snapshots, odometry = recorder.snapshots, result.dead_reckoning
    if output.film:
        frames = map_frames(snapshots, log.time, odometry)
        files |= write_film(out / "map.mp4", frames, len(snapshots), progress)
    if rrd is not None:
        files["rrd"] = save_rrd(rrd, log.name, snapshots, log.time, odometry)
    summary = summarize_run(log, result, smoothed)
    row = {
        **summary,
        "seed": None,  # nothing is random
        "settings": asdict(settings),
        "smooth": None if smoothing is None else asdict(smoothing),
    }
    row = write_run(
        output,
        (f"saccade slam: {log.name}", LEAD),
        lambda: slam_part(log, result, smoothed, snapshots, facts(summary)),
        files,
        row,
    )
    checkpoint.remove()
    return row


def smooth_config(settings: "EkfConfig", smooth: bool, lag: float | None) -> "SmoothConfig | None":
    """The smoother's configuration, with the noise of the filter; None for no smoothing."""
    from saccade.slam import SmoothConfig

    if not smooth and lag is None:
        return None
    config = SmoothConfig(
        motion_noise_scale=settings.motion_noise_scale,
        sensor_noise_scale=settings.sensor_noise_scale,
        start_sigma=settings.start_sigma,
    )
    return config if lag is None else replace(config, method="fixed-lag", lag=lag)
