"""Reads and writes data sets of `extract`; exports their points."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from saccade.batch.job import MAPS, SCANPATH, Job
from saccade.batch.storage import Store
from saccade.errors import ConfigError, KeypointsError
from saccade.exchange import write_colmap, write_hdf5
from saccade.exchange.arrow import points_of, read_metadata, read_rows, schema_in
from saccade.io.files import LARGEST_TEXT, check_format, reading
from saccade.types import Keypoints

MANIFEST = "manifest.json"
SUFFIX = ".parquet"


@dataclass(frozen=True)
class ImageRecord:
    """An image that was processed."""

    image: str
    """Its name."""
    content: str
    """Hash of its content: BLAKE2b, 128 bits."""
    stamp: str
    """Size and modification time of its file."""
    width: int
    height: int
    rows: int
    """Number of its rows in the table."""
    seconds: float
    """Processing time."""
    job: str
    """Fingerprint of the settings."""
    version: str
    """Version of saccade."""
    orientation: int = 1
    """EXIF orientation of the file, 1 to 8."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value: Any = getattr(self, field.name)
            if type(value) is not field.type or (field.type is int and value < 0):
                raise ValueError(f"{field.name} of an image: found {value!r}")
        if self.orientation not in range(1, 9):
            raise ValueError(f"orientation of an image: found {self.orientation}")


class ImageKeypoints(NamedTuple):
    """The keypoints of an image."""

    image: str
    shape: tuple[int, int]
    """(H, W), upright."""
    points: Keypoints
    orientation: int
    """EXIF orientation of the file."""


def read_points(location: str) -> Iterator[ImageKeypoints]:
    """The keypoints of every image of a data set; one file at a time is in memory.

    Args:
        location: folder or URL of the data set.

    Raises:
        ConfigError: there is no data set, or it holds no points.
        KeypointsError: one of its files is broken.
    """
    store = Store(location)
    manifest = read_manifest(store)
    if manifest is None or manifest["what"] in (*MAPS, SCANPATH):
        found = f"no {MANIFEST}" if manifest is None else manifest["what"]
        raise ConfigError(f"{location}: expected extracted points, found {found}")
    for file in block_files(store, Job(manifest["what"]).folder):
        yield from read_block_points(store, file)


def read_block_points(store: Store, file: str) -> list[ImageKeypoints]:
    """The keypoints of the images in a file.

    Raises:
        KeypointsError: the file is broken.
    """
    path = f"{store.location}/{file}"
    records, table = read_block(store, file, schema_in)
    points = points_of(path, table, [record.rows for record in records])
    found = []
    for record, each in zip(records, points, strict=True):
        if min(record.width, record.height) < 1:
            size = f"{record.width} x {record.height}"
            raise KeypointsError(
                f"{path}: {record.image}: expected an image of a size, found {size}"
            )
        shape = record.height, record.width
        found.append(ImageKeypoints(record.image, shape, each, record.orientation))
    return found


def read_manifest(store: Store) -> dict[str, Any] | None:
    """The kind of features and the settings of a data set; None where there is no data set.

    Raises:
        ConfigError: the manifest is broken, or of a later version of saccade.
    """
    path = f"{store.location}/{MANIFEST}"
    foreign = (ValueError, TypeError, RecursionError)
    with (
        reading(path, ConfigError, "settings of `saccade extract`", *foreign),
        suppress(FileNotFoundError),
        store.open(MANIFEST) as file,
    ):
        manifest = dict(json.loads(file.read(LARGEST_TEXT)))
        check_format("extraction", manifest.get("format"), path, ConfigError)
        if not isinstance(manifest.get("what"), str) or "settings" not in manifest:
            raise ValueError("found other names")
        return manifest
    return None


def block_files(store: Store, folder: str) -> list[str]:
    """The Parquet files in a folder of a data set."""
    return [name for name in store.list_files(folder) if name.endswith(SUFFIX)]


def no_columns(file: pq.ParquetFile) -> pa.Schema:
    """A schema without columns."""
    return pa.schema([])


def all_columns(file: pq.ParquetFile) -> pa.Schema:
    """The schema of a file."""
    return file.schema_arrow.remove_metadata()


def read_block(
    store: Store, file: str, schema: Callable[[pq.ParquetFile], pa.Schema] = no_columns
) -> tuple[list[ImageRecord], pa.Table]:
    """The images of a file, and its columns.

    Args:
        store: the data set.
        file: name of the file.
        schema: function from the opened file to the columns that are read.

    Raises:
        KeypointsError: the file is broken, or something else.
    """
    path = f"{store.location}/{file}"
    foreign = (pa.ArrowException, ValueError, TypeError, RecursionError)
    with (
        reading(path, KeypointsError, "a table of `saccade extract`", *foreign),
        store.open(file) as opened,
        pq.ParquetFile(opened) as parquet,
    ):
        images = read_metadata(parquet, path)["images"]
        table = read_rows(parquet, opened.seek(0, os.SEEK_END), schema(parquet))
        return [ImageRecord(**image) for image in images], table


EXPORTS: dict[str, Callable[..., None]] = {"colmap": write_colmap, "hdf5": write_hdf5}
"""Writers of other formats, one file for all images."""


def export_points(location: str, to: str, out: Path) -> int:
    """Writes the points of a data set in another format.

    Args:
        location: folder or URL of the data set.
        to: one of `EXPORTS`.
        out: the file to write.

    Returns:
        Number of images.

    Raises:
        ConfigError: the data set holds no points, or a library is not installed.
        OutputError: it cannot be written.
    """
    images = {image.image: image for image in read_points(location)}
    points = {name: image.points for name, image in images.items()}
    shapes = {name: image.shape for name, image in images.items()}
    turned = {name: image.orientation for name, image in images.items()}
    EXPORTS[to](out, points, shapes, orientations=turned)
    return len(images)
