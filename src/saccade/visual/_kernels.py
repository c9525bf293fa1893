"""Compiled loops over points: normal equations of the egomotion, and warping of the ground."""

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.types import FloatArray

MIN_DEPTH_RATIO = 0.05
"""Least depth after the motion as a fraction of that before; points below it are ignored."""
MAX_INVERSE_DEPTH = 1.0
"""Upper bound of the estimated inverse depths, in 1 / metres."""


ShortArray: TypeAlias = npt.NDArray[np.int16]


class Intrinsics(NamedTuple):
    """Focal lengths and principal point, in pixels."""

    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) camera matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])


class ImageGradients(NamedTuple):
    """An image and its derivatives (Sobel)."""

    intensity: ShortArray
    """(h, w) gray levels."""
    dx: ShortArray
    """(h, w) eight times the derivative along a row."""
    dy: ShortArray
    """(h, w) eight times the derivative along a column."""


class Correspondences(NamedTuple):
    """k points observed in two frames; inverse depths are 1 / metres along the optical axis."""

    previous: FloatArray
    current: FloatArray
    """(k, 2) pixels in the first and in the second frame."""
    inverse_depth: FloatArray
    inverse_depth_sigma: FloatArray
    """(k,) in the first frame, and its standard deviation: 1 where the depth is unknown."""
    current_inverse_depth: FloatArray
    current_inverse_depth_sigma: FloatArray
    """(k,) in the second frame, NaN where it was not measured, and its standard deviation."""


@kernel()
def accumulate_normal_equations(
    points: Correspondences,
    intrinsics: Intrinsics,
    R: FloatArray,
    t: FloatArray,
    pixel_sigma: float,
    kernel_width: float,
    inverse_depth: FloatArray,
    information: FloatArray,
    gradient: FloatArray,
    squared_residual: FloatArray,
) -> None:
    """One Gauss-Newton iteration over k points, the inverse depths marginalized.

    The residual of a point has the covariance N = A + s^2 d d^T, of pixels and depth in the
    second frame (A) and of the inverse depth in the first (s): N^-1 = A^-1 - q g g^T with
    g = A^-1 d, q = s^2 / (1 + s^2 d^T g) (Sherman & Morrison, 1950).

    Args:
        points: k correspondences.
        intrinsics: of the camera.
        R: (3, 3) of the `CameraPose`.
        t: (3,) of it.
        pixel_sigma: standard deviation of a pixel, in each axis.
        kernel_width: width of the robust kernel, in standard deviations.
        inverse_depth: (k,) linearization points; overwritten by the estimates for this motion.
        information: (6, 6) by rotation and translation, added to.
        gradient: (6,), added to.
        squared_residual: (k,) overwritten by the normalized squares; infinite behind the camera.
    """
    fx, fy, cx, cy = intrinsics
    P, J, d = np.zeros((3, 3)), np.empty((3, 6)), np.empty(3)
    residual, weight, g, Jg = np.empty(3), np.ones(3), np.empty(3), np.empty(6)
    for i in range(len(inverse_depth)):
        h = inverse_depth[i]
        u, v = (points.previous[i, 0] - cx) / fx, (points.previous[i, 1] - cy) / fy
        a = R[0, 0] * u + R[0, 1] * v + R[0, 2]
        b = R[1, 0] * u + R[1, 1] * v + R[1, 2]
        c = R[2, 0] * u + R[2, 1] * v + R[2, 2]
        z = c + h * t[2]
        if z <= MIN_DEPTH_RATIO:
            squared_residual[i] = np.inf
            continue
        x, y = (a + h * t[0]) / z, (b + h * t[1]) / z
        measured = np.isfinite(points.current_inverse_depth[i])
        predicted = h / z if measured else 0.0
        residual[0] = points.current[i, 0] - (fx * x + cx)
        residual[1] = points.current[i, 1] - (fy * y + cy)
        residual[2] = points.current_inverse_depth[i] - predicted if measured else 0.0
        weight[0] = weight[1] = 1 / (2 * pixel_sigma**2)  # A^-1; the pixels of both frames err
        weight[2] = 1 / points.current_inverse_depth_sigma[i] ** 2 if measured else 1.0
        P[0, 0], P[0, 2], P[1, 1], P[1, 2] = fx / z, -fx * x / z, fy / z, -fy * y / z
        P[2, 2] = -predicted / z  # P: Jacobian by the point, divided by its previous depth
        for j in range(3):
            J[j, 0] = P[j, 2] * b - P[j, 1] * c
            J[j, 1] = P[j, 0] * c - P[j, 2] * a
            J[j, 2] = P[j, 1] * a - P[j, 0] * b
            d[j] = 0.0
            for m in range(3):
                J[j, 3 + m] = h * P[j, m]
                d[j] += P[j, m] * t[m]
        d[2] += 1 / z if measured else 0.0
        dg, residual_g, square = 0.0, 0.0, 0.0
        for j in range(3):
            residual[j] += d[j] * (h - points.inverse_depth[i])
            g[j] = weight[j] * d[j]
            dg += d[j] * g[j]
            residual_g += residual[j] * g[j]
            square += residual[j] ** 2 * weight[j]
        variance = points.inverse_depth_sigma[i] ** 2
        q = variance / (1 + variance * dg)
        estimate = points.inverse_depth[i] + q * residual_g
        inverse_depth[i] = min(max(estimate, 0.0), MAX_INVERSE_DEPTH)
        squared_residual[i] = square - q * residual_g**2
        robust = 1 / (1 + squared_residual[i] / kernel_width**2) ** 2  # Geman & McClure (1987)
        for m in range(6):
            Jg[m] = J[0, m] * g[0] + J[1, m] * g[1] + J[2, m] * g[2]
        for m in range(6):
            gradient[m] -= robust * q * Jg[m] * residual_g
            for j in range(3):
                gradient[m] += robust * J[j, m] * weight[j] * residual[j]
            for k in range(6):
                information[m, k] -= robust * q * Jg[m] * Jg[k]
                for j in range(3):
                    information[m, k] += robust * J[j, m] * weight[j] * J[j, k]


