"""SymRoID, the symmetrical region-of-interest detector: few regions, as landmarks."""

from dataclasses import replace
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from saccade._pair_sums_kernels import MARGIN, update_strongest_pairs
from saccade.image import as_gray
from saccade.keypoints.scale_space_points import Points, descriptors_of, directions
from saccade.keypoints.symroid_config import SymRoidConfig
from saccade.pair_sums import (
    Gradients,
    PairKernel,
    gradients_of,
    isotropic_sums,
    pair_kernel,
)
from saccade.pyramid import cell_centers, halve, resize
from saccade.types import Float32Array, FloatArray, Image, IntArray, Keypoints, Regions

Labels: TypeAlias = npt.NDArray[np.int32]
Mask: TypeAlias = npt.NDArray[np.bool_]

WINDOW = 24
"""Cells on either side of a seed in which it grows, as long as that is enough."""
PATCH = 60
"""Pixels to a side of the square that a region is brought to before it is described."""
AROUND = 1.25
"""Sides of the region's box that it shows: gradients on the outline count too."""
SCALE = PATCH / AROUND / 12
"""Of the point in its middle, whose descriptor is 12 scales wide, in the square's pixels."""


class Level(NamedTuple):
    """One scale at which pairs are sought."""

    spacing: float
    """Image pixels from one of its pixels to the next."""
    gradients: Gradients
    symmetry: Float32Array
    """(h, w)."""


class SymRoid:
    """SymRoID as a callable: `SymRoid(config)(image)` gives `Regions`.

    Args:
        config: what to do.
    """

    def __init__(self, config: SymRoidConfig | None = None) -> None:
        self.config = config or SymRoidConfig()

    def __repr__(self) -> str:
        return f"SymRoid({self.config})"

    def __call__(self, image: Image) -> Regions:
        """Find regions of local symmetry and describe them.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4); uint8, uint16, bool, or float in [0, 1].

        Returns:
            The regions, the most symmetric first; none where nothing is symmetric, or where the
            image is too small for a pair at any level.

        Raises:
            ImageError: not an image, empty, not finite, or outside [0, 1].

        Source: Kootstra & Schomaker, *Using symmetrical regions of interest to improve visual
        SLAM* (IROS 2009). The descriptor of the regions is not known but for its manner: here it
        is SIFT's, on the box brought to a square.
        """
        gray, config = as_gray(image), self.config
        pairs = pair_kernel(config.inner, config.outer, config.sigma)
        levels = symmetry_levels(gray, config, pairs)
        if not levels:
            return Regions.none()
        height, width = levels[0].symmetry.shape
        summed = np.zeros((height, width), np.float32)
        for level in levels:
            summed += resize(level.symmetry, (height, width))
        labels, response = grow(summed, config)
        strongest = np.argsort(-response, kind="stable")
        if config.max_keypoints:
            strongest = strongest[: config.max_keypoints]
        if not len(strongest):
            return Regions.none()
        kept = np.zeros(len(response) + 1, np.int64)
        kept[1 + strongest] = 1 + np.arange(len(strongest))
        xy, boxes = expand_to_pairs(kept[labels], levels, pairs, (gray.shape[0], gray.shape[1]))
        keypoints = Keypoints(
            xy=xy.astype(np.float32),
            size=np.sqrt(np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)).astype(np.float32),
            angle=np.zeros(len(xy), np.float32),
            response=response[strongest].astype(np.float32),
            octave=np.zeros(len(xy), np.int32),
        )
        return described(gray, Regions(keypoints, boxes.astype(np.float32)), config)


def described(gray: Float32Array, regions: Regions, config: SymRoidConfig) -> Regions:
    """Regions with descriptors, and directions unless upright.

    The squares that they are brought to are to SIFT the planes of an octave, with a point in the
    middle of each.
    """
    count, sift = len(regions), replace(config.descriptor, max_orientations=1)
    squares = np.empty((count, PATCH, PATCH), np.float32)
    for square, box in zip(squares, regions.boxes, strict=True):
        cv2.GaussianBlur(normalized(gray, box), (0, 0), SCALE, dst=square)
    points = Points(
        octave=np.zeros(count, np.int64),
        plane=np.arange(count),
        xy=np.full((count, 2), (PATCH - 1) / 2, np.float32),
        sigma=np.full(count, SCALE, np.float32),
        angle=np.zeros(count, np.float32),
        response=regions.keypoints.response,
    )
    if not config.upright:
        index, angle = directions(squares, points, sift)
        points.angle[index] = angle  # a flat square has none
    descriptors = descriptors_of(squares, points, sift)
    keypoints = replace(regions.keypoints, angle=points.angle, descriptors=descriptors)
    return Regions(keypoints, regions.boxes)


def symmetry_levels(gray: Float32Array, config: SymRoidConfig, pairs: PairKernel) -> list[Level]:
    """The levels on which a pair has room, and their isotropic symmetry."""
    plane, levels = gray, []
    for number in range(config.levels[-1] + 1):
        if number > 0:
            plane = halve(plane)
        if number in config.levels and min(plane.shape) >= 2 * (config.inner + MARGIN) + 1:
            gradients = gradients_of(plane, config.gain)
            spacing = gray.shape[1] / plane.shape[1]
            levels.append(Level(spacing, gradients, isotropic_sums([gradients], pairs)))
    return levels


