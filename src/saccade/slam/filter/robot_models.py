"""Motion, observation and inverse observation models, each with its Jacobians (appendix C)."""

from math import cos, sin

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError
from saccade.motions import MOTIONS, Motion, find_motion, motion_of_size
from saccade.slam.filter._kernels import MIN_RANGE, wrapped
from saccade.slam.filter._motion_kernels import convert_controls
from saccade.slam.filter.validation import as_numbers, check_gaussian, check_vector
from saccade.types import FloatArray


def wrap(angle: npt.ArrayLike) -> FloatArray:
    """Wraps angles to (-pi, pi], element by element."""
    a = np.asarray(angle, np.float64)
    inside = np.pi - np.mod(np.pi - a, 2 * np.pi)
    return np.asarray(np.where((a > -np.pi) & (a <= np.pi), a, inside))


def turn_then_translate(
    pose: FloatArray, control: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Turn-then-translate motion model (C.5-C.9).

    Args:
        pose: (3,) x, y in meters, heading in radians.
        control: (2,) distance in meters, turn in radians.

    Returns:
        The next pose (3,), and its Jacobians by pose (3, 3) and by control (3, 2).

    Raises:
        LogError: an argument has a wrong shape, or is not finite.
    """
    u = check_vector("control", control, 2)
    step, J = (each[0] for each in MOTIONS["turn_then_translate"].relative_poses(u[None]))
    moved, Fx, Fu = compose(pose, step)  # C.5, C.8
    return moved, Fx, Fu @ J  # C.9


def compose(pose: FloatArray, control: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pose composition: the control is the next pose in the frame of the last one.

    Args:
        pose: (3,) x, y in meters, heading in radians.
        control: (3,) forward, left in meters, turn in radians.

    Returns:
        The next pose (3,), and its Jacobians by pose (3, 3) and by control (3, 3).

    Raises:
        LogError: an argument has a wrong shape, or is not finite.
    """
    x, y, theta = check_vector("pose", pose, 3).tolist()
    forward, left, turn = check_vector("control", control, 3).tolist()
    c, s = cos(theta), sin(theta)
    dx, dy = c * forward - s * left, s * forward + c * left
    moved = np.array([x + dx, y + dy, wrapped(theta + turn)])
    Fx = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])  # (3, 3)
    Fu = heading_rotation(theta)  # (3, 3)
    return moved, Fx, Fu


