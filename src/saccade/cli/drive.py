"""`saccade drive`: visual SLAM from camera frames and odometry."""

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from typer import Option

from saccade import visual
from saccade.attention import attention_saliency, contrast_saliency, symmetry_saliency
from saccade.cli import options
from saccade.cli.mapping import (
    RunOutput,
    drive_part,
    eye_loader,
    image_loader,
    lost_text,
    write_film,
    write_run,
)
from saccade.cli.output import (
    Progress,
    Table,
    emit,
    print_message,
    progress_bar,
    resumable,
    write_arrays,
)
from saccade.cli.slam import pose_table
from saccade.datasets import save_drive, write_landmarks, write_table, write_tum
from saccade.datasets.drives.writing import require_writable
from saccade.diagnostics import drop_repeated
from saccade.evaluation.runs import summarize_drive
from saccade.frames import Drive
from saccade.io.files import FORMATS, results_in
from saccade.settings import load_settings
from saccade.slam import Checkpoint, Recorder
from saccade.types import Float32Array, Image, MapSnapshot
from saccade.viewing import drive_frames, map_figure, save_figures
from saccade.viewing.report_map import ObservedLandmarks
from saccade.visual import VisualConfig, VisualResult


def drive(
    source: options.SequenceOptions,
    run: options.RunOptions,
    out: options.Out = Path("saccade-drive"),
    frames: Annotated[
        int | None, Option(min=1, metavar="N", help="Process only the first N frames.")
    ] = None,
    selection: Annotated[
        str | None,
        Option(
            help="Landmark selection criterion: strength, random, range, contrast, symmetry, "
            "rematch-rate, rematch-rate-range or rematch-rate-spread."
        ),
    ] = None,
    max_landmarks: Annotated[
        int | None, Option(min=1, help="Maximum number of landmarks in the map.")
    ] = None,
    anyway: Annotated[
        bool, Option("--anyway", help="Use frames that repeat the frame before as they are.")
    ] = False,
    save_tracks: Annotated[
        Path | None,
        Option(metavar="FOLDER", help="Also write the tracked points, as a drive of tracks."),
    ] = None,
    camera: options.CameraSource = None,
    live: options.LiveWindow = False,
    page: options.LivePage = False,
    preset: options.Preset = None,
    config: options.Config = None,
    as_json: options.Json = False,
) -> None:
    """Map a camera drive: visual odometry, keypoint landmarks and EKF-SLAM.

    --out receives the trajectory (trajectory.tum, for evo; poses.csv with
    covariances; visual_odometry.csv, by the camera alone), the map
    (landmarks.csv; map.npz with descriptors), every observation of a landmark
    (observations.csv), a figure (map.png), an interactive report (report.html),
    and settings and scores (run.json); with --film a film (drive.mp4) and a
    frame of it (drive.png) too.

    An interrupted run resumes from its last checkpoint.

    With --camera a camera is mapped live, and recorded in the folder SEQUENCE,
    whose camera.toml is its calibration; Ctrl-C ends the drive.
    """
    settings = load_settings("visual", preset, config)
    given = {"selection": selection, "max_landmarks": max_landmarks}
    settings = replace(settings, **{k: v for k, v in given.items() if v is not None})
    output = run.into(out)
    if camera is not None:
        from saccade.cli.live_run import map_camera

        frames = frames or options.MAX_CAMERA_FRAMES
        filmed = options.CameraOptions(camera, frames, live, page)
        with results_in(out), progress_bar(f"camera {camera}") as progress:
            row = map_camera(filmed, source, settings, output, progress)
        print_drive(row, as_json, f"camera {camera} -> {out}")
        return
    recorded = source.load()
    if frames is not None:
        recorded = recorded.until(frames)
    if not anyway:
        recorded = drop_repeated(recorded)
    known = (*recorded.remarks, *recorded.assumptions)
    for remark in known:
        print_message(remark)
    with results_in(out), progress_bar(recorded.name) as progress:
        row = map_drive(recorded, settings, output, progress, save_tracks)
    print_drive(row, as_json, f"{recorded.name} -> {out}", len(known))


def print_drive(row: dict[str, Any], as_json: bool, title: str, said: int = 0) -> None:
    """Print the remarks of a drive after those that were said before, and its figures."""
    for remark in row["remarks"][said:]:
        print_message(remark)
    tables = [] if row["ate_m"] is None else [_error_table(row, title)]
    facts = {
        "frames": str(row["frames"]),
        "landmarks": str(row["landmarks"]),
        "observations": str(row["observations"]),
        "re-identifications": str(row["reidentified"]),
        "ms per frame": f"{row['ms_per_frame']:.1f}",
        **{f"  {step}": f"{value:.1f}" for step, value in row["ms"].items()},
    }
    if row["self_calibration"] is not None:
        facts |= calibration_facts(row["self_calibration"])
    if row["lost"]:
        facts["lost"] = lost_text(row["lost"])
    if row["association_precision"] is not None:
        facts["association precision"] = f"{row['association_precision']:.1%}"
    emit(row, as_json, *tables, Table("" if tables else title, ["", ""], [*facts.items()]))


def calibration_facts(report: dict[str, Any]) -> dict[str, str]:
    """What was corrected of the calibration, and what no image tells, with their labels."""
    units = {"distortion": "", "disparity_slope": " px", "disparity_offset": " px"}
    facts = {
        name.replace("_", " "): f"{report[name]:.3f}{unit} (sigma {sigma:.3f})"
        for (name, unit), sigma in zip(units.items(), report["sigma"], strict=True)
    }
    if report["scale_by_offset"] > 0:
        by_tenth = 10 * report["scale_by_offset"]
        facts["scale"] = f"hangs on the baseline; {by_tenth:.1f} % a tenth of a pixel of disparity"
    return facts


