"""Arrays out of .npz files: numbers and text, never pickled, and no more than was promised."""

import os
import zipfile
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from saccade.files import check_file, one_line, open_file

LARGEST_UNPACKED = 1 << 30
"""Bytes that any file may unpack to."""
MOST_UNPACKED = 100
"""How many times its own size a larger one may: what holds measurements is packed less."""
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_arrays(path: Path) -> dict[str, npt.NDArray[Any]]:
    """The arrays of an .npz by their names.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is something else, is broken, has objects in it, or unpacks to too much.
    """
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        try:
            with zipfile.ZipFile(file) as archive:
                check_unpacked(size, sum(each.file_size for each in archive.infolist()))
                return {
                    each.filename.removesuffix(".npy"): _array(archive, each)
                    for each in archive.infolist()
                }
        except MemoryError:
            raise
        except Exception as error:  # the libraries raise what the broken bytes happen to provoke
            raise ValueError(" ".join(str(error).split()) or type(error).__name__) from error


def map_array(path: Path) -> npt.NDArray[Any]:
    """The array in an .npy, read only, as it lies on the disk.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is something else, is broken, or has objects in it.
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
    """Refuse what is small on disk only.

    Raises:
        ValueError: there is more in it than `LARGEST_UNPACKED`, and than `MOST_UNPACKED` allows.
    """
    if unpacked > max(LARGEST_UNPACKED, MOST_UNPACKED * packed):
        raise ValueError(f"{packed:,} bytes that unpack to {unpacked:,}")


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> npt.NDArray[Any]:
    with archive.open(member) as file:
        shape, dtype = _header(file)
    if prod(shape) * dtype.itemsize > member.file_size:
        raise ValueError(f"{member.filename} is shorter than its shape {shape}")
    with archive.open(member) as file:
        values: npt.NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
    return values


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(file)
    if version not in _HEADERS:
        raise ValueError(f"expected an array of version 1 or 2, found {version}")
    shape, _, dtype = _HEADERS[version](file)
    return shape, dtype