def heading_rotation(heading: float) -> FloatArray:
    """(3, 3) rotation of a pose or control by a heading in radians."""
    c, s = cos(heading), sin(heading)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def observe(pose: FloatArray, landmarks: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range and bearing of landmarks from a pose (C.14).

    Args:
        pose: (3,) x, y in meters, heading in radians.
        landmarks: (..., 2) in meters.

    Returns:
        Range in meters and bearing in radians (..., 2), and the Jacobian (..., 2, 5)
        by x, y, theta, mx, my. Within a micrometer of the robot the bearing is undefined:
        it and its Jacobian are zero, so that the observation corrects nothing.
    """
    pose, landmarks = as_numbers("pose", pose), as_numbers("landmarks", landmarks)
    dx, dy = pose[0] - landmarks[..., 0], pose[1] - landmarks[..., 1]
    q = np.hypot(dx, dy)
    defined = q > MIN_RANGE
    safe = np.where(defined, q, 1.0)
    cx, cy = np.where(defined, dx / safe, 0.0), np.where(defined, dy / safe, 0.0)
    z = np.empty(landmarks.shape)
    z[..., 0] = q
    z[..., 1] = np.where(defined, wrap(np.arctan2(-dy, -dx) - pose[2]), 0.0)
    H = np.zeros((*landmarks.shape, len(pose) + 2))
    H[..., 0, 0] = cx
    H[..., 0, 1] = cy
    H[..., 0, 2] = 0.0
    H[..., 1, 0] = -cy / safe
    H[..., 1, 1] = cx / safe
    H[..., 1, 2] = -1.0 * defined
    H[..., -2:] = -H[..., :2]
    return z, H  # (..., 2), (..., 2, 5)


def observe_with_errors(
    robot: FloatArray, landmarks: FloatArray, range_errors: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Range and bearing of landmarks from a robot whose state has systematic errors.

    Args:
        robot: (r,) state of the robot, the pose first.
        landmarks: (k, 2) in meters.
        range_errors: (2,) scale error and offset of the ranges, the last two numbers of `robot`;
            None where they are no part of it.

    Returns:
        Ranges and bearings (k, 2), and the Jacobian (k, 2, r + 2) by robot and landmark.
    """
    z, H = observe(robot, landmarks)
    if range_errors is not None:
        r = len(robot)
        H[:, 0, r - 2], H[:, 0, r - 1] = z[:, 0], 1.0
        H[:, 0, [0, 1, 2, r, r + 1]] *= 1 + range_errors[0]
        z[:, 0] = (1 + range_errors[0]) * z[:, 0] + range_errors[1]
    return z, H


def stack_jacobians(H: FloatArray) -> FloatArray:
    """Jacobian (2k, r + 2k) of k observations by the robot and all landmarks.

    Args:
        H: (k, 2, r + 2) Jacobians of the observations by the robot and their landmarks (C.14).
    """
    k, r = len(H), H.shape[-1] - 2
    by_landmark = np.zeros((k, 2, k, 2))
    by_landmark[np.arange(k), :, np.arange(k)] = H[..., r:]
    return np.hstack([H[..., :r].reshape(2 * k, r), by_landmark.reshape(2 * k, 2 * k)])


def inverse_observe(pose: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions of observed landmarks (C.15, C.18).

    Args:
        pose: (3,) x, y in meters, heading in radians.
        z: (..., 2) range in meters, bearing in radians.

    Returns:
        Positions in meters (..., 2), and their Jacobians by pose (..., 2, 3) and
        by z (..., 2, 2).
    """
    pose, z = as_numbers("pose", pose), as_numbers("observations", z)
    r, beta = z[..., 0], pose[2] + z[..., 1]
    c, s = np.cos(beta), np.sin(beta)
    xy = np.stack([pose[0] + r * c, pose[1] + r * s], -1)  # C.15
    Gx = np.zeros((*z.shape, len(pose)))
    Gx[..., 0, 0] = Gx[..., 1, 1] = 1.0
    Gx[..., 0, 2], Gx[..., 1, 2] = -r * s, r * c  # C.18
    Gz = np.empty((*z.shape, 2))
    Gz[..., 0, 0], Gz[..., 0, 1] = c, -r * s
    Gz[..., 1, 0], Gz[..., 1, 1] = s, r * c  # C.18
    return xy, Gx, Gz


def difference(z: FloatArray, expected: FloatArray) -> FloatArray:
    """`z - expected` (..., 2), the bearing wrapped."""
    innovation = np.asarray(z - expected, np.float64)
    innovation[..., 1] = wrap(innovation[..., 1])
    return innovation


def pose_difference(pose: FloatArray, other: FloatArray) -> FloatArray:
    """`pose - other` (..., 3), the heading wrapped."""
    error = np.asarray(pose - other, np.float64)
    error[..., 2] = wrap(error[..., 2])
    return error


def as_relative_pose(
    control: npt.ArrayLike,
    covariance: npt.ArrayLike | None,
    motion: str | Motion = "",
    scale: float = 1.0,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Relative pose (3,) of a control, its covariance and its Jacobian by systematic errors (3, 3).

    Args:
        control: (c,).
        covariance: (c, c).
        motion: name in `saccade.motions.MOTIONS`, or a `Motion`; by default the first with c
            columns.
        scale: factor of the standard deviations.

    Raises:
        LogError: an argument is invalid, or there is no such motion.
    """
    u = as_numbers("control", control)
    kind = find_motion(motion) if motion else motion_of_size(u.size)
    if kind is None:
        sizes = " or ".join(sorted({str(len(each.columns)) for each in MOTIONS.values()}))
        raise LogError(f"control: expected {sizes} numbers, found shape {u.shape}")
    u, U = check_gaussian("control", u, covariance, len(kind.columns), scale**2)
    step, C, by_error = as_relative_poses(kind, u[None], U[None])
    return step[0], C[0], by_error[0]


def as_relative_poses(
    kind: Motion, control: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Relative poses (t, 3), their covariances and their Jacobians by systematic errors (t, 3, 3).

    Args:
        kind: the motion of the controls.
        control: (t, c).
        covariance: (t, c, c).
    """
    step, J = kind.relative_poses(control)
    C, by_error = np.empty((len(step), 3, 3)), np.empty((len(step), 3, 3))
    convert_controls(control, covariance, np.ascontiguousarray(J, np.float64), C, by_error)
    return step, C, by_error
