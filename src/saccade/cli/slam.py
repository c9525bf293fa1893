"""`saccade slam`: EKF-SLAM over a landmark log."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, cast

from typer import Option

from saccade.cli.options import (
    CheckpointInterval,
    Config,
    FigureFormats,
    Film,
    Json,
    LiveWindow,
    LogFormat,
    LogPath,
    Out,
    Preset,
    Robot,
    Topics,
    figure_formats,
)


def slam(
    log: LogPath,
    out: Out = Path("saccade-slam"),
    kind: LogFormat = None,
    robot: Robot = None,
    topic: Topics = None,
    association: Annotated[
        str | None,
        Option(
            help="Data association: known (identities of the log, believed), nearest, mutual, "
            "multiple (several hypotheses), or auto: identities that agree with the "
            "map, else mutual."
        ),
    ] = None,
    smooth: Annotated[
        bool, Option("--smooth", help="Batch-smooth the trajectory at the end (needs GTSAM).")
    ] = False,
    lag: Annotated[
        float | None,
        Option(metavar="SECONDS", help="Smooth with this fixed lag instead of in one batch."),
    ] = None,
    map_file: Annotated[
        Path | None, Option("--map", metavar="FILE", help="Begin with a map of an earlier run.")
    ] = None,
    save_map: Annotated[
        Path | None, Option(metavar="FILE", help="Save map and filter for --map of a later run.")
    ] = None,
    mode: Annotated[
        str,
        Option(help="With --map: continue mapping, or localize, which adds and culls nothing."),
    ] = "continue",
    start: Annotated[
        str | None,
        Option(
            metavar="WHERE",
            help="With --map: first pose in its frame. last: the robot has not moved since (the "
            "default of continue); search: by the first scans (the default of localize); log: as "
            "in the log; or X,Y,HEADING in metres and radians.",
        ),
    ] = None,
    figures: FigureFormats = None,
    film: Film = True,
    live: LiveWindow = False,
    rrd: Annotated[
        Path | None,
        Option(metavar="FILE", help="Record the run for the rerun viewer (needs rerun-sdk)."),
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

    An interrupted run resumes from its last checkpoint. With --map, the
    settings are those of the map unless others are given.
    """
    from saccade.cli.precompile import filter_compiled_ahead

    with filter_compiled_ahead() as finish:
        from saccade import datasets
        from saccade.cli.output import print_message, print_result, progress_bar
        from saccade.cli.run_output import RunOutput
        from saccade.cli.slam_report import facts
        from saccade.cli.slam_run import map_log, smooth_config
        from saccade.cli.slam_session import Session, open_map
        from saccade.errors import ConfigError
        from saccade.io.files import results_in
        from saccade.settings import load_settings

        settings = load_settings("slam", preset, config)
        if association is not None:
            settings = replace(settings, association=association)
        kind = "auto" if kind is None else kind
        recorded = datasets.load(cast("datasets.Kind", kind), log, robot=robot, topic=topic)
        finish()
        output = RunOutput(
            out, film, checkpoint_interval=checkpoint, figures=figure_formats(figures)
        )
        smoothing = smooth_config(settings, smooth, lag)
        session = Session(save=save_map)
        if map_file is not None and smoothing is not None:
            raise ConfigError("--smooth: expected a log that begins its map, found --map")
        if map_file is not None:
            changed = any(each is not None for each in (association, preset, config))
            session = open_map(
                recorded, map_file, mode, start, settings if changed else None, save_map
            )
        with results_in(out), progress_bar(recorded.name) as progress:
            row = map_log(
                recorded, settings, output, progress, smoothing, session, live=live, rrd=rrd
            )
        if row["warning"]:
            print_message(f"warning: {row['warning']}")
        if row["remark"]:
            print_message(row["remark"])
        print_result(row, as_json, f"{recorded.name} -> {out}", facts(row))
