"""SymRoID, the symmetrical region-of-interest detector: few regions, as landmarks."""

from dataclasses import replace
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from saccade.io.image import as_gray
from saccade.keypoints.descriptor import assign_orientations, describe_points
from saccade.keypoints.detection import by_strength
from saccade.keypoints.must import Must
from saccade.keypoints.scale_space_points import Points
from saccade.keypoints.symroid_config import SymRoidConfig
from saccade.scale._pair_sums_kernels import MARGIN, update_strongest_pairs
from saccade.scale.pair_sums import (
    Gradients,
    PairKernel,
    gradients_of,
    isotropic_sums,
    pair_kernel,
)
from saccade.scale.pyramid import cell_centers, halve, resize
from saccade.scale.scale_space import ScaleSpace
from saccade.types import Float32Array, FloatArray, Image, IntArray, Keypoints, Regions

Labels: TypeAlias = npt.NDArray[np.int32]

SEPARATION = 2.0
"""Smallest distance of two regions, in scales of the coarser."""
PATCH_SIDE = 60
"""Pixels to a side of the square patch that a region is resampled to."""
MAGNIFICATION = 1.25
"""Sides of the region's box that the patch covers: gradients on the outline count too."""
PATCH_SIGMA = PATCH_SIDE / MAGNIFICATION / 12
"""Scale of the patch's keypoint, whose descriptor is 12 scales wide, in its pixels."""


class Level(NamedTuple):
    """A pyramid level and its symmetry."""

    spacing: float
    """Image pixels from one of its pixels to the next."""
    gradients: Gradients
    symmetry: Float32Array
    """(h, w)."""


class SymRoid:
    """SymRoID as a callable: `SymRoid(config)(image)` gives `Regions`.

    Args:
        config: frames, levels, pairs, region growing and descriptor.
        threads: of a call, for frames in scale space; None for one per core. The regions do not
            depend on it.
    """

    def __init__(self, config: SymRoidConfig | None = None, threads: int | None = None) -> None:
        self.config = config or SymRoidConfig()
        self._frames = RegionFrames(self.config, threads)

    def __repr__(self) -> str:
        return f"SymRoid({self.config})"

    def __call__(self, image: Image) -> Regions:
        """Find regions of local symmetry and describe them.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4); uint8, uint16, bool, or float in [0, 1].

        Returns:
            The regions, the most symmetric first, and in scale space once for each orientation;
            none where nothing is symmetric, or where the image is too small.

        Raises:
            ImageError: not an image, empty, not finite, or outside [0, 1].

        Source: Kootstra & Schomaker, *Using symmetrical regions of interest to improve visual
        SLAM* (IROS 2009). It describes the descriptor of the regions in outline only: here it is
        SIFT's, in the frame of the region, or on its box resampled to a square.
        """
        gray = as_gray(image)
        if self.config.frame == "box":
            return boxed_regions(gray, self.config)
        keypoints, radius = self._frames(gray), self._frames.config.radius
        return Regions(keypoints, pair_boxes(keypoints, radius, (gray.shape[0], gray.shape[1])))


class RegionFrames(Must):
    """Finds the frames of regions as MUST finds keypoints, none within a stronger one.

    Args:
        config: of the regions.
        threads: of a call; None for one per core. The regions do not depend on it.
    """

    def __init__(self, config: SymRoidConfig, threads: int | None = None) -> None:
        super().__init__(config.must(), threads)
        self._seed_threshold = config.seed_threshold

    def _preferred(self, points: Points, space: ScaleSpace) -> IntArray:
        order = by_strength(points, space, self._sift)
        response = points.response[order]
        order = order[response >= self._seed_threshold * response.max(initial=0)]
        xy, sigma = points.take(order).image_coordinates(space)
        kept: IntArray = order[separated(xy, sigma, self._sift.max_keypoints)]
        return kept


