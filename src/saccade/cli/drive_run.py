"""Maps a camera drive and writes the results."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from saccade import visual
from saccade.attention import attention_saliency, contrast_saliency, symmetry_saliency
from saccade.cli.drive_report import drive_part, eye_loader, image_loader
from saccade.cli.output import Progress, resumable, write_arrays
from saccade.cli.run_output import RunOutput, write_film, write_run
from saccade.cli.slam_run import pose_table
from saccade.datasets import save_drive, write_landmarks, write_table, write_tum
from saccade.datasets.drives.writing import require_writable
from saccade.evaluation.drives import summarize_drive
from saccade.frames import Drive
from saccade.io.formats import FORMATS
from saccade.slam import Checkpoint, Recorder
from saccade.types import Float32Array, Image, MapSnapshot
from saccade.viewing import drive_frames, map_figure, save_figures
from saccade.viewing.report_map import ObservedLandmarks
from saccade.visual import VisualConfig, VisualResult

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
        "landmarks": out / "landmarks.csv",
        "map": out / "map.npz",
        "observations": out / "observations.csv",
    }
    write_tum(files["trajectory"], result.trajectory)
    write_table(files["poses"], pose_table(result.trajectory))
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
    figure = map_figure(
        result.trajectory, result.map, result.odometry, truth=drive.truth, lost=result.lost
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
    return drive_frames(
        *(snapshots, drive.time, result.odometry, image_loader(drive), saliency, observations),
        eye_at=eye_loader(drive),
    )
