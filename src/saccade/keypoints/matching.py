"""Descriptor matching: nearest neighbors, ratio test and mutual check."""

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ConfigError, require
from saccade.keypoints._neighbor_kernels import update_neighbors
from saccade.types import BoolArray, Float32Array, IntArray, Keypoints

COLUMNS = 512
"""Number of keypoints of the first image in a block of products that fits into the cache."""
ROWS = 512
"""Number of keypoints of the second image in a block of products."""


Descriptors: TypeAlias = npt.NDArray[np.uint8] | Float32Array
Neighbors: TypeAlias = tuple[IntArray, Float32Array, Float32Array, IntArray]
"""See `nearest_neighbors`."""
Excluded: TypeAlias = Callable[[slice, slice], BoolArray]
"""Function of a slice of the r rows of the second image and of the c of the first: (r, c) whether
they are no neighbors."""
Metric: TypeAlias = Literal["euclidean", "hamming"]
"""Distance of descriptors."""
MAX_PACKED_BYTES = 64
"""Largest number of bytes of packed bits: ORB has 32, AKAZE 61, BRISK 64."""
SIFT_LENGTH = 128


def match(
    first: Keypoints,
    second: Keypoints,
    ratio: float | None = 0.8,
    mutual: bool = True,
    metric: Metric | None = None,
) -> IntArray:
    """Match the keypoints of two images by their descriptors.

    Args:
        first: n keypoints with descriptors.
        second: k keypoints with descriptors.
        ratio: keep a match if its distance is under this fraction of the distance to the
            second nearest keypoint of `second`; None keeps all. Where `second` has only one
            keypoint there is no other, and it is kept.
        mutual: keep a match only if each is the other's nearest neighbor.
        metric: "hamming" for packed bits, as of ORB and BRISK, "euclidean" for vectors. None takes
            bytes of up to 64 columns for packed bits, and bytes of 128 columns and all other
            numbers for vectors.

    Returns:
        (m, 2) indices into `first` and `second`, ascending in `first`. Distances are exact; of
        equally near keypoints the first is taken.

    Raises:
        ConfigError: the ratio is not in (0, 1], or the keypoints have no descriptors,
            or descriptors of different lengths or kinds, with NaN or infinity, or of no known
            metric.

    Source: Lowe (2004), section 7.1.
    """
    check_ratio(ratio)
    a, b, power = comparable_descriptors(first, second, metric)
    if not len(a) or not len(b):
        return np.zeros((0, 2), np.int64)
    neighbors = nearest_neighbors(a, b)
    index = np.flatnonzero(passing(neighbors, ratio, power, mutual))
    return np.stack([index, neighbors[0][index]], axis=1)


def check_ratio(ratio: float | None) -> None:
    """Raises `ConfigError` for a ratio that is not in (0, 1]."""
    require(ratio is None or 0 < ratio <= 1, "ratio", "over 0 and at most 1, or None", ratio)


def comparable_descriptors(
    first: Keypoints, second: Keypoints, metric: Metric | None
) -> tuple[Descriptors, Descriptors, int]:
    """The descriptors of both images, and the power of their distance that vectors have squared.

    Raises:
        ConfigError: see `match`.
    """
    a, b = _descriptors(first, "first"), _descriptors(second, "second")
    if a.shape[1] != b.shape[1]:
        raise ConfigError(
            f"second: expected descriptors of length {a.shape[1]} as in the first keypoints, "
            f"found {b.shape[1]}"
        )
    if not len(a) or not len(b):
        return a, b, 2
    if (a.dtype == np.uint8) != (b.dtype == np.uint8):
        raise ConfigError(f"second: expected descriptors of {a.dtype}, found {b.dtype}")
    if not is_hamming(a, metric):
        return a, b, 2
    # Squared distances of unpacked bits count those that differ.
    bits = [np.unpackbits(each.astype(np.uint8), axis=1) for each in (a, b)]
    return bits[0], bits[1], 1


def passing(neighbors: Neighbors, ratio: float | None, power: int, mutual: bool) -> BoolArray:
    """(n,) whether the nearest neighbor of a keypoint passes the ratio test and the mutual check.

    Args:
        neighbors: of `nearest_neighbors`.
        ratio: see `match`.
        power: of the distance that squared distances are.
        mutual: see `match`.
    """
    nearest, distance, second_distance, reverse = neighbors
    kept: BoolArray = np.isfinite(distance)
    if ratio is not None:
        kept &= distance < ratio**power * second_distance
    if mutual:
        kept &= reverse[nearest] == np.arange(len(nearest))
    return kept