@kernel()
def warp_ground(
    rays: FloatArray,
    intensity: FloatArray,
    intrinsics: Intrinsics,
    R: FloatArray,
    direction: FloatArray,
    distance: float,
    plane: FloatArray,
    image: ImageGradients,
    warped: FloatArray,
    J: FloatArray,
) -> int:
    """Sample the next image at m points of the ground plane.

    Args:
        rays: (m, 3) of the points in the previous camera frame.
        intensity: (m,) of the points in the previous image.
        intrinsics: of the next image.
        R: (3, 3) rotation of the camera.
        direction: (3,) unit vector of its translation.
        distance: length of the translation, in camera heights.
        plane: (3, 3) normal of the plane, of length 1 where it has no tilt, and `distance` times
            its derivatives by the two tilts.
        image: the next image (h, w) and its gradients.
        warped: (m,) overwritten by the sampled intensities.
        J: (m, 5) overwritten by their derivatives by distance and tilts; and by gain and offset:
            the negated previous intensity and -1.

    Returns:
        The number of points inside the image, whose rows of `warped` and `J` are filled.
    """
    fx, fy, cx, cy = intrinsics
    height, width = image.intensity.shape
    n = 0
    for i in range(len(rays)):
        a, b, c = rays[i, 0], rays[i, 1], rays[i, 2]
        shift = distance * (a * plane[0, 0] + b * plane[0, 1] + c * plane[0, 2])
        z = a * R[2, 0] + b * R[2, 1] + c * R[2, 2] + shift * direction[2]
        if z <= 0.0:
            continue
        u = (a * R[0, 0] + b * R[0, 1] + c * R[0, 2] + shift * direction[0]) / z
        v = (a * R[1, 0] + b * R[1, 1] + c * R[1, 2] + shift * direction[1]) / z
        x, y = u * fx + cx, v * fy + cy
        if not (1 < x < width - 2 and 1 < y < height - 2):
            continue
        slope = bilinear(image.dx, x, y) / 8 * (direction[0] - u * direction[2]) / z * fx
        slope += bilinear(image.dy, x, y) / 8 * (direction[1] - v * direction[2]) / z * fy
        for j in range(3):
            J[n, j] = slope * (a * plane[j, 0] + b * plane[j, 1] + c * plane[j, 2])
        J[n, 3], J[n, 4] = -intensity[i], -1.0
        warped[n] = bilinear(image.intensity, x, y)
        n += 1
    return n


