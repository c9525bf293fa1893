"""Egomotion: the robot's motion between two frames, from point correspondences."""

from typing import NamedTuple, TypeAlias

import cv2
import numpy as np

from saccade.frames import Camera
from saccade.types import BoolArray, Float32Array, FloatArray
from saccade.visual._kernels import (
    Correspondences,
    accumulate_normal_equations,
    robot_motion_kernel,
)
from saccade.visual.camera import directions, intrinsics_of

MotionEstimate: TypeAlias = tuple[FloatArray, FloatArray]
"""Expected control (3,), and its covariance (3, 3)."""
CameraPose: TypeAlias = tuple[FloatArray, FloatArray]
"""R (3, 3) and t (3,) in metres: points X of the first camera frame become R X + t."""

DEFAULT_DEPTH = 50.0
"""Linearization point of unknown depths, in metres."""
MIN_INLIERS = 6
"""Least number of correspondences that agree on a motion."""
INLIER_SIGMAS = 4.0
"""Standard deviations of the residual within which a correspondence is an inlier."""
MAX_REPROJECTION_ERROR, MAX_TRIALS = 1.5, 100
"""RANSAC: reprojection error of an inlier in pixels, and the number of samples."""
MAX_RELATIVE_SIGMA = 0.5
"""Largest relative standard deviation of an inverse depth that RANSAC uses."""
OFF_PLANE_SIGMA = (0.05, 0.02, 0.02)
"""Standard deviations of height in metres, roll and pitch in radians from one frame to the next,
where the points have no depth."""
KERNEL_WIDTHS = (16.0, 8.0, 4.0, 2.0)
"""Widths of the robust kernel by iteration, in standard deviations (graduated non-convexity);
the last one stays, and the last two suffice where RANSAC gave the initial motion."""
MAX_ITERATIONS, CONVERGED = 12, 1e-6
"""Of Gauss-Newton; the largest change at which it stops."""


class RobotMotion(NamedTuple):
    """The motion of the robot of a `CameraPose`."""

    control: FloatArray
    """(3,) metres ahead and to the left, radians turned, on the ground plane."""
    off_plane: FloatArray
    """(3,) change of height in metres, of roll (to the right) and pitch (down) in radians."""
    jacobian: FloatArray
    """(6, 6) of both by the camera's rotation vector and translation, to first order in roll and
    pitch."""


class Egomotion(NamedTuple):
    """The motion from one frame to the next, estimated from the images."""

    control: FloatArray
    """(3,) metres ahead and to the left, radians turned, on the ground plane."""
    off_plane: FloatArray
    """(3,) change of height in metres, of roll (to the right) and pitch (down) in radians."""
    covariance: FloatArray
    """(3, 3) of the control."""
    inliers: BoolArray
    """(k,) whether each correspondence agrees with the motion."""
    rotation: FloatArray
    """(3, 3) from the previous camera frame to the current one."""
    translation: FloatArray
    """(3,) previous camera center in the current camera frame, in metres."""
    includes_prior: bool
    """Whether the prior is part of the control: a single camera does not measure its length."""


def correspondences_of(
    previous: Float32Array,
    current: Float32Array,
    depth: FloatArray,
    depth_sigma: FloatArray,
    current_depth: FloatArray,
    current_depth_sigma: FloatArray,
) -> Correspondences:
    """Correspondences of pixels (k, 2) with depths (k,) in metres, NaN where unknown."""
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
) -> Egomotion | None:
    """Maximum-likelihood motion of k correspondences: RANSAC, then robust Gauss-Newton.

    Args:
        camera: the calibration.
        points: k correspondences.
        pixel_sigma: standard deviation of a pixel, in each axis.
        prior: the expected control, which becomes part of the estimate; None where measured
            depths determine the whole motion.
        before: the camera as it was turned in the first frame; None if as in the second.

    Returns:
        The motion, or None where too few correspondences agree on one.
    """
    if len(points.previous) < MIN_INLIERS:
        return None
    if prior is None:
        initial = _ransac_motion(camera, points)
    else:
        initial = camera_motion(camera, prior[0], before)
    if initial is None:
        return None
    R, t = initial
    inverse_depth, squared = points.inverse_depth.copy(), np.empty(len(points.previous))
    weight = np.zeros((6, 6)) if prior is None else _prior_information(camera, prior[1], R, before)
    widths = KERNEL_WIDTHS[-2:] if prior is None else KERNEL_WIDTHS
    for i in range(MAX_ITERATIONS):
        offset = np.append(cv2.Rodrigues(R @ initial[0].T)[0], t - initial[1])
        information, gradient = weight + 1e-9 * np.eye(6), -weight @ offset
        width = widths[min(i, len(widths) - 1)]
        accumulate_normal_equations(
            *(points, intrinsics_of(camera), R, t, float(pixel_sigma), width),
            *(inverse_depth, information, gradient, squared),
        )
        step = np.linalg.solve(information, gradient)
        R, t = cv2.Rodrigues(step[:3])[0] @ R, t + step[3:]
        if i >= len(widths) and np.abs(step).max() < CONVERGED:
            break
    inliers = squared < INLIER_SIGMAS**2
    if inliers.sum() < MIN_INLIERS:
        return None
    control, off_plane, J = robot_motion(camera, R, t, before)
    J = J[:3]
    covariance = J @ np.linalg.inv(information) @ J.T
    covariance = (covariance + covariance.T) / 2
    return Egomotion(control, off_plane, covariance, inliers, R, t, prior is not None)


