"""Extracted points for other programs, image by image: no more of them in memory than a shard."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from saccade.batch.job import POINTS
from saccade.batch.manifest import read_manifest, record_files
from saccade.batch.shards import read_record, read_rows
from saccade.batch.store import Store, open_store
from saccade.batch.tables import ENTRIES, point_schema
from saccade.errors import ConfigError, KeypointsError, OutputError
from saccade.exchange import to_opencv, write_colmap, write_csv, write_hdf5
from saccade.exchange.fields import check_name
from saccade.files import atomic_write
from saccade.types import Keypoints


class ImageKeypoints(NamedTuple):
    """The points of an image."""

    image: str
    shape: tuple[int, int]
    """(H, W)."""
    points: Keypoints


def read_points(place: str) -> Iterator[ImageKeypoints]:
    """The points of every image of a data set, shard by shard.

    Args:
        place: folder or URL of the data set.

    Raises:
        ConfigError: there is none, or it holds no points.
    """
    store = open_store(place)
    manifest = read_manifest(store)
    if manifest is None or manifest["what"] not in POINTS:
        found = "no manifest.json" if manifest is None else manifest["what"]
        raise ConfigError(f"{place}: expected extracted points, found {found}")
    for file in record_files(store):
        yield from _shard(store, manifest["what"], file)


def export_points(place: str, to: str, out: Path) -> int:
    """Write a data set of points in another format.

    Args:
        place: folder or URL of the data set.
        to: one of `EXPORTS`.
        out: the file, or folder, to write.

    Returns:
        How many images were written.

    Raises:
        ConfigError: the data set holds no points, or a library is not installed.
        OutputError: it cannot be written.
    """
    return EXPORTS[to].write(place, out)


class Export(NamedTuple):
    """A format."""

    name: str
    """Of the file or folder, where none is given."""
    write: Callable[[str, Path], int]


def _shard(store: Store, what: str, file: str) -> Iterator[ImageKeypoints]:
    table = read_rows(store, f"{what}/{file}", point_schema(boxes=False))
    xy = np.stack([table["x"].to_numpy(), table["y"].to_numpy()], axis=1)
    packed = table["descriptor"].combine_chunks()
    descriptors = np.frombuffer(packed.buffers()[1] or b"", np.uint8).reshape(-1, ENTRIES)
    points = Keypoints(
        xy,
        table["size"].to_numpy(),
        table["angle"].to_numpy(),
        table["response"].to_numpy(),
        table["octave"].to_numpy().astype(np.int32),
        descriptors[: len(xy)],
    )
    record, first = read_record(store, file), 0
    if sum(record["rows"].to_pylist()) != len(xy):
        raise KeypointsError(f"{what}/{file}: expected the rows of its record, found {len(xy)}")
    for row in record.to_pylist():
        rows = slice(first, first + row["rows"])
        first = rows.stop
        if row["error"] is None:
            shape = (row["height"] or 0, row["width"] or 0)
            if min(shape) < 1:
                raise KeypointsError(f"{row['image']}: expected an image of a size, found {shape}")
            yield ImageKeypoints(row["image"], shape, points[rows])


def _together(write: Callable[[Path, Mapping[str, Keypoints], dict[str, Any]], None]) -> Any:
    def export(place: str, out: Path) -> int:
        found = list(read_points(place))
        points = {each.image: each.points for each in found}
        write(out, points, {each.image: each.shape for each in found})
        return len(found)

    return export


def _apart(suffix: str, write: Callable[[Path, ImageKeypoints], None]) -> Any:
    def export(place: str, out: Path) -> int:
        count = 0
        for each in read_points(place):
            if ".." in Path(check_name(each.image)).parts:
                raise KeypointsError(f"{each.image}: would be written outside {out}")
            write(out / f"{each.image}{suffix}", each)
            count += 1
        return count

    return export


def _write_opencv(path: Path, extracted: ImageKeypoints) -> None:
    keypoints, descriptors = to_opencv(extracted.points)
    rows = [
        [*each.pt, each.size, each.angle, each.response, each.octave, each.class_id]
        for each in keypoints
    ]
    with atomic_write(path) as temporary:
        file = cv2.FileStorage(str(temporary), cv2.FILE_STORAGE_WRITE)
        if not file.isOpened():
            raise OutputError(f"{path}: cannot be written by OpenCV")
        file.write("keypoints", np.array(rows, np.float64).reshape(-1, 7))
        file.write("descriptors", np.zeros((0, ENTRIES)) if descriptors is None else descriptors)
        file.release()


EXPORTS = {
    "colmap": Export("database.db", _together(write_colmap)),
    "hdf5": Export("keypoints.h5", _together(write_hdf5)),
    "opencv": Export("opencv", _apart(".yml.gz", _write_opencv)),
    "csv": Export("csv", _apart(".csv", lambda path, each: write_csv(path, each.points))),
}
"""The formats by their names."""
