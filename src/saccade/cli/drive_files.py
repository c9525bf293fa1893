"""What `saccade drive` writes."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from saccade.frames import Drive
    from saccade.types import Float32Array, Image, MapSnapshot, Trajectory
    from saccade.visual import VisualConfig, VisualResult

FILM_RATE = 24
"""Frames per second."""
STILL = 60
"""Per cent of the film after which a still is taken."""


def write_tables(out: Path, result: "VisualResult") -> dict[str, Path]:
    """Trajectory, map and sightings; returns where each is."""
    from saccade.cli.output import write_arrays
    from saccade.cli.slam_files import pose_table
    from saccade.datasets import write_landmarks, write_table, write_tum
    from saccade.formats import FORMATS

    files = {
        "trajectory": out / "trajectory.tum",
        "poses": out / "poses.csv",
        "landmarks": out / "landmarks.csv",
        "map": out / "map.npz",
        "sightings": out / "sightings.csv",
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
    seen = result.observations
    columns: dict[str, np.ndarray[Any, Any]] = {
        "frame": seen.frame,
        "landmark": seen.landmark,
        "kind": seen.kind,
    }
    for name, values in (("pixel", seen.xy), ("z", seen.z), ("sigma", seen.sigma)):
        first, second = ("x", "y") if name == "pixel" else ("range", "bearing")
        columns |= {f"{name}_{first}": values[:, 0], f"{name}_{second}": values[:, 1]}
    write_table(files["sightings"], columns)
    return files


def write_pictures(out: Path, drive: "Drive", result: "VisualResult") -> dict[str, Path]:
    """The map from above; returns where it is."""
    from saccade.viewing import map_figure, save_figure

    files = {"picture": out / "map.png"}
    save_figure(
        map_figure(result.trajectory, result.map, result.odometry, truth=drive.truth),
        files["picture"],
    )
    return files


def pictures_of(drive: "Drive") -> "Callable[[int], Image | None]":
    """What gives the picture of a frame, or None where there is none."""
    from saccade.errors import ImageError

    def picture(number: int) -> "Image | None":
        try:
            return drive.load(number).image
        except ImageError:
            return None

    return picture


def write_film(
    path: Path,
    drive: "Drive",
    snapshots: "list[MapSnapshot]",
    result: "VisualResult",
    settings: "VisualConfig",
    progress: Callable[[int, int], None],
) -> dict[str, Path]:
    """What the camera sees and the map of it, as an MP4 and a still; returns where each is."""
    from PIL import Image as Pillow

    from saccade.attention.combined import attention_saliency
    from saccade.attention.contrast import contrast_saliency
    from saccade.attention.symmetry import symmetry_saliency
    from saccade.files import atomic_write
    from saccade.video import video_writer
    from saccade.viewing.drive_film import drive_frames
    from saccade.viewing.report_map import ObservedLandmarks

    def attention(image: "Image") -> "Float32Array":
        if settings.selection == "contrast":
            return contrast_saliency(image).saliency
        if settings.selection == "symmetry":
            return symmetry_saliency(image).saliency
        return attention_saliency(image).saliency

    seen = result.observations
    observed = ObservedLandmarks(seen.frame, seen.landmark, seen.xy, seen.kind)
    frames = drive_frames(
        snapshots, drive.time, result.odometry, pictures_of(drive), attention, observed
    )
    files = {"film": path, "still": path.with_suffix(".png")}
    with video_writer(path, FILM_RATE) as write:
        for number, frame in enumerate(frames):
            write(frame)
            if number == STILL * len(snapshots) // 100:
                with atomic_write(files["still"]) as temporary:
                    Pillow.fromarray(frame).save(temporary, format="PNG")
            progress(min(number + 1, len(snapshots)), len(snapshots))
    return files


def summary(drive: "Drive", result: "VisualResult") -> dict[str, Any]:
    """What a drive says of itself in numbers; distances from the truth where that is known."""
    import numpy as np

    from saccade.evaluation.drives import same_places
    from saccade.visual import ObservationKind

    n, seen = len(result.trajectory), result.observations
    precision = None
    if drive.truth is not None and (seen.kind == ObservationKind.REIDENTIFIED).any():
        poses = drive.truth.at(drive.time)
        right = same_places(seen.frame, seen.landmark, seen.z, seen.sigma, poses)
        precision = float(right[seen.kind == ObservationKind.REIDENTIFIED].mean())
    return {
        "sequence": drive.name,
        "frames": n,
        **_scored(result.trajectory, drive.truth),
        "odometry": _scored(result.odometry, drive.truth),
        "visual_odometry": _scored(result.visual_odometry, drive.truth),
        "association_precision": precision,
        "landmarks": len(result.map),
        "landmarks_seen": len(np.unique(seen.landmark)),
        "sightings": len(seen),
        "recognized": int((seen.kind == ObservationKind.REIDENTIFIED).sum()),
        "missed": result.missed,
        "ms_per_frame": 1000 * float(result.frame_seconds.mean()),
        "ms": {step: 1000 * seconds / n for step, seconds in result.seconds.items()},
    }


def _scored(estimate: "Trajectory", truth: "Trajectory | None") -> dict[str, float | None]:
    from dataclasses import asdict

    from saccade.cli.slam_files import finite
    from saccade.evaluation.drives import score_drive

    if truth is None:
        return dict.fromkeys(("ate_m", "rpe_m", "end_m", "inside_3sigma"))
    return {name: finite(value) for name, value in asdict(score_drive(estimate, truth)).items()}
