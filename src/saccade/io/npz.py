"""Reads and writes .npz and .npy files safely: no pickles, no decompression bombs."""

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from saccade.io.files import check_file, one_line, open_file

MAX_UNPACKED = 1 << 30
"""Unpacked size in bytes that is accepted for any file."""
MAX_RATIO = 100
"""Maximum compression ratio of larger files; real measurements compress less."""


def save_arrays(
    file: IO[bytes] | Path, arrays: Mapping[str, npt.ArrayLike], *, compressed: bool = True
) -> None:
    """Writes named arrays as .npz.

    Raises:
        TypeError: an array has objects, which NumPy would pickle.
    """
    values = {name: np.asarray(array) for name, array in arrays.items()}
    for name, array in values.items():
        if array.dtype.hasobject:
            raise TypeError(f"{name}: expected numbers or text, found {array.dtype}")
    save = np.savez_compressed if compressed else np.savez
    save(file, **values)  # type: ignore[arg-type]  # NumPy's stub takes them for its options


def read_arrays(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Reads the arrays of an .npz by name.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file has another format, is broken, has objects, or unpacks to too much.
    """
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        try:
            with zipfile.ZipFile(file) as archive:
                check_unpacked(size, sum(member.file_size for member in archive.infolist()))
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                return {name: np.asarray(arrays[name]) for name in arrays.files}
        except Exception as error:  # arbitrary exceptions for broken bytes
            raise ValueError(one_line(error)) from error


def map_array(path: Path) -> npt.NDArray[Any]:
    """The array of an .npy, memory-mapped and read-only.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file has another format, is broken, or has objects.
    """
    check_file(path)
    try:
        values: npt.NDArray[Any] = np.lib.format.open_memmap(str(path), mode="r")
    except OSError:
        raise
    except Exception as error:
        raise ValueError(one_line(error)) from error
    return values


def check_unpacked(packed: int, unpacked: int) -> None:
    """Rejects decompression bombs.

    Raises:
        ValueError: the size exceeds `MAX_UNPACKED` and the ratio exceeds `MAX_RATIO`.
    """
    if unpacked > max(MAX_UNPACKED, MAX_RATIO * packed):
        raise ValueError(f"{packed:,} bytes that unpack to {unpacked:,}")
