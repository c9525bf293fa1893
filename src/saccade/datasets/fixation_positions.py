"""Images of fixations, and conversion of positions to image pixels."""

from pathlib import Path, PureWindowsPath

import numpy as np

from saccade.datasets.fixation_tables import Texts
from saccade.errors import LogError
from saccade.io.files import IMAGE_SUFFIXES, is_file, natural_order, reading
from saccade.io.image import read_image
from saccade.types import BoolArray, FloatArray

NORMALIZED = (-0.5, 1.5)
"""Range of normalized coordinates, including fixations outside the image."""
AXES: dict[str, tuple[tuple[int, int], tuple[int, int]]] = {
    "x,y": ((1, 0), (0, 1)),
    "y,x": ((0, 1), (1, 0)),
    "x,-y": ((1, 0), (0, -1)),
    "-x,y": ((-1, 0), (0, 1)),
}
"""Orders and signs of the columns x and y, with matrices that convert them to positions."""
OUTSIDE = 0.1
"""Maximum fraction of fixations outside their images; 0 to .01 is usual."""
SHIFTED = 0.03
"""Maximum fraction of fixations outside if other axes, a shift or a scale would bring three
quarters of these inside."""
ENLARGED = 1.1
"""Minimum scale suggested; some fixations outside their images resemble a smaller scale."""
FEWEST = 5
"""Minimum number of fixations outside for positions to be checked."""
MIDDLE = 50
"""Minimum number of fixations for a check that they reach the middle of their images."""
EXTENT = (0.02, 0.98)
"""Quantiles that bound the fixations, without the outliers of blinks."""
LARGEST_UNIT = 100
"""Maximum size of an image on the screen in units other than pixels."""
PIXELS = "--xy pixels skips this check"


def list_folder(folder: Path) -> list[Path]:
    """Content of a folder, by name; empty if it does not exist."""
    with reading(folder, LogError):
        return sorted(folder.iterdir(), key=natural_order) if folder.is_dir() else []


def resolve_images(names: Texts, folder: Path) -> Texts:
    """The file of each image name, ignoring case, folder and suffix if necessary.

    Args:
        names: (n,) names in a table.
        folder: folder of the images.

    Returns:
        (n,) names of files; names without a file are unchanged.
    """
    files: dict[str, list[str]] = {}
    for name in (path.name for path in list_folder(folder)):
        if name.lower().endswith(IMAGE_SUFFIXES):
            for key in {name.casefold(), Path(name).stem.casefold()}:
                files.setdefault(key, []).append(name)
    unique, inverse = np.unique(names, return_inverse=True)
    resolved = []
    for name in unique.tolist():
        fits = files.get(PureWindowsPath(name).name.casefold(), [])
        if is_file(folder / name) or not fits:
            fits = [name]
        if len(fits) > 1:
            raise LogError(f"{folder}: the image {name} could be {' or '.join(fits)}")
        resolved.append(fits[0])
    return np.array(resolved)[inverse]


def image_sizes(names: Texts, folder: Path) -> FloatArray:
    """(n, 2) width and height of the image of each name."""
    unique, inverse = np.unique(names, return_inverse=True)
    shapes = [read_image(folder / str(name)).shape for name in unique]
    return np.array([(shape[1], shape[0]) for shape in shapes], np.float64)[inverse]


def to_image_pixels(xy: FloatArray, boxes: FloatArray, sizes: FloatArray) -> FloatArray:
    """Converts positions on the screen to pixels of the images.

    The center of a pixel has integer coordinates, both on the screen and in the image; fractions,
    percentages and lengths start at the edge of the image.

    Args:
        xy: (n, 2) positions in the units of the boxes.
        boxes: (n, 5) positions of the images on the screen, see `Box`.
        sizes: (n, 2) width and height of the images in pixels.
    """
    shown = np.where(np.isnan(boxes[:, 2:4]), sizes, boxes[:, 2:4])
    corner = boxes[:, :2] - boxes[:, 4:] * shown / 2
    half = np.where(shown.max(axis=1, keepdims=True) > LARGEST_UNIT, 0.5, 0)
    pixels = (xy - corner + half) * (sizes / shown) - 0.5
    pixels = np.round(pixels, 6)  # undo rounding errors of the division
    edge = sizes - 0.5
    pixels = np.where(pixels == edge, edge - 1e-6, pixels)  # in the last pixel
    return np.where(np.isnan(boxes[:, :1]), xy, pixels)


