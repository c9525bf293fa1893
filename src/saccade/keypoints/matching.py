"""Nearest neighbors among descriptors, ratio test and mutual check."""

import numpy as np
import numpy.typing as npt

from saccade.errors import ConfigError, require
from saccade.types import Float32Array, IntArray, Keypoints

BLOCK = 1 << 22
"""Distances held at a time: 16 MB."""


def match(
    first: Keypoints, second: Keypoints, ratio: float | None = 0.8, mutual: bool = True
) -> IntArray:
    """Pair the points of two images by their descriptors.

    Args:
        first: n points with descriptors.
        second: k points with descriptors.
        ratio: keep a pair if its distance is under this share of the distance to the
            second nearest point of `second`; None keeps all. Where `second` has but one
            point there is no other, and it is kept.
        mutual: keep a pair only if each is the other's nearest.

    Returns:
        (m, 2) indices into `first` and `second`, ascending in `first`. Distances are
        Euclidean and exact; of equally near points the first is taken.

    Raises:
        ConfigError: the ratio is not in (0, 1], or the points have no descriptors, or
            descriptors of different lengths.

    Source: Lowe (2004), section 7.1.
    """
    require(ratio is None or 0 < ratio <= 1, "ratio", "over 0 and at most 1, or None", ratio)
    a, b = _descriptors(first, "first"), _descriptors(second, "second")
    if a.shape[1] != b.shape[1]:
        raise ConfigError(
            f"second: expected descriptors of length {a.shape[1]} as in the first points, "
            f"found {b.shape[1]}"
        )
    if not len(a) or not len(b):
        return np.zeros((0, 2), np.int64)
    nearest, distance, runner_up, back = nearest_neighbors(a, b)
    kept = np.ones(len(a), np.bool_)
    if ratio is not None:
        kept &= distance < ratio**2 * runner_up
    if mutual:
        kept &= back[nearest] == np.arange(len(a))
    index = np.flatnonzero(kept)
    return np.stack([index, nearest[index]], axis=1)


def nearest_neighbors(
    a: npt.NDArray[np.uint8] | Float32Array, b: npt.NDArray[np.uint8] | Float32Array
) -> tuple[IntArray, Float32Array, Float32Array, IntArray]:
    """Nearest rows by squared distance, both ways, from one pass over blocks of `a`.

    Any real descriptors will do. Of bytes sums of up to 128 products are whole numbers below
    2**24, which float32 holds: their distances are exact in whatever order the library adds.

    Args:
        a: (n, d), n and k at least 1.
        b: (k, d).

    Returns:
        (n,) nearest row of `b`, (n,) its squared distance, (n,) that of the second nearest
        (infinite where k is 1), and (k,) the nearest row of `a`.
    """
    n, k = len(a), len(b)
    nearest, distance = np.empty(n, np.int64), np.empty(n, np.float32)
    runner_up = np.empty(n, np.float32)
    back, back_distance = np.zeros(k, np.int64), np.full(k, np.inf, np.float32)
    columns = np.ascontiguousarray(b.astype(np.float32).T)  # (d, k)
    column_norms = np.einsum("ij,ij->j", columns, columns)
    rows_at_once = max(BLOCK // k, 1)
    for start in range(0, n, rows_at_once):
        rows = a[start : start + rows_at_once].astype(np.float32)
        block = rows @ columns  # (r, k)
        block *= -2
        block += np.einsum("ij,ij->i", rows, rows)[:, None]
        block += column_norms
        here, every = slice(start, start + len(rows)), np.arange(len(rows))

        closest = block.argmin(axis=0)
        closest_distance = block[closest, np.arange(k)]
        closer = closest_distance < back_distance
        back[closer] = closest[closer] + start
        back_distance[closer] = closest_distance[closer]

        nearest[here] = block.argmin(axis=1)
        distance[here] = block[every, nearest[here]]
        block[every, nearest[here]] = np.inf
        runner_up[here] = block.min(axis=1)
    return nearest, distance, runner_up, back


def _descriptors(points: Keypoints, name: str) -> npt.NDArray[np.uint8] | npt.NDArray[np.float32]:
    if points.descriptors is None:
        raise ConfigError(
            f"{name}: expected points with descriptors, found none; detect with describe=True"
        )
    return points.descriptors