def separated(xy: FloatArray, sigma: FloatArray, count: int | None) -> IntArray:
    """Indices of the first points that are apart from those kept before them.

    Args:
        xy: (n, 2) positions.
        sigma: (n,) scales.
        count: number of points to keep; None for all.
    """
    kept: list[int] = []
    for i in range(len(xy)):
        if len(kept) == count:
            break
        reach = SEPARATION * np.maximum(sigma[kept], sigma[i])
        if (np.hypot(*(xy[kept] - xy[i]).T) >= reach).all():
            kept.append(i)
    return np.array(kept, np.int64)


def pair_boxes(keypoints: Keypoints, radius: float, shape: tuple[int, int]) -> Float32Array:
    """The boxes about the discs from which the symmetry of keypoints was summed.

    Args:
        keypoints: n keypoints.
        radius: of the disc, in scales.
        shape: (H, W) of the image.

    Returns:
        (n, 4) left, top, right and bottom in pixels, clipped to the image.
    """
    reach = radius * keypoints.size[:, None] / 2
    low = (keypoints.xy - reach).clip(-0.5)
    high = np.minimum(keypoints.xy + reach, np.array(shape[::-1]) - 0.5)
    return np.hstack([low, high]).astype(np.float32)


def boxed_regions(gray: Float32Array, config: SymRoidConfig) -> Regions:
    """Regions grown in the map of symmetry, described in their boxes.

    Args:
        gray: (H, W) in [0, 1].
        config: levels, pairs, region growing and descriptor.
    """
    pairs = pair_kernel(config.inner, config.outer, config.sigma)
    levels = symmetry_levels(gray, config, pairs)
    if not levels:
        return Regions.none()
    height, width = levels[0].symmetry.shape
    symmetry = np.zeros((height, width), np.float32)
    for level in levels:
        symmetry += resize(level.symmetry, (height, width))
    labels, response = grow_regions(symmetry, config)
    strongest = np.argsort(-response, kind="stable")[: config.max_keypoints]
    if not len(strongest):
        return Regions.none()
    rank = np.zeros(len(response) + 1, np.int64)
    rank[1 + strongest] = 1 + np.arange(len(strongest))
    xy, boxes = bounding_boxes(rank[labels], levels, pairs, (gray.shape[0], gray.shape[1]))
    keypoints = Keypoints(
        xy=xy.astype(np.float32),
        size=np.sqrt(np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)).astype(np.float32),
        angle=np.zeros(len(xy), np.float32),
        response=response[strongest].astype(np.float32),
        octave=np.zeros(len(xy), np.int32),
    )
    return described(gray, Regions(keypoints, boxes.astype(np.float32)), config)


def described(gray: Float32Array, regions: Regions, config: SymRoidConfig) -> Regions:
    """Regions with descriptors, and orientations unless upright.

    SIFT takes their patches for the planes of an octave, with a keypoint in the middle of each.
    """
    count = len(regions)
    patches = np.empty((count, PATCH_SIDE, PATCH_SIDE), np.float32)
    for patch, box in zip(patches, regions.boxes, strict=True):
        cv2.GaussianBlur(resampled(gray, box), (0, 0), PATCH_SIGMA, dst=patch)
    points = Points(
        octave=np.zeros(count, np.int64),
        plane=np.arange(count),
        xy=np.full((count, 2), (PATCH_SIDE - 1) / 2, np.float32),
        sigma=np.full(count, PATCH_SIGMA, np.float32),
        angle=np.zeros(count, np.float32),
        response=regions.keypoints.response,
    )
    if not config.upright:
        index, angle = assign_orientations([patches], points, config.descriptor, 1)
        points.angle[index] = angle  # a flat patch has none
    descriptors = describe_points([patches], points, config.descriptor)
    keypoints = replace(regions.keypoints, angle=points.angle, descriptors=descriptors)
    return Regions(keypoints, regions.boxes)