def check_positions(source: str, xy: FloatArray, sizes: FloatArray) -> str:
    """Rejects positions that cannot be pixels of their images.

    Args:
        source: name of the file, for error messages.
        xy: (n, 2) positions.
        sizes: (n, 2) width and height of the images.

    Returns:
        A remark if positions are doubtful, else an empty text.
    """
    low, high = np.quantile(xy, EXTENT, axis=0)
    side = np.median(sizes, axis=0)
    size = f"{side[0]:.0f} x {side[1]:.0f}"
    found = f"{source}: expected positions in pixels of the images ({size}), found"
    span = f"x from {low[0]:.3g} to {high[0]:.3g} and y from {low[1]:.3g} to {high[1]:.3g}"
    if (low >= NORMALIZED[0]).all() and (high <= NORMALIZED[1]).all() and side.min() > 8:
        raise LogError(f"{found} {span}: normalized; pass --xy normalized ({PIXELS})")
    if len(xy) >= MIDDLE and (high < side / 2).all() and (high - low < side / 2).all():
        raise LogError(
            f"{found} {span}: smaller units? pass --xy WIDTH,HEIGHT, the size of the images in the "
            "units of x and y (100,100 for percent), and --offset X,Y if their upper left corner "
            f"is not 0,0 ({PIXELS})"
        )
    outside = is_outside(xy, sizes)
    if outside.sum() < FEWEST:
        return ""
    found += f" {outside.sum()} of {len(xy)} fixations outside"
    cures = [
        (f": axes exchanged or mirrored? pass --axes={name}", xy @ np.array(axes).T)
        for name, axes in AXES.items()
    ]
    shift = np.round(np.quantile(xy - sizes / 2, EXTENT, axis=0).mean(axis=0))
    center = ", and --axes=x,-y if y points up" * bool((np.abs(shift / side + 0.5) < 0.1).all())
    cures.append(
        (
            ", on one side: positions on the screen? pass --offset X,Y, the upper left corner of "
            f"the images (about {shift[0]:.0f},{shift[1]:.0f} by the fixations){center}",
            xy - shift,
        )
    )
    scale = float((np.quantile(xy / sizes, EXTENT[1], axis=0)).max())
    if scale > ENLARGED:
        width, height = scale * side
        enlarged = f"pass --xy WIDTH,HEIGHT, their displayed size (about {width:.0f},{height:.0f})"
        cures.append((f": were the images enlarged? {enlarged}", xy / scale))
    cure, moved = min(cures, key=lambda each: int(is_outside(each[1], sizes).sum()))
    if 4 * is_outside(moved, sizes).sum() < outside.sum():
        if outside.mean() > SHIFTED:
            raise LogError(f"{found}{cure} ({PIXELS})")
        return f"{found}{cure} ({PIXELS})"
    if outside.mean() > OUTSIDE:
        raise LogError(
            f"{found} ({span}); pass --xy WIDTH,HEIGHT, the size of the images on the screen, and "
            f"--offset X,Y, the position of their upper left corner ({PIXELS})"
        )
    return ""


def is_outside(xy: FloatArray, sizes: FloatArray) -> BoolArray:
    """(n,) True for positions outside their images; the first pixel is centered at (0, 0)."""
    pixels = np.floor(xy + 0.5)
    return np.asarray(((pixels < 0) | (pixels >= sizes)).any(axis=1))
