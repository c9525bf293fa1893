"""Egomotion: motion of the robot between two frames, from point correspondences."""

from typing import NamedTuple, TypeAlias

import cv2
import numpy as np

from saccade.frames import Camera, directions
from saccade.types import BoolArray, Float32Array, FloatArray
from saccade.visual.robot_motion import CameraPose, camera_motion, cross_matrix, robot_motion

MotionEstimate: TypeAlias = tuple[FloatArray, FloatArray]
"""Expected control (3,), and its covariance (3, 3)."""

MIN_DEPTH_RATIO = 0.05
"""Minimum ratio of the depths after and before the motion; nearer points are ignored."""
MAX_INVERSE_DEPTH = 1.0
"""Upper bound of the estimated inverse depths, in 1 / meters."""
DEFAULT_DEPTH = 50.0
"""Linearization point of unknown depths, in meters."""
MIN_MOTION_INLIERS = 6
"""Minimum number of inliers of a motion."""
MOTION_INLIER_SIGMAS = 4.0
"""Maximum residual of an inlier, in standard deviations."""
MAX_REPROJECTION_ERROR = 1.5
"""Maximum reprojection error of an inlier of RANSAC, in pixels."""
RANSAC_SAMPLES = 100
"""Number of samples of RANSAC."""
MAX_RELATIVE_SIGMA = 0.5
"""Maximum relative standard deviation of an inverse depth used by RANSAC."""
OFF_PLANE_SIGMA = (0.05, 0.02, 0.02)
"""Standard deviations of the change of height in meters, and of roll and pitch in radians, between
two frames: a prior for motions that odometry predicts."""
KERNEL_WIDTHS = (16.0, 8.0, 4.0, 2.0)
"""Widths of the robust kernel in successive iterations, in standard deviations (graduated
non-convexity). Later iterations use the last width; after RANSAC the last two suffice."""
MAX_MOTION_ITERATIONS = 12
"""Maximum number of Gauss-Newton iterations."""
CONVERGED_MOTION = 1e-6
"""Maximum change of a converged motion, in radians and meters."""


class Correspondences(NamedTuple):
    """k points observed in two frames; inverse depths are in 1 / meters along the optical axis."""

    previous: FloatArray
    """(k, 2) pixels in the first frame."""
    current: FloatArray
    """(k, 2) pixels in the second frame."""
    inverse_depth: FloatArray
    """(k,) inverse depths in the first frame."""
    inverse_depth_sigma: FloatArray
    """(k,) standard deviations of `inverse_depth`; 1 where the depth is unknown."""
    current_inverse_depth: FloatArray
    """(k,) inverse depths in the second frame; NaN where not measured."""
    current_inverse_depth_sigma: FloatArray
    """(k,) standard deviations of `current_inverse_depth`."""


class Egomotion(NamedTuple):
    """Motion between two frames, estimated from the images."""

    control: FloatArray
    """(3,) control on the ground plane: meters ahead, meters to the left, radians."""
    off_plane: FloatArray
    """(3,) changes of height in meters, of roll (to the right) and pitch (down) in radians."""
    covariance: FloatArray
    """(3, 3) covariance of the control."""
    inliers: BoolArray
    """(k,) whether each correspondence is an inlier."""
    rotation: FloatArray
    """(3, 3) rotation from the previous camera frame to the current one."""
    translation: FloatArray
    """(3,) previous camera center in the current camera frame, in meters."""


def correspondences_of(
    previous: Float32Array,
    current: Float32Array,
    depth: FloatArray,
    depth_sigma: FloatArray,
    current_depth: FloatArray,
    current_depth_sigma: FloatArray,
) -> Correspondences:
    """Correspondences of pixels (k, 2) with depths (k,) in meters; NaN where unknown."""
    known = np.isfinite(depth)
    inverse = 1 / np.where(known, depth, DEFAULT_DEPTH)
    current_inverse = 1 / current_depth
    return Correspondences(
        previous.astype(np.float64),
        current.astype(np.float64),
        inverse,
        np.where(known, np.nan_to_num(depth_sigma) * inverse**2, 1.0),
        current_inverse,
        np.nan_to_num(current_depth_sigma * current_inverse**2, nan=1.0),
    )