def symmetry_levels(gray: Float32Array, config: SymRoidConfig, pairs: PairKernel) -> list[Level]:
    """The levels that are large enough for a pair, and their isotropic symmetry."""
    plane, levels = gray, []
    for number in range(config.levels[-1] + 1):
        if number > 0:
            plane = halve(plane)
        if number in config.levels and min(plane.shape) >= 2 * (config.inner + MARGIN) + 1:
            gradients = gradients_of(plane, config.gain)
            spacing = gray.shape[1] / plane.shape[1]
            levels.append(Level(spacing, gradients, isotropic_sums([gradients], pairs)))
    return levels


def grow_regions(symmetry: Float32Array, config: SymRoidConfig) -> tuple[Labels, FloatArray]:
    """Region growing from the local maxima of a map.

    Args:
        symmetry: (h, w), not negative.
        config: the thresholds.

    Returns:
        (h, w) label of the region of each cell, from 1, 0 for none; (n,) the maximum of each.
        Regions do not touch, not even at corners.
    """
    maximum = float(symmetry.max(initial=0))
    if maximum == 0:
        return np.zeros(symmetry.shape, np.int32), np.zeros(0)
    seeds = symmetry == ndimage.maximum_filter(symmetry, 3)
    seeds &= symmetry >= config.seed_threshold * maximum
    high = (symmetry >= config.growth_threshold * maximum).astype(np.uint8)
    parts = np.asarray(cv2.connectedComponents(high, connectivity=4)[1])
    seeded = np.isin(parts, parts[seeds]) & (parts > 0)
    labels: Labels = np.asarray(
        cv2.connectedComponents(seeded.astype(np.uint8), connectivity=8)[1], np.int32
    )
    maxima = np.zeros(int(labels.max()) + 1)
    np.maximum.at(maxima, labels, symmetry)
    return labels, maxima[1:]


def bounding_boxes(
    labels: IntArray, levels: list[Level], pairs: PairKernel, shape: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Centers of regions, and the boxes about the discs of their strongest pairs.

    Args:
        labels: (h, w) label of the region of each cell, 1 to n, 0 for none.
        levels: of the symmetry.
        pairs: pairs of a cell.
        shape: (H, W) of the image.

    Returns:
        (n, 2) mean of the cells of each, and (n, 4) left, top, right and bottom of its box, both
        in pixels.
    """
    rows, columns = np.nonzero(labels)
    index = labels[rows, columns] - 1
    xy = cell_centers(rows, columns, labels.shape, shape)
    radius = strongest_pair_radius(levels, pairs, xy)[:, None]
    count = int(index.max()) + 1
    total = np.zeros((count, 2))
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.add.at(total, index, xy)
    np.minimum.at(low, index, xy - radius)
    np.maximum.at(high, index, xy + radius)
    low, high = low.clip(-0.5), np.minimum(high, np.array(shape[::-1]) - 0.5)
    return total / np.bincount(index)[:, None], np.hstack([low, high])


def strongest_pair_radius(levels: list[Level], pairs: PairKernel, xy: FloatArray) -> FloatArray:
    """(n,) half the distance of the pair that contributes most to each of (n, 2) positions.

    It is the strongest of all levels; in pixels, 0 where there is none.
    """
    strongest, radius = np.zeros(len(xy)), np.zeros(len(xy))
    scaled = pairs.scaled()
    for level in levels:
        cells = np.floor((xy + 0.5) / level.spacing).astype(np.int64)
        update_strongest_pairs(level.gradients, scaled, level.spacing, cells, strongest, radius)
    return radius


def resampled(gray: Float32Array, box: Float32Array) -> Float32Array:
    """The (PATCH_SIDE, PATCH_SIDE) patch of a box; borders are replicated beyond the image."""
    middle, half = (box[:2] + box[2:]) / 2, MAGNIFICATION * (box[2:] - box[:2]) / 2
    low, high = np.floor(middle - half + 0.5).astype(int), np.ceil(middle + half + 0.5).astype(int)
    rows, columns = (
        np.arange(low[axis], max(high[axis], low[axis] + 2)).clip(0, gray.shape[1 - axis] - 1)
        for axis in (1, 0)
    )
    return resize(gray[np.ix_(rows, columns)], (PATCH_SIDE, PATCH_SIDE))
