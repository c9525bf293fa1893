"""Keypoints of images, written to files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from saccade import exchange
from saccade.cli.detect import Format
from saccade.cli.options import figure_formats
from saccade.cli.output import relative_names
from saccade.cli.symmetry_overlay import contributing_pairs
from saccade.exchange.colmap import import_pycolmap
from saccade.extras import import_optional
from saccade.io.image import read_image
from saccade.keypoints import Must
from saccade.types import Keypoints, Regions
from saccade.viewing import keypoint_figure, pair_figure, region_figure, save_figures

Detections: TypeAlias = tuple[Keypoints, tuple[int, ...]]
"""The keypoints of an image, and its shape."""

MAX_EXPLAINED = 20
"""Number of the strongest points whose symmetric pairs are drawn."""
SHARED_FILES = {
    Format.PARQUET: "keypoints.parquet",
    Format.HDF5: "keypoints.h5",
    Format.COLMAP: "database.db",
}
"""Formats that hold the keypoints of all images, and the names of the files."""


def require_libraries(formats: Sequence[Format]) -> None:
    """Import the libraries of the formats, to fail before any work is done."""
    if Format.COLMAP in formats:
        import_pycolmap()
    if Format.HDF5 in formats:
        import_optional("h5py", Format.HDF5)
    if Format.PARQUET in formats:
        import_optional("pyarrow", Format.PARQUET)


def detect_in(
    path: Path, out: Path, detector: Any, formats: Sequence[Format]
) -> tuple[dict[str, Any], Detections]:
    """Detect in one image: write the figure `out`.png and its files, return the row for --json."""
    image = read_image(path)
    detections = detector(image)
    regions = isinstance(detections, Regions)
    keypoints = detections.keypoints if regions else detections
    figure = region_figure(image, detections) if regions else keypoint_figure(image, keypoints)
    drawn = figure_formats(formats)
    row: dict[str, Any] = {
        "image": str(path),
        "points": len(keypoints),
        "median_size": float(np.median(keypoints.size)) if len(keypoints) else 0.0,
        "picture": str(save_figures(figure, out, drawn)),
    }
    if regions:
        row["boxes"] = detections.boxes.tolist()
    if regions or isinstance(detector, Must):
        pairs = contributing_pairs(detector, image, keypoints[:MAX_EXPLAINED])
        picture = out.with_name(f"{out.name.removesuffix('.keypoints')}.pairs")
        row["pairs"] = str(save_figures(pair_figure(image, pairs), picture, drawn))
    if Format.NPZ in formats:
        row["arrays"] = f"{out}.npz"
        exchange.write_npz(row["arrays"], keypoints)
    if Format.CSV in formats:
        row["table"] = f"{out}.csv"
        exchange.write_csv(row["table"], keypoints)
    return row, (keypoints, image.shape)


def write_shared(
    detections: Mapping[Path, Detections], out: Path, formats: Sequence[Format]
) -> dict[str, str]:
    """Write the keypoints of all images in one file for each format; return the paths."""
    names = relative_names(list(detections))
    keypoints = {names[path]: each for path, (each, _) in detections.items()}
    shapes = {names[path]: shape for path, (_, shape) in detections.items()}
    files = {str(each): str(out / SHARED_FILES[each]) for each in formats}
    if Format.PARQUET in formats:
        exchange.write_parquet(files["parquet"], keypoints)
    if Format.HDF5 in formats:
        exchange.write_hdf5(files["hdf5"], keypoints, shapes)
    if Format.COLMAP in formats:
        exchange.write_colmap(files["colmap"], keypoints, shapes)
    return files