@kernel()
def bilinear(image: ShortArray, x: float, y: float) -> float:
    """Bilinear interpolation of an image at a sub-pixel position."""
    i, j = int(y), int(x)
    p, q = y - i, x - j
    upper: float = (1 - q) * image[i, j] + q * image[i, j + 1]
    lower: float = (1 - q) * image[i + 1, j] + q * image[i + 1, j + 1]
    return (1 - p) * upper + p * lower


@kernel()
def _times_transposed(A: FloatArray, B: FloatArray, product: FloatArray) -> None:
    """Fill A B^T of matrices (3, 3)."""
    for r in range(3):
        for c in range(3):
            product[r, c] = A[r, 0] * B[c, 0] + A[r, 1] * B[c, 1] + A[r, 2] * B[c, 2]


@kernel()
def robot_motion_kernel(
    R: FloatArray,
    t: FloatArray,
    after: FloatArray,
    before: FloatArray,
    position: FloatArray,
    motion: FloatArray,
    jacobian: FloatArray,
) -> None:
    """The robot's motion of a `CameraPose`; see `saccade.visual.egomotion.robot_motion`.

    Args:
        R: (3, 3) of the pose.
        t: (3,) of it.
        after: (3, 3) rotation from the camera's frame into the robot's after the motion.
        before: (3, 3) before it.
        position: (3,) of the camera in the robot's frame.
        motion: (6,) overwritten by control and off-plane motion.
        jacobian: (6, 6) overwritten by its derivative by rotation vector and translation.
    """
    turned, rotation = np.empty((3, 3)), np.empty((3, 3))
    into, moved, back = np.zeros((3, 3)), np.empty(3), np.empty(3)
    _times_transposed(before, R, turned)
    _times_transposed(after, turned, rotation)  # after R before^T
    for r in range(3):
        moved[r] = after[r, 0] * t[0] + after[r, 1] * t[1] + after[r, 2] * t[2] + position[r]
        back[r] = moved[r]
        for k in range(3):
            back[r] -= rotation[r, k] * position[k]
            for c in range(3):
                into[r, c] += rotation[k, r] * after[k, c]
    for r, place in enumerate((0, 1, 3)):
        motion[place] = -(
            rotation[0, r] * back[0] + rotation[1, r] * back[1] + rotation[2, r] * back[2]
        )
        for c in range(3):
            x, y, z = after[0, c], after[1, c], after[2, c]
            jacobian[place, 3 + c] = -into[r, c]
            jacobian[place, c] = (
                rotation[0, r] * (y * moved[2] - z * moved[1])
                + rotation[1, r] * (z * moved[0] - x * moved[2])
                + rotation[2, r] * (x * moved[1] - y * moved[0])
            )
    motion[2] = np.arctan2(rotation[0, 1], rotation[0, 0])
    motion[4] = np.arctan2(rotation[1, 2], rotation[2, 2])
    motion[5] = np.arctan2(-rotation[0, 2], np.hypot(rotation[0, 0], rotation[0, 1]))
    for angle, axis in ((2, 2), (4, 0), (5, 1)):
        for c in range(3):
            jacobian[angle, c], jacobian[angle, 3 + c] = -into[axis, c], 0.0