def grow(symmetry: Float32Array, config: SymRoidConfig) -> tuple[Labels, FloatArray]:
    """Regions about the local maxima of a map.

    Args:
        symmetry: (h, w), not negative.
        config: the thresholds.

    Returns:
        (h, w) number of the region of each cell, from 1, 0 for none; (n,) the highest value of
        each. Regions do not touch, not even at corners, unless each grew from its own seed.
    """
    highest = float(symmetry.max(initial=0))
    labels: Labels = np.zeros(symmetry.shape, np.int32)
    if highest == 0:
        return labels, np.zeros(0)
    if config.relative_to == "maximum":
        grown = (symmetry >= config.growth_threshold * highest).astype(np.uint8)
        parts = np.asarray(cv2.connectedComponents(grown, connectivity=4)[1])
        rows, columns = local_maxima(symmetry, config.seed_threshold * highest).T
        seeded = np.isin(parts, parts[rows, columns]) & (parts > 0)
        labels = np.asarray(cv2.connectedComponents(seeded.astype(np.uint8), connectivity=8)[1])
        peaks = np.zeros(int(labels.max()) + 1)
        np.maximum.at(peaks, labels, symmetry)
        return labels, peaks[1:]
    found: list[float] = []
    for row, column in local_maxima(symmetry, config.seed_threshold * highest).tolist():
        if labels[row, column] == 0:
            value = float(symmetry[row, column])
            rows, columns, mine = connected_region(
                symmetry, row, column, config.growth_threshold * value
            )
            window = labels[rows, columns]
            if not window[mine].any():
                found.append(value)
                window[mine] = len(found)
            if len(found) == config.max_keypoints:
                break
    return labels, np.array(found)


def local_maxima(symmetry: Float32Array, least: float) -> IntArray:
    """(n, 2) row and column of the cells that are highest of 3x3, the highest first."""
    peaks = (symmetry == ndimage.maximum_filter(symmetry, 3)) & (symmetry >= least)
    cells = np.argwhere(peaks)
    return cells[np.argsort(-symmetry[peaks], kind="stable")]


def connected_region(
    symmetry: Float32Array, row: int, column: int, least: float
) -> tuple[slice, slice, Mask]:
    """The cells about one that hang together along the axes and have at least a value.

    Returns:
        Rows and columns of a window, and which of its cells they are.
    """
    height, width = symmetry.shape
    reach = WINDOW
    while True:
        top, left = max(row - reach, 0), max(column - reach, 0)
        window = slice(top, row + reach + 1), slice(left, column + reach + 1)
        low = (symmetry[window] < least).view(np.uint8)
        filled = cv2.copyMakeBorder(low, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=(1,))
        flags = 4 | (2 << 8) | cv2.FLOODFILL_MASK_ONLY
        cv2.floodFill(low, filled, (column - left, row - top), 0, flags=flags)
        mine = filled[1:-1, 1:-1] == 2
        outline = mine[0].any() or mine[-1].any() or mine[:, 0].any() or mine[:, -1].any()
        if not outline or reach >= max(height, width):
            return *window, mine
        reach *= 4


def expand_to_pairs(
    labels: IntArray, levels: list[Level], pairs: PairKernel, shape: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Regions with the discs on which their strongest pairs lie.

    Args:
        labels: (h, w) number of the region of each cell, 1 to n, 0 for none.
        levels: at which pairs were sought.
        pairs: which count.
        shape: (H, W) of the image.

    Returns:
        (n, 2) mean of the cells of each, and (n, 4) left, top, right and bottom of the box about
        the discs, both in pixels.
    """
    rows, columns = np.nonzero(labels)
    number = labels[rows, columns] - 1
    xy = cell_centers(rows, columns, labels.shape, shape)
    radius = radius_of_strongest(levels, pairs, xy)[:, None]
    count = int(number.max()) + 1
    total = np.zeros((count, 2))
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.add.at(total, number, xy)
    np.minimum.at(low, number, xy - radius)
    np.maximum.at(high, number, xy + radius)
    low, high = low.clip(-0.5), np.minimum(high, np.array(shape[::-1]) - 0.5)
    return total / np.bincount(number)[:, None], np.hstack([low, high])


def radius_of_strongest(levels: list[Level], pairs: PairKernel, xy: FloatArray) -> FloatArray:
    """Half the distance of the pair that contributes most to each of (n, 2) places.

    It is the strongest of all levels; (n,) in pixels, 0 where there is none.
    """
    strongest, radius = np.zeros(len(xy)), np.zeros(len(xy))
    scaled = pairs.scaled()
    for level in levels:
        cells = np.floor((xy + 0.5) / level.spacing).astype(np.int64)
        update_strongest_pairs(level.gradients, scaled, level.spacing, cells, strongest, radius)
    return radius


def normalized(gray: Float32Array, box: Float32Array) -> Float32Array:
    """(PATCH, PATCH) what a box and a little around it show; borders go on beyond the image."""
    middle, half = (box[:2] + box[2:]) / 2, AROUND * (box[2:] - box[:2]) / 2
    low, high = np.floor(middle - half + 0.5).astype(int), np.ceil(middle + half + 0.5).astype(int)
    rows, columns = (
        np.arange(low[axis], max(high[axis], low[axis] + 2)).clip(0, gray.shape[1 - axis] - 1)
        for axis in (1, 0)
    )
    return resize(gray[np.ix_(rows, columns)], (PATCH, PATCH))
