"""Image sequences related by homographies, in the layout of the affine covariant regions data.

A sequence is a folder with `1.png`, `2.png`, ... and, for every image after the first, a text file
`H_1_k.txt` with the 3x3 homography from pixels of image 1 to pixels of image k.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saccade.errors import ImageError
from saccade.io.files import natural_order, read_text, reading
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
    """(3, 3) from pixels (x, y, 1) of the first image to pixels of the second."""


def homography_pairs(folder: Path) -> list[HomographyPair]:
    """All pairs of a folder of sequences, or of one sequence, by name and number.

    Raises:
        ImageError: the folder has no pairs, an image is missing, or a homography cannot be read.
    """
    files = sorted(folder.rglob("H_1_*.txt"), key=natural_order)
    if not files:
        raise ImageError(f"{folder}: expected sequences with files H_1_2.txt, ..., found none")
    return [
        HomographyPair(
            sequence=file.parent.name,
            first=_image(file.parent, "1"),
            second=_image(file.parent, file.stem.removeprefix("H_1_")),
            homography=_homography(file),
        )
        for file in files
    ]


def _image(sequence: Path, number: str) -> Path:
    for path in (sequence / f"{number}{suffix}" for suffix in SUFFIXES):
        if path.is_file():
            return path
    raise ImageError(f"{sequence}: expected an image {number}.png (or {', '.join(SUFFIXES[1:])})")


def _homography(path: Path) -> FloatArray:
    with reading(path, ImageError, "nine numbers", ValueError):
        homography = np.array(read_text(path).split(), np.float64).reshape(3, 3)
    if not np.isfinite(homography).all() or abs(np.linalg.det(homography)) < np.finfo(float).tiny:
        raise ImageError(f"{path}: expected a homography, found a matrix without inverse")
    return homography