def _error_table(row: dict[str, Any], title: str) -> Table:
    """Errors of the trajectories."""
    columns = {
        "ate_m": "ATE (m)",
        "ate_unaligned_m": "unaligned (m)",
        "rpe_m": "RPE (m)",
        "end_m": "at the end (m)",
        "inside_3sigma": "in 99.7 % ellipse",
    }
    trajectories = {"SLAM": row, "odometry": row["odometry"], "egomotion": row["visual_odometry"]}
    cells = [
        [name, *("" if (v := errors.get(c)) is None else f"{v:.3f}" for c in columns)]
        for name, errors in trajectories.items()
        if errors["ate_m"] is not None
    ]
    return Table(title, ["", *columns.values()], cells)


LEAD = "The trajectory of a robot and the map of its landmarks, from camera frames and odometry."


def map_drive(
    drive: Drive,
    settings: VisualConfig,
    output: RunOutput,
    progress: Progress,
    save_tracks: Path | None = None,
) -> dict[str, Any]:
    """Map a drive, write the results, and return the content of run.json.

    The tracked points are written to a folder `save_tracks`.
    """
    tracks = None
    if save_tracks is not None:
        require_writable(save_tracks, drive)
        tracks = visual.TrackRecorder()
    recorder = Recorder(output.snapshots)
    checkpoint = Checkpoint(output.folder / "checkpoint.npz", output.checkpoint_interval)

    def report(done: int, total: int) -> None:
        progress(done, total, "map")

    with resumable(checkpoint.path), visual.dedicated_process():
        result = visual.run(
            *(drive, settings, report),
            recorder=recorder,
            checkpoint=checkpoint,
            tracks=tracks,
        )
    row = write_results(drive, settings, output, progress, result, recorder.snapshots)
    if save_tracks is not None and tracks is not None:
        save_drive(save_tracks, tracks.drive(drive))
    checkpoint.remove()
    return row


def write_results(
    drive: Drive,
    settings: VisualConfig,
    output: RunOutput,
    progress: Progress,
    result: VisualResult,
    snapshots: list[MapSnapshot],
) -> dict[str, Any]:
    """Write the results of a mapped drive, and return the content of run.json."""
    out = output.folder
    files = write_tables(out, result) | write_figure(output, drive, result)
    if output.film:
        frames = film_frames(drive, snapshots, result, settings)
        count = len(snapshots)
        files |= write_film(out / "drive.mp4", frames, count, progress, still=60 * count // 100)
    summary = summarize_drive(drive, result)
    row = {
        **summary,
        "scale": drive.scale,
        "remarks": [*drive.remarks, *drive.assumptions, *result.remarks],
        "seed": settings.seed,
        "settings": asdict(settings),
    }
    return write_run(
        output,
        (f"saccade drive: {drive.name}", LEAD),
        lambda: drive_part(drive, snapshots, result, summary),
        files,
        row,
    )


def write_tables(out: Path, result: VisualResult) -> dict[str, Path]:
    """Write trajectory, map and observations; returns the files."""
    files = {
        "trajectory": out / "trajectory.tum",
        "poses": out / "poses.csv",
        "visual_odometry": out / "visual_odometry.csv",
        "landmarks": out / "landmarks.csv",
        "map": out / "map.npz",
        "observations": out / "observations.csv",
    }
    write_tum(files["trajectory"], result.trajectory)
    write_table(files["poses"], pose_table(result.trajectory))
    write_table(files["visual_odometry"], pose_table(result.visual_odometry))
    write_landmarks(files["landmarks"], result.map)
    write_arrays(
        files["map"],
        {
            "format": FORMATS["map"],
            "id": result.map.id,
            "xy": result.map.xy,
            "covariance": result.map.covariance,
            "height": result.height,
            "descriptors": result.descriptors,
        },
    )
    observed = result.observations
    columns: dict[str, np.ndarray[Any, Any]] = {
        "frame": observed.frame,
        "landmark": observed.landmark,
        "kind": observed.kind,
        "pixel_x": observed.xy[:, 0],
        "pixel_y": observed.xy[:, 1],
        "z_range": observed.z[:, 0],
        "z_bearing": observed.z[:, 1],
        "sigma_range": observed.sigma[:, 0],
        "sigma_bearing": observed.sigma[:, 1],
    }
    write_table(files["observations"], columns)
    return files


def write_figure(output: RunOutput, drive: Drive, result: VisualResult) -> dict[str, Path]:
    """Write a figure of the map; returns the file of the first format."""
    odometry = result.odometry if drive.has_odometry else None
    figure = map_figure(
        result.trajectory, result.map, odometry, truth=drive.truth, lost=result.lost
    )
    if drive.scale != "metric":
        axes = figure.axes[0]
        axes.set_xlabel("x in units (the scale is unknown)")
        axes.set_ylabel("y in units")
    return {"picture": save_figures(figure, output.folder / "map", output.figures)}


def film_frames(
    drive: Drive,
    snapshots: list[MapSnapshot],
    result: VisualResult,
    settings: VisualConfig,
) -> Iterator[Image]:
    """Frames of a film: the camera image with landmarks and saliency, and the growing map."""

    def saliency(image: Image) -> Float32Array:
        if settings.selection == "contrast":
            return contrast_saliency(image).saliency
        if settings.selection == "symmetry":
            return symmetry_saliency(image).saliency
        return attention_saliency(image).saliency

    observed = result.observations
    observations = ObservedLandmarks(observed.frame, observed.landmark, observed.xy, observed.kind)
    odometry = result.odometry if drive.has_odometry else None
    return drive_frames(
        *(snapshots, drive.time, odometry, image_loader(drive), saliency, observations),
        eye_at=eye_loader(drive),
    )
