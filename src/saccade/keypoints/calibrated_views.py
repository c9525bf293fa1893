"""Calibration of two views, and their matches in the planes z = 1."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import require
from saccade.frames import Camera
from saccade.keypoints.two_view_fit import project
from saccade.keypoints.two_view_models import Matches
from saccade.types import FloatArray

Intrinsics: TypeAlias = npt.ArrayLike | Camera | Sequence[npt.ArrayLike | Camera]
"""A (3, 3) camera matrix or a camera of both images, or a pair of these."""

LENS_STEP = 1e-4
"""Step of the differences of a lens model, in the plane z = 1."""
MIN_AREA = 1e-12
"""Smallest area of that plane in an image, in square pixels."""


@dataclass(frozen=True, eq=False)
class View:
    """Calibration of one of two images."""

    matrix: FloatArray
    """(3, 3)."""
    camera: Camera | None = None
    """Camera with a lens model; None without distortion."""

    def pixel(self, rays: FloatArray) -> FloatArray:
        """(m,) size of a pixel in the plane z = 1 at positions (m, 2) there.

        Behind a lens that is the root of the area of a pixel, which grows towards the rim of a
        wide image.
        """
        if self.camera is None:
            return np.full(len(rays), 1 / np.sqrt(self.matrix[0, 0] * self.matrix[1, 1]))
        points = np.c_[rays, np.ones(len(rays))]
        by_x, by_y = (
            (self.camera.project(points + step) - self.camera.project(points - step))
            / (2 * LENS_STEP)
            for step in LENS_STEP * np.eye(3)[:2]
        )
        area = np.abs(by_x[:, 0] * by_y[:, 1] - by_x[:, 1] * by_y[:, 0])
        sizes: FloatArray = 1 / np.sqrt(np.maximum(area, MIN_AREA))
        return sizes

    def rays(self, xy: FloatArray) -> FloatArray:
        """(m, 2) positions in the plane z = 1 of pixels (m, 2); NaN outside the lens model."""
        ideal = xy if self.camera is None else self.camera.undistort(xy)
        return project(np.asarray(np.linalg.inv(self.matrix), np.float64), ideal)


def views_of(
    intrinsics: Intrinsics | None, distortion: Sequence[Any] | None = None
) -> tuple[View, View]:
    """The calibration of both images.

    Raises:
        ConfigError: no camera matrices (3, 3), or other numbers of cameras and of coefficients.
    """
    expected = "a (3, 3) camera matrix, a Camera, or a pair of these"
    require(intrinsics is not None, "intrinsics", expected, None)
    both: list[Any]
    if isinstance(intrinsics, list | tuple) and len(intrinsics) == 2:
        both, coefficients = [*intrinsics], [None, None] if distortion is None else [*distortion]
    else:
        both, coefficients = [intrinsics] * 2, [distortion] * 2
    require(len(coefficients) == 2, "distortion", "one list for each camera", distortion)
    first, second = map(view_of, both, coefficients)
    return first, second


def view_of(intrinsics: Any, distortion: Any = None) -> View:
    """The calibration of an image; see `views_of`."""
    if isinstance(intrinsics, Camera):
        require(distortion is None, "distortion", "none beside a Camera", distortion)
        return View(intrinsics.matrix, intrinsics if intrinsics.is_distorted else None)
    expected = "a (3, 3) camera matrix, a Camera, or a pair of these"
    try:
        K = np.asarray(intrinsics, np.float64)
    except (TypeError, ValueError):
        K = np.zeros(0)
    valid = K.shape == (3, 3) and bool(np.isfinite(K).all()) and K[0, 0] * K[1, 1] > 0
    require(valid and bool(np.linalg.det(K) != 0), "intrinsics", expected, intrinsics)
    if distortion is None or not np.any(distortion):
        return View(K)
    coefficients = tuple(np.asarray(distortion, np.float64).ravel().tolist())
    return View(K, Camera.from_matrix(K, (1, 1), distortion=coefficients))


def matches_in(matched: FloatArray, sigma: FloatArray, views: tuple[View, View] | None) -> Matches:
    """Matches in the planes z = 1 of calibrated views, else in pixels."""
    if views is None:
        return Matches(matched, sigma, np.ones(sigma.shape))
    rays = [
        view.rays(matched[:, part])
        for view, part in zip(views, (slice(2), slice(2, 4)), strict=True)
    ]
    pixel = np.stack([view.pixel(each) for view, each in zip(views, rays, strict=True)], axis=1)
    return Matches(np.hstack(rays), sigma * pixel, pixel)
