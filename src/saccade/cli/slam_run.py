"""Runs EKF-SLAM over a log and writes the results."""

from dataclasses import asdict, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from saccade.cli.output import Progress, resumable
from saccade.cli.run_output import RunOutput, write_film, write_run
from saccade.cli.slam_report import averaging_window, facts, slam_part
from saccade.cli.slam_session import Session
from saccade.datasets import symmetric_columns, write_landmarks, write_table, write_tum
from saccade.diagnostics.landmark_log import check_log
from saccade.diagnostics.slam_run import check_run
from saccade.errors import LogError
from saccade.evaluation.slam_runs import has_headings, summarize_run
from saccade.extras import import_optional
from saccade.landmark_names import name_texts
from saccade.slam import (
    Checkpoint,
    EkfConfig,
    Recorder,
    SlamResult,
    SmoothConfig,
    SmoothResult,
    dead_reckon,
    run,
    smooth,
)
from saccade.slam.consistency import chi_square_band
from saccade.slam.run import slam_for
from saccade.types import LandmarkLog, Trajectory
from saccade.viewing import innovation_figure, map_figure, map_frames, save_figures
from saccade.viewing.live import LiveMap, save_rrd

LEAD = "The trajectory of a robot and the map of its landmarks, by an extended Kalman filter."


def map_log(
    log: LandmarkLog,
    settings: EkfConfig,
    output: RunOutput,
    progress: Progress,
    smoothing: SmoothConfig | None = None,
    session: Session | None = None,
    *,
    live: bool = False,
    rrd: Path | None = None,
) -> dict[str, Any]:
    """Run the filter over a log, write the results, and return the content of run.json.

    The log begins a map, or its session goes on with one, whose settings it then has.
    The rerun viewer shows the run if it is `live`, and its recording goes to the file `rrd`.
    """
    if smoothing is not None:
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
        if smoothing is not None:
            progress(0, 1, "smoothing")
            smoothed = smooth(log, result, smoothing)
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
        "smooth": None if smoothing is None else asdict(smoothing),
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


def smooth_config(settings: EkfConfig, smooth: bool, lag: float | None) -> SmoothConfig | None:
    """The smoother's configuration, with the noise of the filter; None for no smoothing."""
    if not smooth and lag is None:
        return None
    config = SmoothConfig(
        motion_noise_scale=settings.motion_noise_scale,
        sensor_noise_scale=settings.sensor_noise_scale,
        start_sigma=settings.start_sigma,
    )
    return config if lag is None else replace(config, method="fixed-lag", lag=lag)


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
