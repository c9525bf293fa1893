"""Keypoints of images from a file of features, in place of a detector."""

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from saccade.errors import ConfigError, KeypointsError
from saccade.exchange import read_colmap, read_hdf5
from saccade.exchange.hdf5 import names_in
from saccade.exchange.orientation import upright_keypoints
from saccade.keypoints.detectors import inside
from saccade.types import BoolArray, Image, Keypoints

DATABASE = ".db"
"""Suffix of COLMAP's databases; all other files are HDF5."""


def read_stored(path: Path, names: Collection[str]) -> Mapping[str, Keypoints]:
    """The keypoints of images in a file, by name; images that are not in it are left out.

    Args:
        path: HDF5 as `write_hdf5` and hloc write it, or a database of COLMAP.
        names: of the images.

    Raises:
        KeypointsError: the file is missing, or has another format.
        ConfigError: h5py is not installed.
    """
    if path.suffix.lower() != DATABASE:
        return read_hdf5(path, names)
    return read_colmap(path, names).keypoints


def check_stored(path: Path, names: Collection[str]) -> None:
    """Validates a file of features for images.

    Raises:
        KeypointsError: the file is missing, or has another format.
        ConfigError: it has none of the images, or h5py is not installed.
    """
    is_database = path.suffix.lower() == DATABASE
    known = [*read_colmap(path, ()).shapes] if is_database else names_in(path)
    if not {*known} & {*names}:
        example = f"such as {known[0]!r}" if known else "none"
        raise ConfigError(
            f"{path}: expected keypoints of images such as {min(names)!r}, found {example}"
        )


def stored_points(
    stored: Mapping[str, Keypoints],
    name: str,
    image: Image,
    orientation: int,
    mask: BoolArray | None,
) -> Keypoints:
    """The keypoints of an image, upright, with descriptors, where a mask is set.

    Args:
        stored: keypoints in stored pixels, by name.
        name: of the image.
        image: upright.
        orientation: EXIF orientation of its file.
        mask: (H, W), upright; None for the whole image.

    Raises:
        KeypointsError: no keypoints, some outside the image, or none with descriptors.
    """
    if name not in stored:
        raise KeypointsError(f"{name}: expected keypoints in the file of features, found none")
    points = stored[name]
    if points.descriptors is None:
        raise KeypointsError(f"{name}: expected descriptors in the file of features, found none")
    invalid = ~np.isfinite(points.descriptors).all(axis=1)
    if invalid.any():
        row = int(np.argmax(invalid))
        raise KeypointsError(
            f"{name}: expected finite descriptors, found NaN or infinity in row {row}"
        )
    points = upright_keypoints(points, image.shape, orientation)
    height, width = image.shape[:2]
    outside = ~((points.xy >= -1) & (points.xy <= [width, height])).all(axis=1)
    if outside.any():
        x, y = points.xy[int(np.argmax(outside))]
        raise KeypointsError(
            f"{name}: expected keypoints in {width} x {height} pixels, found ({x:.1f}, {y:.1f}); "
            "the features are of another image or size"
        )
    return points if mask is None else points[inside(points.xy, mask, image)]


def stamp_of_file(path: Path) -> str:
    """Size and modification time of a file of features.

    Raises:
        ConfigError: the file cannot be read.
    """
    try:
        status = path.stat()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    return f"{status.st_size} {status.st_mtime_ns}"