def is_hamming(descriptors: Descriptors, metric: Metric | None) -> bool:
    """Whether descriptors are packed bits.

    Raises:
        ConfigError: an unknown metric, or the Hamming distance of numbers that are no bytes; or no
            metric for bytes that may be either.
    """
    is_bytes, size = descriptors.dtype == np.uint8, descriptors.shape[1]
    if metric is None:
        known = not is_bytes or size <= MAX_PACKED_BYTES or size == SIFT_LENGTH
        expected = f'"euclidean" or "hamming" for descriptors of {size} bytes'
        require(known, "metric", expected, metric)
        return bool(is_bytes and size <= MAX_PACKED_BYTES)
    require(metric in ("euclidean", "hamming"), "metric", '"euclidean" or "hamming"', metric)
    bits = metric == "hamming"
    require(bool(is_bytes or not bits), "metric", "bytes of packed bits", descriptors.dtype)
    return bits


def nearest_neighbors(
    a: Descriptors, b: Descriptors, excluded: Excluded | None = None
) -> Neighbors:
    """Nearest neighbors by squared distance, both ways, from one pass over blocks of products.

    Sums of up to 128 products of bytes are integers below 2**24, exact in float32: their
    distances do not depend on the order of the additions. Of equal distances the first row is
    taken.

    Args:
        a: (n, d), n and k at least 1.
        b: (k, d).
        excluded: which pairs are no neighbors; None for all.

    Returns:
        (n,) nearest row of `b`, (n,) its squared distance, (n,) squared distance of the second
        nearest row (infinite without a second one), and (k,) nearest row of `a`. Without a
        neighbor the nearest row is 0 and the distance infinite.
    """
    n, k = len(a), len(b)
    nearest, distance = np.zeros(n, np.int32), np.full(n, np.inf, np.float32)
    reverse, reverse_distance = np.zeros(k, np.int64), np.full(k, np.inf, np.float32)
    second_distance = distance.copy()
    # |b|^2 + |a|^2 - 2 b a is the product of (|b|^2, 1, b) with (1, |a|^2, -2 a).
    norms, points = _squared_norms(a)
    columns = np.hstack([np.ones_like(norms), norms, -2 * points])  # (n, d + 2)
    parts = [slice(start, start + COLUMNS) for start in range(0, n, COLUMNS)]
    blocks = [np.ascontiguousarray(columns[part].T) for part in parts]
    for start in range(0, k, ROWS):
        chosen = slice(start, start + ROWS)
        norms, points = _squared_norms(b[chosen])
        rows = np.hstack([norms, np.ones_like(norms), points])
        for part, block in zip(parts, blocks, strict=True):
            distances = rows @ block
            if excluded is not None:
                distances[excluded(chosen, part)] = np.inf
            update_neighbors(
                *(distances, part.start, start),
                *(nearest[part], distance[part], second_distance[part]),
                *(reverse[chosen], reverse_distance[chosen]),
            )
    return nearest.astype(np.int64), distance, second_distance, reverse


def _squared_norms(rows: Descriptors) -> tuple[Float32Array, Float32Array]:
    """Squared lengths (n, 1) of rows, and the rows as floats."""
    floats = rows.astype(np.float32)
    return np.einsum("ij,ij->i", floats, floats)[:, None], floats


def _descriptors(keypoints: Keypoints, name: str) -> Descriptors:
    if keypoints.descriptors is None:
        raise ConfigError(
            f"{name}: expected keypoints with descriptors, found none; detect with describe=True"
        )
    rows: npt.NDArray[Any] = np.asarray(keypoints.descriptors)
    if rows.ndim != 2 or len(rows) != len(keypoints) or rows.dtype.kind not in "fiu":
        raise ConfigError(
            f"{name}: expected descriptors (n, d) of numbers for {len(keypoints)} keypoints, "
            f"found {rows.dtype} of shape {rows.shape}"
        )
    if rows.dtype == np.uint8:
        return rows
    with np.errstate(over="ignore"):
        floats = rows.astype(np.float32)
        valid = np.isfinite(np.einsum("ij,ij->i", floats, floats))
    if not valid.all():
        row = int(np.argmin(valid))
        raise ConfigError(
            f"{name}: expected finite descriptors whose squares are float32, found "
            f"{rows[row].min()} to {rows[row].max()} for keypoint {row}"
        )
    return floats
