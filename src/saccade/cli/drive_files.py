"""Tables, figures and film frames of `saccade drive`."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from saccade.frames import Drive
    from saccade.types import Float32Array, Image, MapSnapshot
    from saccade.visual import VisualConfig, VisualResult


def write_tables(out: Path, result: "VisualResult") -> dict[str, Path]:
    """Write trajectory, map and observations; returns the files."""
    from saccade.cli.output import write_arrays
    from saccade.cli.slam_files import pose_table
    from saccade.datasets import write_landmarks, write_table, write_tum
    from saccade.formats import FORMATS

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


def write_figure(out: Path, drive: "Drive", result: "VisualResult") -> dict[str, Path]:
    """Write a figure of the map; returns the file."""
    from saccade.viewing import map_figure, save_figure

    figure = map_figure(result.trajectory, result.map, result.odometry, truth=drive.truth)
    save_figure(figure, out / "map.png")
    return {"picture": out / "map.png"}


def image_loader(drive: "Drive") -> "Callable[[int], Image | None]":
    """A function from the number of a frame to its image, or None where that cannot be read."""
    from saccade.errors import ImageError

    def load(number: int) -> "Image | None":
        try:
            return drive.load(number).image
        except ImageError:
            return None

    return load


def film_frames(
    drive: "Drive",
    snapshots: "list[MapSnapshot]",
    result: "VisualResult",
    settings: "VisualConfig",
) -> "Iterator[Image]":
    """Frames of a film: the camera image with landmarks and saliency, and the growing map."""
    from saccade.attention import attention_saliency, contrast_saliency, symmetry_saliency
    from saccade.viewing import drive_frames

    def saliency(image: "Image") -> "Float32Array":
        if settings.selection == "contrast":
            return contrast_saliency(image).saliency
        if settings.selection == "symmetry":
            return symmetry_saliency(image).saliency
        return attention_saliency(image).saliency

    observed = result.observations
    observations = (observed.frame, observed.kind, observed.xy)
    return drive_frames(
        snapshots, drive.time, result.odometry, image_loader(drive), saliency, observations
    )