def estimate_motion(
    camera: Camera,
    points: Correspondences,
    pixel_sigma: float,
    prior: MotionEstimate | None,
    before: Camera | None = None,
    kernel: tuple[float, ...] | None = None,
) -> Egomotion | None:
    """Maximum-likelihood motion of k correspondences: RANSAC, then robust Gauss-Newton.

    The `prior`, an expected control, is part of the estimate; with measured depths none is needed.
    `camera` is the camera in the second frame, `before` the camera in the first, if it was turned.
    `kernel` are the widths of the robust kernel (see `KERNEL_WIDTHS`). Returns None if the motion
    has too few inliers.
    """
    if len(points.previous) < MIN_MOTION_INLIERS:
        return None
    if prior is None:
        initial = _ransac_motion(camera, points)
    else:
        initial = camera_motion(camera, prior[0], before)
    if initial is None:
        return None
    R, t = initial
    inverse_depth = points.inverse_depth
    weight = np.zeros((6, 6))  # information of the prior
    if prior is not None:
        J = robot_motion(camera, R, np.zeros(3), before).jacobian
        weight = J.T @ np.linalg.solve(with_off_plane(prior[1]), J)
    widths = kernel or (KERNEL_WIDTHS[-2:] if prior is None else KERNEL_WIDTHS)
    for i in range(MAX_MOTION_ITERATIONS):
        offset = np.append(cv2.Rodrigues(R @ initial[0].T)[0], t - initial[1])
        width = widths[min(i, len(widths) - 1)]
        information, gradient, squared, inverse_depth = normal_equations(
            camera, points, (R, t), inverse_depth, pixel_sigma, width
        )
        information += weight + 1e-9 * np.eye(6)
        step = np.linalg.solve(information, gradient - weight @ offset)
        R, t = cv2.Rodrigues(step[:3])[0] @ R, t + step[3:]
        if i >= len(widths) and np.abs(step).max() < CONVERGED_MOTION:
            break
    inliers = squared < MOTION_INLIER_SIGMAS**2
    if inliers.sum() < MIN_MOTION_INLIERS:
        return None
    control, off_plane, J = robot_motion(camera, R, t, before)
    J = J[:3]
    covariance = J @ np.linalg.inv(information) @ J.T
    covariance = (covariance + covariance.T) / 2
    return Egomotion(control, off_plane, covariance, inliers, R, t)


