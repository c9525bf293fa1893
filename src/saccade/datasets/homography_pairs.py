"""Image sequences related by homographies, in the layout of the affine covariant regions data.

A sequence is a folder with `1.png`, `2.png`, ... and for every image but the first a text
file `H_1_k.txt`: the 3x3 homography from pixels of image 1 to pixels of image k.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saccade.errors import ImageError
from saccade.files import read_text, reason_of
from saccade.types import FloatArray

SUFFIXES = (".png", ".ppm", ".pgm", ".jpg")


@dataclass(frozen=True, eq=False)
class HomographyPair:
    """Two images and the homography between them."""

    sequence: str
    """Name of the folder."""
    first: Path
    second: Path
    homography: FloatArray
    """(3, 3) from pixels (x, y, 1) of the first image to those of the second."""


def homography_pairs(folder: Path) -> list[HomographyPair]:
    """All pairs of a folder of sequences, or of one sequence, by name and number.

    Raises:
        ImageError: there are none, an image is missing, or a homography cannot be read.
    """
    sequences = sorted({path.parent for path in folder.rglob("H_1_*.txt")})
    if not sequences:
        raise ImageError(f"{folder}: expected sequences with files H_1_2.txt, ..., found none")
    return [pair for sequence in sequences for pair in _pairs_of(sequence)]


def _pairs_of(sequence: Path) -> Iterator[HomographyPair]:
    numbers = sorted(path.stem.removeprefix("H_1_") for path in sequence.glob("H_1_*.txt"))
    for number in sorted(numbers, key=lambda text: (len(text), text)):
        yield HomographyPair(
            sequence.name,
            _image(sequence, "1"),
            _image(sequence, number),
            _homography(sequence / f"H_1_{number}.txt"),
        )


def _image(sequence: Path, number: str) -> Path:
    for suffix in SUFFIXES:
        path = sequence / f"{number}{suffix}"
        if path.is_file():
            return path
    raise ImageError(f"{sequence}: expected an image {number}.png (or {', '.join(SUFFIXES[1:])})")


def _homography(path: Path) -> FloatArray:
    try:
        homography = np.array(read_text(path).split(), np.float64)
    except (OSError, ValueError) as error:
        raise ImageError(f"{path}: expected nine numbers: {reason_of(error)}") from error
    if homography.size != 9 or not np.isfinite(homography).all():
        raise ImageError(f"{path}: expected nine finite numbers, found {homography.size} numbers")
    matrix = homography.reshape(3, 3)
    if abs(np.linalg.det(matrix)) < np.finfo(float).tiny:
        raise ImageError(f"{path}: expected a homography, found a matrix without inverse")
    return matrix