def robot_motion(
    camera: Camera, R: FloatArray, t: FloatArray, before: Camera | None = None
) -> RobotMotion:
    """The robot's motion of a `CameraPose` of R (3, 3) and t (3,).

    Args:
        camera: as mounted, or as it is turned after the motion.
        R: of the pose.
        t: of it.
        before: the camera as it was turned before the motion; None if as after it.
    """
    motion, J = np.empty(6), np.empty((6, 6))
    rotation = (before or camera).rotation
    robot_motion_kernel(R, t, camera.rotation, rotation, camera.position, motion, J)
    return RobotMotion(motion[:3], motion[3:], J)


def camera_motion(camera: Camera, control: FloatArray, before: Camera | None = None) -> CameraPose:
    """The `CameraPose` of a control (3,) on the ground plane; `before` as for `robot_motion`."""
    before = before or camera
    c, s = np.cos(control[2]), np.sin(control[2])
    rotation = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    translation = -rotation @ np.append(control[:2], 0.0)
    R = camera.rotation.T @ rotation @ before.rotation
    return R, camera.rotation.T @ (translation - camera.position + rotation @ before.position)


def _prior_information(
    camera: Camera, covariance: FloatArray, R: FloatArray, before: Camera | None
) -> FloatArray:
    """(6, 6) information of the prior on rotation and translation of the camera."""
    total = np.diag(np.square([0.0, 0.0, 0.0, *OFF_PLANE_SIGMA]))
    total[:3, :3] = covariance + 1e-10 * np.eye(3)
    J = robot_motion(camera, R, np.zeros(3), before).jacobian
    return np.asarray(J.T @ np.linalg.solve(total, J))


def _ransac_motion(camera: Camera, points: Correspondences) -> CameraPose | None:
    """Initial motion from the points of known depth."""
    known = points.inverse_depth_sigma < MAX_RELATIVE_SIGMA * points.inverse_depth
    if known.sum() < MIN_INLIERS:
        return None
    xyz = directions(camera, points.previous[known]) / points.inverse_depth[known, None]
    solution = perspective_n_point(
        camera, xyz, points.current[known], method=cv2.SOLVEPNP_EPNP, confidence=0.999
    )
    return None if solution is None or solution[2] < MIN_INLIERS else solution[:2]


def perspective_n_point(
    camera: Camera, points: FloatArray, xy: FloatArray, *, method: int, confidence: float
) -> tuple[FloatArray, FloatArray, int] | None:
    """RANSAC PnP: R (3, 3), t (3,) and the number of inliers; None where it fails.

    Args:
        camera: the calibration.
        points: (k, 3) in the first camera frame, in metres.
        xy: (k, 2) their pixels in the second.
        method: a `cv2.SolvePnPMethod`, for the final estimate.
        confidence: probability of an outlier-free sample.
    """
    solved, rotation, translation, inliers = cv2.solvePnPRansac(
        *(points, xy, intrinsics_of(camera).matrix, None),
        iterationsCount=MAX_TRIALS,
        reprojectionError=MAX_REPROJECTION_ERROR,
        confidence=confidence,
        flags=method,
    )
    if not solved or inliers is None:
        return None
    R = np.asarray(cv2.Rodrigues(rotation)[0], np.float64)
    return R, np.asarray(translation, np.float64).ravel(), len(inliers)
