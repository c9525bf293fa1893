"""Saliency maps: float16 in one Zarr archive per shard, or one 16-bit PNG per image."""

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import prod
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
import pyarrow as pa

from saccade.batch.job import MAPS, Job
from saccade.batch.store import Store
from saccade.errors import KeypointsError, OutputError, SaccadeError
from saccade.extras import import_optional
from saccade.io.files import LARGEST_IMAGE, one_line
from saccade.io.image import decode_stored, size_in_header
from saccade.types import Float32Array

FOLDER = "maps"
PNG_MAXIMUM = 65535
"""Pixel of a PNG that stands for 1."""

AddMap: TypeAlias = Callable[[str, Float32Array], tuple[str, str]]
"""Writes the map of an image, by its name; gives the file and the array in it, "" for a PNG."""


@contextmanager
def map_writer(job: Job, store: Store, shard: str) -> Iterator[AddMap]:
    """A function that writes the maps of a shard; it must not be called where a job has none.

    Raises:
        OutputError: they cannot be written.
        ConfigError: zarr is asked for and not installed.
    """
    if job.what not in MAPS:
        yield _no_map
    elif job.maps == "png":
        yield partial(_write_png, store, shard)
    else:
        zarr = import_optional("zarr", "zarr")
        file = f"{FOLDER}/part-{shard}.zarr.zip"
        with store.writing(file) as path, _archive(zarr, path, "w") as archive:
            group = zarr.create_group(archive)

            def add(name: str, values: Float32Array) -> tuple[str, str]:
                group.create_array(name, data=values.astype(np.float16), chunks=values.shape)
                return file, name

            yield add


def read_map(store: Store, row: pa.Table) -> Float32Array:
    """The map of a row of the table, (h, w) in [0, 1].

    Raises:
        KeypointsError: it is missing, broken, or of another shape than in the row.
        ConfigError: zarr is needed and not installed.
    """
    names = ("file", "array", "rows", "columns")
    file, array, *shape = (row[name][0].as_py() for name in names)
    try:
        return _read_array(store, file, array, tuple(shape))
    except (SaccadeError, MemoryError):
        raise
    except Exception as error:  # zarr raises anything for a broken file
        message = f"{store.location}/{file}: expected a map: {one_line(error)}"
        raise KeypointsError(message) from error


def _read_array(store: Store, file: str, array: str, shape: tuple[int, ...]) -> Float32Array:
    with store.open(file) as opened:
        if not array:
            data = opened.read()
            _check_shape(size_in_header(data, file)[::-1], shape)
            pixels = decode_stored(data, f"{store.location}/{file}")
            _check_shape(pixels.shape, shape)
            return (np.asarray(pixels) / np.float32(PNG_MAXIMUM)).astype(np.float32)
        zarr = import_optional("zarr", "zarr")
        with tempfile.NamedTemporaryFile(suffix=".zip") as copy:
            shutil.copyfileobj(opened, copy)
            copy.flush()
            with _archive(zarr, Path(copy.name), "r") as archive:
                values = zarr.open_group(archive, mode="r")[array]
                _check_shape(values.shape, shape)
                return np.asarray(values[...], np.float32)


def _check_shape(found: tuple[int, ...], expected: tuple[int, ...]) -> None:
    """Check a shape before the array is unpacked: a small file may hold a large one."""
    if found != expected or prod(expected) > LARGEST_IMAGE:
        raise ValueError(f"expected {expected} values, found {found}")


@contextmanager
def _archive(zarr: Any, path: Path, mode: str) -> Iterator[Any]:
    """A Zarr store in one file; a folder of many small files would be slow."""
    archive = zarr.storage.ZipStore(path, mode=mode)
    try:
        yield archive
    finally:
        archive.close()


def _write_png(store: Store, shard: str, name: str, values: Float32Array) -> tuple[str, str]:
    file = f"{FOLDER}/part-{shard}/{name}.png"
    encoded, packed = cv2.imencode(".png", np.rint(values * PNG_MAXIMUM).astype(np.uint16))
    if not encoded:
        raise OutputError(f"{store.location}/{file}: cannot be written as PNG")
    with store.writing(file) as path:
        path.write_bytes(packed.tobytes())
    return file, ""


def _no_map(name: str, values: Float32Array) -> tuple[str, str]:
    raise AssertionError(name)
