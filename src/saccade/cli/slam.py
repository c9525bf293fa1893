"""`saccade slam`: EKF-SLAM over a landmark log."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from typer import Option

from saccade import datasets
from saccade.cli import options
from saccade.cli.mapping import RunOutput, averaging_window, facts, slam_part, write_film, write_run
from saccade.cli.output import Progress, emit_facts, print_message, progress_bar, resumable
from saccade.cli.precompile import compile_updates, compiled_ahead
from saccade.datasets import symmetric_columns, write_landmarks, write_table, write_tum
from saccade.diagnostics.landmark_log import check_log
from saccade.diagnostics.slam_run import check_run
from saccade.errors import ConfigError, LogError
from saccade.evaluation.runs import has_headings, summarize_run
from saccade.extras import import_optional
from saccade.io.files import results_in
from saccade.landmark_names import name_texts
from saccade.settings import load_settings
from saccade.slam import (
    Checkpoint,
    EkfConfig,
    Recorder,
    Slam,
    SlamResult,
    SmoothResult,
    dead_reckon,
    run,
    smooth,
)
from saccade.slam.consistency import chi_square_band
from saccade.slam.merging import merge_maps
from saccade.slam.run import find_start, motion_of, slam_for
from saccade.types import FloatArray, LandmarkLog, Trajectory
from saccade.viewing import innovation_figure, map_figure, map_frames, save_figures
from saccade.viewing.live import LiveMap, save_rrd


def slam(
    log: options.LogPath = None,
    *,
    written: options.RunOptions,
    out: options.Out = Path("saccade-slam"),
    kind: options.LogFormat = None,
    robot: options.Robot = None,
    topic: options.Topics = None,
    association: Annotated[
        str | None,
        Option(
            help="Data association: known (identities of the log, believed), nearest, mutual, "
            "multiple (several hypotheses), or auto: identities that agree with the "
            "map, else mutual."
        ),
    ] = None,
    smooth: Annotated[
        bool, Option("--smooth", help="Smooth the trajectory at the end (needs GTSAM).")
    ] = False,
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
    merge: Annotated[
        list[Path] | None,
        Option(
            metavar="MAP",
            help="Instead of a LOG: merge these maps, in the frame of the first, into --save-map; "
            "several with commas.",
        ),
    ] = None,
    min_common: Annotated[
        int, Option(min=2, help="Landmarks that two maps to be merged must have in common.")
    ] = 5,
    live: options.LiveWindow = False,
    rrd: Annotated[
        Path | None,
        Option(metavar="FILE", help="Record the run for the rerun viewer (needs rerun-sdk)."),
    ] = None,
    preset: options.Preset = None,
    config: options.Config = None,
    as_json: options.Json = False,
) -> None:
    """Map the landmarks of a recorded log with an extended Kalman filter.

    --out receives the trajectory (trajectory.tum, for evo; poses.csv with
    covariances), the landmarks with covariances (landmarks.csv), the
    innovations (innovations.csv), figures (map.png, innovations.png), an
    interactive report (report.html), and settings and scores (run.json); with
    --film a film too (map.mp4).

    An interrupted run resumes from its last checkpoint. With --map, the
    settings are those of the map unless others are given. With --merge the
    common landmarks of maps are found by their names or, without, by their
    mutual distances.
    """
    if merge:
        _merge_maps(log, merge, save_map, min_common, as_json)
        return
    if log is None:
        raise ConfigError("LOG: expected a log, or --merge with maps, found neither")
    with compiled_ahead("association"):
        settings = load_settings("slam", preset, config)
        if association is not None:
            settings = replace(settings, association=association)
        recorded = datasets.load(
            cast("datasets.Kind", kind or "auto"), log, robot=robot, topic=topic
        )
        compile_updates()
        output = written.into(out)
        session = Session(save=save_map)
        if map_file is not None and smooth:
            raise ConfigError("--smooth: expected a log that begins its map, found --map")
        if map_file is not None:
            changed = any(each is not None for each in (association, preset, config))
            session = open_map(
                recorded, map_file, mode, start, settings if changed else None, save_map
            )
        with results_in(out), progress_bar(recorded.name) as progress:
            row = map_log(
                recorded, settings, output, progress, session, smoothing=smooth, live=live, rrd=rrd
            )
        if row["warning"]:
            print_message(f"warning: {row['warning']}")
        if row["remark"]:
            print_message(row["remark"])
        emit_facts(row, as_json, f"{recorded.name} -> {out}", facts(row))


LEAD = "The trajectory of a robot and the map of its landmarks, by an extended Kalman filter."


@dataclass(frozen=True)
class Session:
    """The part of a run that concerns other runs."""

    slam: Slam | None = None
    """With the map that was loaded; None to begin one."""
    file: Path | None = None
    """File from which it was loaded."""
    mode: str = "continue"
    start: str = "log"
    save: Path | None = None
    """Where the map is saved."""

    def figures(self, result: SlamResult) -> dict[str, Any]:
        """Figures of the session for run.json, after the run."""
        observations = result.map.observations
        if self.slam is None or result.session is None or observations is None:
            return {"map": None}
        session = len(self.slam.sessions) - 1
        loaded = result.session < session
        return {
            "map": str(self.file),
            "map_mode": self.mode,
            "map_start": self.start,
            "map_sessions": session,
            "map_landmarks": int(loaded.sum()),
            "map_landmarks_observed": int((observations[loaded] > 0).sum()),
            "map_landmarks_new": int((~loaded).sum()),
        }


def map_log(
    log: LandmarkLog,
    settings: EkfConfig,
    output: RunOutput,
    progress: Progress,
    session: Session | None = None,
    *,
    smoothing: bool = False,
    live: bool = False,
    rrd: Path | None = None,
) -> dict[str, Any]:
    """Run the filter over a log, write the results, and return the content of run.json.

    The log begins a map, or its session goes on with one, whose settings it then has.
    The rerun viewer shows the run if it is `live`, and its recording goes to the file `rrd`.
    """
    if smoothing:
        import_optional("gtsam", "smooth")  # before the work, not after it
    if rrd is not None:
        import_optional("rerun", "live")
    causes = check_log(log)
    out, session = output.folder, session or Session()
    slam = session.slam or slam_for(log, settings)
    settings = slam.config
    checkpoint = Checkpoint(out / "checkpoint.npz", output.checkpoint_interval)
    smoothed: SmoothResult | None = None
    try:
        viewer = LiveMap(log.name, log.time, dead_reckon(log, settings)) if live else None
        recorder = Recorder(output.snapshots, viewer)

        def report(done: int, total: int) -> None:
            progress(done, total, "filter")

        with resumable(checkpoint.path):
            result: SlamResult = run(
                log, progress=report, recorder=recorder, checkpoint=checkpoint, initial=slam
            )
        if smoothing:
            progress(0, 1, "smoothing")
            smoothed = smooth(log, result, settings)
    except (LogError, ArithmeticError, np.linalg.LinAlgError) as error:
        known = isinstance(error, LogError)
        if not causes and not known:
            raise
        why = error if known else "The estimate diverged"
        raise LogError(f"{log.name}: {' '.join(map(str, causes[:1]))} {why}") from error
    files = write_tables(out, log, result, smoothed)
    files |= write_figures(output, log, result, smoothed)
    snapshots, odometry = recorder.snapshots, result.dead_reckoning
    if output.film:
        frames = map_frames(snapshots, log.time, odometry)
        files |= write_film(out / "map.mp4", frames, len(snapshots), progress)
    if rrd is not None:
        files["rrd"] = save_rrd(rrd, log.name, snapshots, log.time, odometry)
    if session.save is not None:
        slam.save(session.save)
        files["map"] = session.save
    findings = check_run(log, result, causes)
    summary = summarize_run(log, result, smoothed) | session.figures(result)
    found = filter(None, (*map(str, findings), summary["warning"]))
    summary |= {"warning": " ".join(found), "findings": [asdict(each) for each in findings]}
    row = {
        **summary,
        "seed": None,  # nothing is random
        "settings": asdict(settings),
        "smooth": smoothing or None,
    }
    row = write_run(
        output,
        (f"saccade slam: {log.name}", LEAD),
        lambda: slam_part(log, result, smoothed, snapshots, facts(summary), slam.sessions[-1]),
        files,
        row,
    )
    checkpoint.remove()
    return row


def write_tables(
    out: Path, log: LandmarkLog, result: SlamResult, smoothed: SmoothResult | None
) -> dict[str, Path]:
    """Write trajectory, landmarks and innovations; returns the files.

    The tables are CSV, and Parquet too where pyarrow is installed.
    """
    best = result if smoothed is None else smoothed
    files = {
        "trajectory": out / "trajectory.tum",
        "landmarks": out / "landmarks.csv",
    }
    write_tum(files["trajectory"], best.trajectory)
    write_landmarks(files["landmarks"], best.map)
    if smoothed is not None:
        files["filter"] = out / "filter.tum"
        write_tum(files["filter"], result.trajectory)
    tables = {"poses": pose_table(best.trajectory), "innovations": innovation_table(log, result)}
    for name, table in tables.items():
        for kind in ("csv", "parquet") if find_spec("pyarrow") else ("csv",):
            files[name if kind == "csv" else f"{name}_{kind}"] = out / f"{name}.{kind}"
            write_table(out / f"{name}.{kind}", table)
    return files


def pose_table(trajectory: Trajectory) -> dict[str, np.ndarray[Any, Any]]:
    """Each pose with its covariance, as columns."""
    axes = ("x", "y", "heading")
    columns = {"time": trajectory.time}
    columns |= dict(zip(axes, trajectory.pose.T, strict=True))
    if trajectory.covariance is not None:
        columns |= symmetric_columns(axes, trajectory.covariance)
    return columns


def innovation_table(log: LandmarkLog, result: SlamResult) -> dict[str, np.ndarray[Any, Any]]:
    """Each observation with its innovation, as columns; NaN where it was not used."""
    landmark = np.append(result.map.id, -1)[result.association]
    return {
        "pose": log.observation_pose,
        "time": log.time[log.observation_pose],
        "landmark": name_texts(landmark, result.map.text_names),
        "range": log.observation[:, 0],
        "bearing": log.observation[:, 1],
        "innovation_1": result.innovation[:, 0],
        "innovation_2": result.innovation[:, 1],
        **symmetric_columns(("1", "2"), result.innovation_covariance),
        "nis": result.consistency.nis,
    }


def write_figures(
    output: RunOutput, log: LandmarkLog, result: SlamResult, smoothed: SmoothResult | None
) -> dict[str, Path]:
    """Write figures of the map and of the innovations; returns the files of the first format."""
    files: dict[str, Path] = {}
    best = result if smoothed is None else smoothed
    files["picture"] = save_figures(
        map_figure(
            best.trajectory,
            best.map,
            result.dead_reckoning,
            truth=log.truth if log.truth is not None and has_headings(log.truth) else None,
            landmark_truth=log.landmark_truth,
            filtered=None if smoothed is None else result.trajectory,
            lost=result.lost,
        ),
        output.folder / "map",
        output.figures,
    )
    consistency, window = result.consistency, averaging_window(result.consistency.nis)
    files["innovation_picture"] = save_figures(
        innovation_figure(
            log.time[log.observation_pose],
            consistency.nis,
            consistency.dof,
            window,
            chi_square_band(consistency.dof, window),
            result.trajectory,
        ),
        output.folder / "innovations",
        output.figures,
    )
    return files


def open_map(
    log: LandmarkLog,
    file: Path,
    mode: str,
    start: str | None,
    settings: EkfConfig | None,
    save: Path | None,
) -> Session:
    """Load a map for a log.

    Args:
        log: of the session.
        file: the map file.
        mode: "continue" or "localize".
        start: "last", "search", "log", three numbers, or None for the default of the mode.
        settings: None for those of the map.
        save: where the map will be saved.

    Raises:
        ConfigError, LogError: as `Slam.load` and `find_start`; or the start is something else.
    """
    start = start or ("search" if mode == "localize" else "last")
    if mode == "localize" and save is not None:
        raise ConfigError("--save-map: expected --mode continue, found localize")
    kind, motion = cast("Literal['continue', 'localize']", mode), motion_of(log, None)
    if start == "last":
        return Session(Slam.load(file, kind, settings, motion=motion), file, mode, start, save)
    load = partial(Slam.load, file, kind, settings, motion=motion, odometry_bias=log.odometry_bias)
    pose, covariance = _first_pose(load(start=log.start), log, start)
    return Session(load(start=pose, covariance=covariance), file, mode, start, save)


def _first_pose(slam: Slam, log: LandmarkLog, start: str) -> tuple[FloatArray, FloatArray | None]:
    """The first pose in the frame of the map, and its covariance; None for that of `Slam.load`."""
    if start == "search":
        return find_start(slam, log)
    if start == "log":
        return log.start, np.diag(np.square(slam.config.start_sigma))
    try:
        pose = np.array([float(number) for number in start.split(",")])
    except ValueError:
        pose = np.empty(0)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise ConfigError(f"--start: expected last, search, log or X,Y,HEADING, found {start!r}")
    return pose, None


def _merge_maps(
    log: Path | None, maps: Sequence[Path], out: Path | None, min_common: int, as_json: bool
) -> None:
    """Merge maps in the frame of the first, and print what they have in common."""
    if log is not None or out is None or len(maps) < 2:
        raise ConfigError("--merge: expected two maps or more, --save-map, and no LOG")
    slam, merged = Slam.load(maps[0], "continue"), []
    for path in maps[1:]:
        try:
            result = merge_maps(slam, Slam.load(path, "continue"), min_common)
        except LogError as error:
            raise LogError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error
        slam = result.slam
        merged.append(
            {
                "map": str(path),
                "common": len(result.common),
                "probability": result.probability,
                "nis_per_dof": result.nis / (2 * len(result.common) - 3),
                "transform": result.transform.tolist(),
                "transform_covariance": result.covariance.tolist(),
            }
        )
    slam.save(out)
    row = {"map": str(maps[0]), "merged": merged, "landmarks": len(slam.ekf), "file": str(out)}
    common = ", ".join(str(each["common"]) for each in merged)
    shown = {"landmarks": f"{len(slam.ekf):,}", "common landmarks": common}
    emit_facts(row, as_json, f"{' + '.join(map(str, maps))} -> {out}", shown)
