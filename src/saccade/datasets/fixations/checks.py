"""Whether positions are pixels of their images, and the options that would make them so."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from saccade.datasets.fixations.placement import (
    LARGEST_UNIT,
    from_center,
    placed,
    to_image_pixels,
)
from saccade.errors import LogError
from saccade.types import BoolArray, FloatArray

AXES: dict[str, tuple[tuple[int, int], tuple[int, int]]] = {
    "x,y": ((1, 0), (0, 1)),
    "y,x": ((0, 1), (1, 0)),
    "x,-y": ((1, 0), (0, -1)),
    "-x,y": ((-1, 0), (0, 1)),
}
"""Orders and signs of the columns x and y, with matrices that convert them to positions."""
NORMALIZED = 1.5
"""Maximum magnitude of fractions, including fixations outside the image."""
SMALLEST_SIDE = 8
"""Minimum side of images for which positions under `NORMALIZED` are fractions."""
OUTSIDE = 0.1
"""Maximum fraction of fixations outside their images; 0 to .01 is usual."""
SHIFTED = 0.03
"""Maximum fraction of fixations outside if options bring three quarters of these inside."""
FEWEST = 5
"""Minimum number of fixations outside for positions to be checked, in `MIN_CENTERED_FIXATIONS` or
more."""
MIN_CENTERED_FIXATIONS = 50
"""Minimum number of fixations for a check that they reach the middle of their images."""
FEW_OUTSIDE = 0.25
"""Maximum fraction outside, among fewer than `MIN_CENTERED_FIXATIONS` fixations."""
SEVERAL = 8
"""Minimum number of fixations for a check that they reach a fifth of their images."""
EXTENT = (0.02, 0.98)
"""Quantiles that bound the fixations, without the outliers of blinks."""
ENLARGED = 1.1
"""Minimum scale suggested; some fixations outside their images resemble a smaller scale."""
SPREAD = 0.25
"""Minimum extent of plausible fixations, as a fraction of the images."""
EQUAL_COST = 0.05
"""Maximum difference of the costs of two options that fit equally."""
SAME_FIXATION = 0.002
"""Maximum distance of equal positions, as a fraction of the images."""
SCREENS = (
    *((640, 480), (800, 600), (1024, 768), (1152, 864), (1280, 720), (1280, 800), (1280, 960)),
    *((1280, 1024), (1366, 768), (1400, 1050), (1440, 900), (1600, 900), (1600, 1200)),
    *((1680, 1050), (1920, 1080), (1920, 1200), (2560, 1440), (2560, 1600), (3840, 2160)),
)
"""Usual widths and heights of screens in pixels."""
PIXELS = "--xy pixels skips this check"


class Option(NamedTuple):
    """Options that convert positions to pixels of the images."""

    words: str
    xy: FloatArray
    """(n, 2) pixels of the images."""


def is_outside(xy: FloatArray, sizes: FloatArray) -> BoolArray:
    """(n,) True for positions outside their images; the first pixel is centered at (0, 0)."""
    pixels = np.floor(xy + 0.5)
    return np.asarray(((pixels < 0) | (pixels >= sizes)).any(axis=1))


def check_positions(
    source: str,
    given: FloatArray,
    xy: FloatArray,
    sizes: FloatArray,
    screen: tuple[float, float] | None = None,
) -> str:
    """Rejects positions that cannot be pixels of their images.

    Args:
        source: name of the file, for error messages.
        given: (n, 2) positions as in the file.
        xy: (n, 2) positions as they are read.
        sizes: (n, 2) width and height of the images.
        screen: width and height of the screen; None if unknown.

    Returns:
        A remark if positions are doubtful, else an empty text.

    Raises:
        LogError: positions in other units or of another origin; the message has the options that
            bring them into the images, if there are any.
    """
    low, high = np.quantile(xy, EXTENT, axis=0)
    side, outside = np.median(sizes, axis=0), is_outside(xy, sizes)
    count, n = int(outside.sum()), len(xy)
    found = f"{source}: expected positions in pixels of the images ({side[0]:.0f} x {side[1]:.0f})"
    span = f"x from {low[0]:.3g} to {high[0]:.3g} and y from {low[1]:.3g} to {high[1]:.3g}"
    if is_too_small(low, high, side, n):
        cure = cures(given, sizes, screen, outside=n) or UNIT_HINT
        raise LogError(f"{found}, found {span}: {cure} ({PIXELS})")
    few = n < MIN_CENTERED_FIXATIONS
    if count < (2 if few else FEWEST) or (few and count <= FEW_OUTSIDE * n):
        return ""
    found += f", found {count} of {n} fixations outside"
    cure = cures(given, sizes, screen, outside=count)
    if cure and count <= SHIFTED * n:
        return f"{found}: {cure} ({PIXELS})"
    if cure or count > OUTSIDE * n:
        raise LogError(f"{found} ({span}): {cure or PLACE_HINT} ({PIXELS})")
    return ""


UNIT_HINT = (
    "smaller units? pass --xy WIDTH,HEIGHT, the size of the images in the units of x and y "
    "(100,100 for percent), and --offset X,Y if their upper left corner is not 0,0"
)
PLACE_HINT = (
    "pass --placement centered WIDTH,HEIGHT or fit WIDTH,HEIGHT, the size of the screen; or --xy "
    "WIDTH,HEIGHT, the size of the images on the screen, and --offset X,Y, the position of their "
    "upper left corner"
)


def is_too_small(low: FloatArray, high: FloatArray, side: FloatArray, count: int) -> bool:
    """Whether positions between two corners are in larger units than pixels, by their extent."""
    largest = np.maximum(np.abs(low), np.abs(high))
    if (largest <= NORMALIZED).all() and side.min() > SMALLEST_SIDE:
        return True
    if (
        count >= MIN_CENTERED_FIXATIONS
        and (high < side / 2).all()
        and (high - low < side / 2).all()
    ):
        return bool((low > -side / 4).all())
    return count >= SEVERAL and bool((largest < side / 5).all())


def cures(
    given: FloatArray, sizes: FloatArray, screen: tuple[float, float] | None, outside: int
) -> str:
    """The options that bring the fixations into their images, the best first; or an empty text."""
    n, fits = len(given), list[tuple[float, Option]]()
    for option in options_for(given, sizes, screen):
        count = int(is_outside(option.xy, sizes).sum())
        low, high = np.quantile((option.xy + 0.5) / sizes, EXTENT, axis=0)
        reach = float((high - low).min())
        if count > max(1, 0.02 * n) or 4 * count >= outside or (reach < SPREAD and n >= SEVERAL):
            continue
        middle = np.median((option.xy + 0.5) / sizes, axis=0)
        fits.append((4 * count / n + float(np.abs(middle - 0.5).max()) + (1 - reach) / 4, option))
    fits.sort(key=lambda each: each[0])
    chosen = list[Option]()
    for cost, option in fits:
        if cost > fits[0][0] + EQUAL_COST or len(chosen) == 2:
            break
        apart = (np.abs(option.xy - each.xy) / sizes for each in chosen)
        if all(float(np.median(each.max(axis=1))) > SAME_FIXATION for each in apart):
            chosen.append(option)
    words = " or ".join(each.words for each in chosen)
    return f"pass {words}" if words else degree_hint(given, sizes)


def degree_hint(given: FloatArray, sizes: FloatArray) -> str:
    """The option for degrees about the center, if positions may be that; or an empty text."""
    low, high = np.quantile(given, EXTENT, axis=0)
    if not ((low < 0) & (high > 0) & (np.maximum(-low, high) < sizes.min(axis=0) / 5)).all():
        return ""
    most = float((sizes / 2 / np.maximum(np.abs(given), 1e-9)).min())
    return (
        "degrees about the center? pass --xy deg and --pixels-per-degree N, under "
        f"{most:.3g} for all fixations to be inside"
    )


def options_for(
    given: FloatArray, sizes: FloatArray, screen: tuple[float, float] | None
) -> Iterator[Option]:
    """Possible options with the positions that they give, simple ones first."""
    for name in AXES:
        if name != "x,y":
            yield Option(
                f"--axes={name}, if axes are exchanged or mirrored,", given @ matrix_of(name)
            )
    boxes = np.column_stack([np.zeros_like(sizes), np.ones_like(sizes), np.zeros(len(sizes))])
    yield Option("--xy normalized", to_image_pixels(given, boxes, sizes))
    boxes[:, 2:4] = 100
    yield Option(
        "--xy WIDTH,HEIGHT, the size of the images in the units of x and y (100,100 for percent),",
        to_image_pixels(given, boxes, sizes),
    )
    yield from shifted(given, sizes)
    for unit in ("pix", "norm", "height"):
        yield Option(f"--xy {unit}", from_center(given, unit, sizes))
    yield from enlarged(given, sizes)
    screens = SCREENS if screen is None else [screen]
    for size in screens:
        for placement in ("centered", "fit"):
            boxes = placed(placement, size, sizes)
            words = f"--placement {placement} {size[0]:.0f},{size[1]:.0f}"
            corner = np.unique(boxes[:, :2], axis=0)
            same = " (or --offset X,Y, the upper left corner of the images, about {:.0f},{:.0f})"
            own = placement == "centered" and len(corner) == 1
            positions = to_image_pixels(given, boxes, sizes)
            yield Option(words + same.format(*corner[0]) * own, positions)
            for unit in ("norm", "height"):
                on_screen = from_center(given, unit, np.broadcast_to(np.array(size), sizes.shape))
                yield Option(f"--xy {unit} {words}", to_image_pixels(on_screen, boxes, sizes))


def matrix_of(axes: str) -> FloatArray:
    """(2, 2) matrix by which positions (n, 2) are multiplied."""
    return np.array(AXES[axes], np.float64).T


def shifted(given: FloatArray, sizes: FloatArray) -> Iterator[Option]:
    """The upper left corner of the images, by the fixations; for images of one size."""
    side = np.median(sizes, axis=0)
    if (sizes != side).any():
        return
    corner = np.round(np.quantile(given - sizes / 2, EXTENT, axis=0).mean(axis=0))
    words = (
        "--offset X,Y, the upper left corner of the images (about "
        f"{corner[0]:.0f},{corner[1]:.0f} by the fixations)"
    )
    screens = (
        f"--placement centered {w},{h} or "
        for w, h in SCREENS
        if np.abs((np.array([w, h]) - side) / 2 - corner).max() < EQUAL_COST / 2 * side.min()
    )
    if (np.abs(corner / side + 0.5) < 0.1).all():
        words = f"--xy pix (about the center, y up) or {words}, and --axes=x,-y if y points up"
    yield Option(next(screens, "") + words, given - corner)


def enlarged(given: FloatArray, sizes: FloatArray) -> Iterator[Option]:
    """The size of enlarged images in the upper left corner, by the fixations; for one size."""
    side = np.median(sizes, axis=0)
    scale = float((np.quantile(given / sizes, EXTENT[1], axis=0)).max()) / EXTENT[1]
    if scale > ENLARGED and (sizes == side).all() and scale * side.max() > LARGEST_UNIT:
        width, height = scale * side
        words = "--xy WIDTH,HEIGHT, the size of the images on the screen"
        yield Option(f"{words} (about {width:.0f},{height:.0f})", given / scale)
