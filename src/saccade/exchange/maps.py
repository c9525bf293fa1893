"""Saliency maps: NumPy's .npy, MATLAB's .mat, and images of 16 bits or floats."""

from pathlib import Path

import cv2
import numpy as np

from saccade.errors import OutputError, require
from saccade.io.files import atomic_write
from saccade.types import Float32Array

MAP_FORMATS = ("npy", "mat", "png", "tiff")
WHITE = 65535
"""Pixel of a PNG that stands for 1."""


def write_map(path: str | Path, values: Float32Array) -> None:
    """Write a map in the format of the suffix, as `saccade evaluate fixations --maps` reads it.

    Args:
        path: .npy and .tiff keep the numbers as float32; .mat holds a matrix `map`; .png has 16
            bits, from 0 to 1. Written whole or not at all; an old file is replaced.
        values: (h, w) in [0, 1].

    Raises:
        ConfigError: another suffix.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower().removeprefix(".")
    require(kind in MAP_FORMATS, "path", "a .npy, .mat, .png or .tiff", str(path))
    values = np.asarray(values, np.float32)
    with atomic_write(path) as temporary:
        if kind == "npy":
            np.save(temporary, values)
        elif kind == "mat":
            from scipy.io import savemat  # slow to import

            savemat(temporary, {"map": values}, do_compression=True)
        else:
            pixels = (
                values if kind == "tiff" else np.rint(values.clip(0, 1) * WHITE).astype(np.uint16)
            )
            encoded, packed = cv2.imencode(f".{kind}", pixels)
            if not encoded:
                raise OutputError(f"{path}: cannot be written by OpenCV")
            temporary.write_bytes(packed.tobytes())
