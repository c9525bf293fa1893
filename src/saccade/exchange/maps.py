"""Saliency maps as NumPy .npy, MATLAB .mat, and 16-bit or float images."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import OutputError, require
from saccade.io.files import atomic_write
from saccade.types import Float32Array

MAP_FORMATS = ("npy", "mat", "png", "tiff")
WHITE_LEVEL = 65535
"""Value of a PNG pixel that represents 1."""


def write_map(path: str | Path, values: Float32Array) -> None:
    """Writes a map in the format of the suffix, for `saccade evaluate fixations`.

    Args:
        path: .npy or .tiff for float32; .mat with a matrix `map`; .png with 16 bits for 0 to 1.
            Written atomically; an existing file is replaced.
        values: (h, w) in [0, 1].

    Raises:
        ConfigError: unknown suffix.
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
            temporary.write_bytes(_encode(values) if kind == "tiff" else encode_png(values))


def encode_png(values: Float32Array) -> bytes:
    """A map in [0, 1] as 16-bit PNG."""
    return _encode(np.rint(values.clip(0, 1) * WHITE_LEVEL).astype(np.uint16), ".png")


def _encode(pixels: npt.NDArray[Any], suffix: str = ".tiff") -> bytes:
    import cv2  # slow to import

    encoded, packed = cv2.imencode(suffix, pixels)
    if not encoded:
        raise OutputError(f"map of shape {pixels.shape}: cannot be written by OpenCV")
    return packed.tobytes()