def normal_equations(
    camera: Camera,
    points: Correspondences,
    pose: CameraPose,
    inverse_depth: FloatArray,
    pixel_sigma: float,
    kernel_width: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Normal equations of a Gauss-Newton iteration with marginalized inverse depths.

    The residual of a point has the covariance A + s^2 d d^T, of pixels and depth in the second
    frame (A) and of the inverse depth in the first (s). Its inverse is A^-1 - q g g^T with
    g = A^-1 d, q = s^2 / (1 + s^2 d^T g) (Sherman & Morrison, 1950).

    The residuals are linearized about `pose` and the inverse depths (k,). `kernel_width` is in
    standard deviations.

    Returns:
        Information (6, 6) and gradient (6,) by rotation vector and translation; normalized squared
        residuals (k,), infinite behind the camera; and inverse depths (k,) for this motion.
    """
    (R, t), h = pose, inverse_depth
    rotated = directions(camera, points.previous) @ R.T
    moved = rotated + h[:, None] * t
    ahead = moved[:, 2] > MIN_DEPTH_RATIO
    z = np.where(ahead, moved[:, 2], 1.0)
    measured = np.isfinite(points.current_inverse_depth)
    focal, predicted = np.array([camera.fx, camera.fy]), measured * h / z
    from_center = moved[:, :2] / z[:, None] * focal
    residual, weight = np.zeros((len(h), 3)), np.ones((len(h), 3))
    residual[:, :2] = points.current - from_center - (camera.cx, camera.cy)
    residual[measured, 2] = (points.current_inverse_depth - predicted)[measured]
    weight[:, :2] = 1 / (2 * pixel_sigma**2)  # the pixels of both frames err
    weight[measured, 2] = 1 / points.current_inverse_depth_sigma[measured] ** 2
    by_point = np.zeros((len(h), 3, 3))  # divided by the depth in the first frame
    by_point[:, [0, 1], [0, 1]] = focal / z[:, None]
    by_point[:, :2, 2] = -from_center / z[:, None]
    by_point[:, 2, 2] = -predicted / z
    J = np.concatenate([-by_point @ cross_matrix(rotated), h[:, None, None] * by_point], 2)
    d = by_point @ t
    d[:, 2] += measured / z
    residual += d * (h - points.inverse_depth)[:, None]
    g, variance = weight * d, points.inverse_depth_sigma**2
    q = variance / (1 + variance * (d * g).sum(1))
    along = (residual * g).sum(1)
    squared = (residual**2 * weight).sum(1) - q * along**2
    estimate = (points.inverse_depth + q * along).clip(0.0, MAX_INVERSE_DEPTH)
    robust = ahead / (1 + squared / kernel_width**2) ** 2  # Geman & McClure (1987)
    inverse = weight[:, :, None] * np.eye(3) - q[:, None, None] * g[:, :, None] * g[:, None]
    weighted = (robust[:, None, None] * (inverse @ J)).reshape(-1, 6)
    information, gradient = J.reshape(-1, 6).T @ weighted, residual.ravel() @ weighted
    return information, gradient, np.where(ahead, squared, np.inf), np.where(ahead, estimate, h)


def with_off_plane(covariance: FloatArray) -> FloatArray:
    """Covariance (6, 6) of control and off-plane motion, given the control's (3, 3)."""
    total = np.diag(np.square([0.0, 0.0, 0.0, *OFF_PLANE_SIGMA]))
    total[:3, :3] = covariance + 1e-10 * np.eye(3)
    return total


def _ransac_motion(camera: Camera, points: Correspondences) -> CameraPose | None:
    """Initial motion from the points of known depth; None if RANSAC fails."""
    known = points.inverse_depth_sigma < MAX_RELATIVE_SIGMA * points.inverse_depth
    if known.sum() < MIN_MOTION_INLIERS:
        return None
    xyz = directions(camera, points.previous[known]) / points.inverse_depth[known, None]
    solution = perspective_n_point(
        camera, xyz, points.current[known], method=cv2.SOLVEPNP_EPNP, confidence=0.999
    )
    return None if solution is None or solution[2] < MIN_MOTION_INLIERS else solution[:2]


def perspective_n_point(
    camera: Camera, points: FloatArray, xy: FloatArray, *, method: int, confidence: float
) -> tuple[FloatArray, FloatArray, int] | None:
    """Perspective-n-point with RANSAC: R (3, 3), t (3,) and number of inliers; None if it fails.

    Points (k, 3) are in meters in the first camera frame, pixels (k, 2) in the second image.
    `method` is a `cv2.SolvePnPMethod`, `confidence` the probability of an outlier-free sample.
    """
    solved, rotation, translation, inliers = cv2.solvePnPRansac(
        *(points, xy, camera.matrix, None),
        iterationsCount=RANSAC_SAMPLES,
        reprojectionError=MAX_REPROJECTION_ERROR,
        confidence=confidence,
        flags=method,
    )
    if not solved or inliers is None:
        return None
    R = np.asarray(cv2.Rodrigues(rotation)[0], np.float64)
    return R, np.asarray(translation, np.float64).ravel(), len(inliers)
