"""Keypoints of images, written to files."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from saccade import exchange
from saccade.cli.detect import Format
from saccade.cli.symmetry_overlay import contributing_pairs
from saccade.exchange.colmap import import_pycolmap
from saccade.extras import import_optional
from saccade.files import as_text
from saccade.image import read_image
from saccade.keypoints import Must
from saccade.types import Keypoints, Regions
from saccade.viewing import keypoint_figure, pair_figure, region_figure, save_figure

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
    """Detect in one image: write `out`.png and its files, return the row for --json."""
    image = read_image(path)
    detections = detector(image)
    regions = isinstance(detections, Regions)
    keypoints = detections.keypoints if regions else detections
    figure = region_figure(image, detections) if regions else keypoint_figure(image, keypoints)
    row: dict[str, Any] = {
        "image": str(path),
        "points": len(keypoints),
        "median_size": float(np.median(keypoints.size)) if len(keypoints) else 0.0,
        "picture": str(save_figure(figure, f"{out}.png")),
    }
    if regions:
        row["boxes"] = detections.boxes.tolist()
    if regions or isinstance(detector, Must):
        pairs = contributing_pairs(detector, image, keypoints[:MAX_EXPLAINED])
        picture = out.with_name(f"{out.name.removesuffix('.keypoints')}.pairs.png")
        row["pairs"] = str(save_figure(pair_figure(image, pairs), picture))
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


def relative_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Each path relative to the common folder, as COLMAP and hloc name images."""
    if not paths:
        return {}
    absolute = [path.absolute() for path in paths]
    root = os.path.commonpath([path.parent for path in absolute])
    return {
        path: as_text(each.relative_to(root).as_posix())
        for path, each in zip(paths, absolute, strict=True)
    }
