"""Corners of tags to a fraction of a pixel.

A line is fitted to the edge between black and white on each side of a tag; adjacent lines are
intersected.
"""

from typing import Any

import numpy as np

from saccade.frames import Camera, directions
from saccade.types import BoolArray, FloatArray

SHARED_SIGMA = 0.02
"""Standard deviation in pixels of a corner of a large, sharp tag."""
BLUR_FACTOR = 0.7
"""Standard deviation in pixels of a corner of a tag whose cells are as wide as its blur."""
POINTS = 16
"""Number of positions along a side at which its edge is located."""
ENDS = 0.12
"""Fraction of a side next to each corner that is not used."""
PROFILE = 25
"""Number of samples across an edge."""
HALF_PROFILE = (1.0, 3.0)
"""Minimum and maximum of half the length of the profile across an edge, in pixels."""
MIN_STEP = 12.0
"""Minimum increase of the gray level across an edge."""
MAX_CORNER_CORRECTION = 3.0
"""Maximum distance between a corner as detected and as refined, in pixels."""


def refined_corners(
    gray: Any, corners: FloatArray, cells: int, camera: Camera | None = None
) -> tuple[FloatArray, FloatArray]:
    """Corners (k, 4, 2) of tags to a fraction of a pixel, and their standard deviations (k,).

    A line is fitted to the edge on each side; the corners are the intersections.

    Args:
        gray: (H, W) gray levels.
        corners: as detected.
        cells: number of cells along a side.
        camera: whose lens bends the sides of tags; None for a lens without distortion.
    """
    found, bent = corners, camera if camera is not None and camera.is_distorted else None
    for _ in range(2):
        found, noise, blur = _intersect_edges(gray, found, cells, bent)
        apart = np.linalg.norm(found - corners, axis=2).max(1)
        found = np.where((apart <= MAX_CORNER_CORRECTION)[:, None, None], found, corners)
    narrow = _side_widths(found).min(1) / cells  # pixels, of the smallest cell
    by_blur = BLUR_FACTOR * np.square(blur / np.maximum(narrow, 0.5))
    sigma = np.sqrt(SHARED_SIGMA**2 + np.square(by_blur) + np.square(noise))
    return found, np.where(
        np.isfinite(sigma) & (apart <= MAX_CORNER_CORRECTION), sigma.clip(max=1.0), 1.0
    )


def _side_widths(corners: FloatArray) -> FloatArray:
    """(k, 4) distance of the opposite side from the middle of each side, in pixels."""
    middle = (corners + np.roll(corners, -1, 1)) / 2
    along = np.roll(corners, -1, 1) - corners
    across = np.roll(middle, -2, 1) - middle
    length = np.maximum(np.linalg.norm(along, axis=2), 1e-9)
    return np.asarray(np.abs(cross(along, across)) / length)


def _intersect_edges(
    gray: Any, corners: FloatArray, cells: int, camera: Camera | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Intersections (k, 4, 2) of the lines along the sides of tags with given corners (k, 4, 2).

    Also (k,) the standard deviation of the lines by their residuals, and (k,) the blur, in pixels.
    """
    along, length, outward = _sides(corners)
    half = np.clip(0.9 * _side_widths(corners).min(1) / cells, *HALF_PROFILE)  # (k,)
    fraction = np.linspace(ENDS, 1 - ENDS, POINTS)
    offset = np.linspace(-1, 1, PROFILE) * half[:, None]  # (k, m)
    points = corners[:, :, None] + fraction[:, None] * along[:, :, None]  # (k, 4, n, 2)
    samples = points[..., None, :] + (
        offset[:, None, None, :, None] * outward[:, :, None, None, :]
    )  # (k, 4, n, m, 2)
    slope = np.diff(_sampled(gray, samples), axis=-1).clip(min=0.0)  # (k, 4, n, m - 1)
    middle = ((offset[:, 1:] + offset[:, :-1]) / 2)[:, None, None]
    step = slope.sum(-1)
    edge = (slope * middle).sum(-1) / np.maximum(step, 1e-9)  # (k, 4, n)
    variance = (slope * np.square(middle - edge[..., None])).sum(-1) / np.maximum(step, 1e-9)
    if camera is not None:  # its sides are straight without distortion
        at_edge = points + edge[..., None] * outward[:, :, None]
        corners = _undistorted(camera, corners)
        along, length, outward = _sides(corners)
        offset = _undistorted(camera, at_edge) - corners[:, :, None]
        edge = np.nan_to_num((offset * outward[:, :, None]).sum(-1))
    line, spread = _fitted_lines(fraction, edge, step > MIN_STEP)
    independent = np.clip((1 - 2 * ENDS) * length, 3, POINTS)
    shift = line @ np.array([[1.0, 1.0], [0.0, 1.0]])  # offsets at both ends
    first = corners + shift[..., :1] * outward
    last = np.roll(corners, -1, 1) + shift[..., 1:] * outward
    before, direction = np.roll(first, 1, 1), last - first
    other = np.roll(direction, 1, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        position = cross(before - first, other) / cross(direction, other)
    found = first + position[..., None] * direction
    found = np.where(np.isfinite(found), found, corners)
    if camera is not None:
        rays = directions(camera.undistorted, found.reshape(-1, 2))
        found = camera.project(rays).reshape(found.shape)
    return (
        found,
        np.sqrt((4 * spread / independent).mean(1)),
        np.sqrt(np.median(variance, axis=2).mean(1)),
    )


def _sides(corners: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Vectors (k, 4, 2) along the sides, clockwise; lengths (k, 4); outward normals (k, 4, 2)."""
    along = np.roll(corners, -1, 1) - corners
    length = np.maximum(np.linalg.norm(along, axis=2), 1e-9)
    return along, length, np.stack([along[..., 1], -along[..., 0]], -1) / length[..., None]


def _undistorted(camera: Camera, xy: FloatArray) -> FloatArray:
    """Pixels (..., 2) of the camera without distortion."""
    return camera.undistort(xy.reshape(-1, 2)).reshape(xy.shape)


def _sampled(gray: Any, xy: FloatArray) -> FloatArray:
    """Gray levels (...) at positions (..., 2) in pixels, linearly interpolated."""
    import cv2  # slow to import

    rows = xy.astype(np.float32).reshape(-1, xy.shape[-2], 2)
    values = [
        cv2.remap(
            gray,
            np.ascontiguousarray(part[..., 0]),
            np.ascontiguousarray(part[..., 1]),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        for part in np.array_split(rows, -(-len(rows) // 30_000))  # OpenCV's limit is 32767
    ]
    return np.concatenate(values).astype(np.float64).reshape(xy.shape[:-1])


def _fitted_lines(x: FloatArray, y: FloatArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Lines y = a + b x through points (..., n): (..., 2), and the variances (...,) around them.

    Points that are not `known`, and outliers, have next to no weight.
    """
    F = np.stack([np.ones_like(x), x], 1)
    base = np.where(known, 1.0, 1e-6)
    weight = base
    for _ in range(2):
        A = np.einsum("...n,na,nb->...ab", weight, F, F)
        line = np.linalg.solve(A, np.einsum("...n,na,...n->...a", weight, F, y)[..., None])[..., 0]
        residual = np.abs(y - line @ F.T)
        limit = 2.5 * (1.48 * np.median(residual, -1, keepdims=True) + 0.02)
        weight = np.where(residual < limit, base, 1e-6)
    spread = (weight * np.square(residual)).sum(-1) / np.maximum(weight.sum(-1) - 2, 1.0)
    return line, spread


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """(...) cross products of vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
