"""Maps of images: float16 in a Zarr archive to a shard, or a 16-bit PNG to an image."""

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
from saccade.files import LARGEST_IMAGE, one_line
from saccade.image import decode_stored, size_in_header
from saccade.types import Float32Array

FOLDER = "maps"
WHITE = 65535
"""What a PNG has for 1."""

AddMap: TypeAlias = Callable[[str, Float32Array], tuple[str, str]]
"""Takes the name of an image and its map; gives the file, and the name of the array in it."""


@contextmanager
def writing_maps(job: Job, store: Store, shard: str) -> Iterator[AddMap]:
    """What writes the maps of a shard; nothing where none are made.

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
    """The map that a row of the table names, (h, w) in [0, 1].

    Raises:
        KeypointsError: it is missing, broken, or of another shape than the row says.
        ConfigError: zarr is needed and not installed.
    """
    names = ("file", "array", "rows", "columns")
    file, array, *shape = (row[name][0].as_py() for name in names)
    try:
        values = _map_in(store, file, array, tuple(shape))
    except (SaccadeError, MemoryError):
        raise
    except Exception as error:  # zarr raises what the broken bytes happen to provoke
        raise KeypointsError(f"{store.place}/{file}: expected a map: {one_line(error)}") from error
    return values


def _map_in(store: Store, file: str, array: str, shape: tuple[int, ...]) -> Float32Array:
    with store.open(file) as opened:
        if not array:
            data = opened.read()
            _check_shape(size_in_header(data, file)[::-1], shape)
            pixels = decode_stored(data, f"{store.place}/{file}")
            _check_shape(pixels.shape, shape)
            return (np.asarray(pixels) / np.float32(WHITE)).astype(np.float32)
        zarr = import_optional("zarr", "zarr")
        with tempfile.NamedTemporaryFile(suffix=".zip") as copy:
            shutil.copyfileobj(opened, copy)
            copy.flush()
            with _archive(zarr, Path(copy.name), "r") as archive:
                held = zarr.open_group(archive, mode="r")[array]
                _check_shape(held.shape, shape)
                return np.asarray(held[...], np.float32)


def _check_shape(found: tuple[int, ...], expected: tuple[int, ...]) -> None:
    """Before an array is unpacked: a small file may hold a large one."""
    if found != expected or prod(expected) > LARGEST_IMAGE:
        raise ValueError(f"expected {expected} values, found {found}")


@contextmanager
def _archive(zarr: Any, path: Path, mode: str) -> Iterator[Any]:
    """A Zarr store in one file: a folder of many small ones would be slow everywhere."""
    archive = zarr.storage.ZipStore(path, mode=mode)
    try:
        yield archive
    finally:
        archive.close()


def _write_png(store: Store, shard: str, name: str, values: Float32Array) -> tuple[str, str]:
    file = f"{FOLDER}/part-{shard}/{name}.png"
    whole, packed = cv2.imencode(".png", np.rint(values * WHITE).astype(np.uint16))
    if not whole:
        raise OutputError(f"{store.place}/{file}: cannot be written as PNG")
    with store.writing(file) as path:
        path.write_bytes(packed.tobytes())
    return file, ""


def _no_map(name: str, values: Float32Array) -> tuple[str, str]:
    raise AssertionError(name)
