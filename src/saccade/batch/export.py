"""Exports extracted points for other programs."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np

from saccade.batch.dataset import ImageKeypoints, read_points
from saccade.batch.tables import DESCRIPTOR_SIZE
from saccade.errors import KeypointsError, OutputError
from saccade.exchange import to_opencv, write_colmap, write_csv, write_hdf5
from saccade.exchange.fields import check_name
from saccade.io.files import atomic_write
from saccade.types import Keypoints

WriteImage: TypeAlias = Callable[[Path, ImageKeypoints], None]
WriteAll: TypeAlias = Callable[[Path, Mapping[str, Keypoints], dict[str, tuple[int, ...]]], None]


class FileFormat(NamedTuple):
    """A format with one file for all images."""

    default_name: str
    """Of the file."""
    write: WriteAll


class FolderFormat(NamedTuple):
    """A format with a file for each image, in a folder."""

    default_name: str
    """Of the folder."""
    suffix: str
    write: WriteImage


def export_points(location: str, to: str, out: Path) -> int:
    """Write the points of a data set in another format.

    Args:
        location: folder or URL of the data set.
        to: one of `EXPORTS`.
        out: the file, or folder, to write.

    Returns:
        Number of images.

    Raises:
        ConfigError: the data set holds no points, or a library is not installed.
        OutputError: it cannot be written.
    """
    target = EXPORTS[to]
    if isinstance(target, FileFormat):
        images = list(read_points(location))
        points = {image.image: image.points for image in images}
        target.write(out, points, {image.image: image.shape for image in images})
        return len(images)
    count = 0
    for image in read_points(location):
        if ".." in Path(check_name(image.image)).parts:
            raise KeypointsError(f"{image.image}: would be written outside {out}")
        target.write(out / f"{image.image}{target.suffix}", image)
        count += 1
    return count


def _write_csv(path: Path, image: ImageKeypoints) -> None:
    write_csv(path, image.points)


def _write_opencv(path: Path, image: ImageKeypoints) -> None:
    keypoints, descriptors = to_opencv(image.points)
    rows = [[*p.pt, p.size, p.angle, p.response, p.octave, p.class_id] for p in keypoints]
    with atomic_write(path) as temporary:
        file = cv2.FileStorage(str(temporary), cv2.FILE_STORAGE_WRITE)
        if not file.isOpened():
            raise OutputError(f"{path}: cannot be written by OpenCV")
        file.write("keypoints", np.array(rows, np.float64).reshape(-1, 7))
        file.write(
            "descriptors", np.zeros((0, DESCRIPTOR_SIZE)) if descriptors is None else descriptors
        )
        file.release()


EXPORTS: dict[str, FileFormat | FolderFormat] = {
    "colmap": FileFormat("database.db", write_colmap),
    "hdf5": FileFormat("keypoints.h5", write_hdf5),
    "opencv": FolderFormat("opencv", ".yml.gz", _write_opencv),
    "csv": FolderFormat("csv", ".csv", _write_csv),
}
