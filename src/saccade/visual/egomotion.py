"""How the robot moved from one frame to the next, by what its camera saw."""

from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.frames import Camera
from saccade.types import Float32Array, FloatArray
from saccade.visual.camera import directions

BoolArray: TypeAlias = npt.NDArray[np.bool_]
Prior: TypeAlias = tuple[FloatArray, FloatArray]
"""Control (3,) that is expected, and its covariance (3, 3)."""

MIN_PAIRS = 6
"""Points that tell a motion."""
INLIER_SIGMAS = 4.0
"""Standard deviations by which a point may miss the motion of the others."""
TOLERANCE = 1.5
"""Pixels by which it may in the first guess."""
MAX_TRIALS = 100
CONFIDENCE = 0.999
TILT = (0.05, 0.02, 0.02)
"""Standard deviations of metres up, radians rolled and pitched from one frame to the next,
where points without depth have to tell the motion."""
SOFTNESS = (16.0, 8.0, 4.0, 2.0)
"""Standard deviations from which a point counts for less, round by round: from a guess to what
is known. The last stays."""
FRONT = 0.05
"""Metres along the optical axis, as shares of a point's depth before, that it must lie ahead."""
CLOSEST = 1.0
"""Inverse depth, 1 / metres, that a point has at most."""
ROUNDS = 12
CONVERGED = 1e-6


class Motion(NamedTuple):
    """What the camera says of the way from one frame to the next."""

    control: FloatArray
    """(3,) metres ahead and to the left, radians turned, on the ground."""
    tilt: FloatArray
    """(3,) metres up, radians rolled to the right and pitched down."""
    covariance: FloatArray
    """(3, 3) of the control."""
    inliers: BoolArray
    """(k,) which points move as the robot did."""
    rotation: FloatArray
    """(3, 3) that turns the camera's frame of before into that of now."""
    translation: FloatArray
    """(3,) metres, where the camera of before is in the frame of now."""
    with_prior: bool
    """Whether the control has in it what was expected: one camera alone does not know how far."""


class Pairs(NamedTuple):
    """Points seen in two frames; inverse depths are 1 / metres along the optical axis."""

    before: FloatArray
    """(k, 2) pixels."""
    now: FloatArray
    """(k, 2) pixels."""
    inverse_depth: FloatArray
    """(k,) before."""
    sigma: FloatArray
    """(k,) its standard deviation; 1 where nothing is known."""
    inverse_depth_now: FloatArray
    """(k,) measured anew, NaN where it was not."""
    sigma_now: FloatArray
    """(k,) its standard deviation."""


def make_pairs(
    before: Float32Array,
    now: Float32Array,
    depth: FloatArray,
    depth_sigma: FloatArray,
    depth_now: FloatArray,
    depth_now_sigma: FloatArray,
) -> Pairs:
    """Pairs of k points, of which depths in metres are known with a deviation, or NaN."""
    known = np.isfinite(depth)
    inverse = 1 / np.where(known, depth, 50.0)
    sigma = np.where(known, np.nan_to_num(depth_sigma) * inverse**2, 1.0)
    again = 1 / depth_now
    return Pairs(
        before.astype(np.float64),
        now.astype(np.float64),
        inverse,
        sigma,
        again,
        np.nan_to_num(depth_now_sigma * again**2, nan=1.0),
    )


def estimate_motion(
    camera: Camera, pairs: Pairs, pixel_sigma: float, prior: Prior, alone: bool
) -> Motion | None:
    """The motion that most points agree with.

    Args:
        camera: the calibration.
        pairs: k points.
        pixel_sigma: standard deviation of a pixel, each way.
        prior: the control that is expected.
        alone: whether the points tell the whole motion, which they do where their depth was
            measured; if not, the prior is part of what is found.

    Returns:
        The motion, or None where too few points agree with any.
    """
    if len(pairs.before) < MIN_PAIRS:
        return None
    guess = _initial_motion(camera, pairs) if alone else camera_motion(camera, prior[0])
    if guess is None:
        return None
    (R, t), at, square = guess, pairs.inverse_depth.copy(), np.empty(len(pairs.before))
    weight = np.zeros((6, 6)) if alone else _prior_weight(camera, prior[1], R)
    view = camera.fx, camera.fy, camera.cx, camera.cy
    rounds = SOFTNESS[-2:] if alone else SOFTNESS
    for i in range(ROUNDS):
        away = np.append(_rotation_vector(R @ guess[0].T), t - guess[1])
        information, gradient = weight + 1e-9 * np.eye(6), -weight @ away
        soft = rounds[min(i, len(rounds) - 1)]
        _accumulate(pairs, view, R, t, pixel_sigma, soft, at, information, gradient, square)
        step = np.linalg.solve(information, gradient)
        R, t = cv2.Rodrigues(step[:3])[0] @ R, t + step[3:]
        if i >= len(rounds) and np.abs(step).max() < CONVERGED:
            break
    agrees = square < INLIER_SIGMAS**2
    if agrees.sum() < MIN_PAIRS:
        return None
    control, tilt = robot_motion(camera, R, t)
    B = _camera_jacobian(camera, R, t)[:3]
    spread = B @ np.linalg.inv(information) @ B.T
    return Motion(control, tilt, spread, agrees, R, t, not alone)


def robot_motion(camera: Camera, R: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The robot's control (3,) and tilt (3,), points X of the camera's frame becoming R X + t."""
    turned = camera.rotation @ R @ camera.rotation.T
    moved = camera.rotation @ t + camera.position - turned @ camera.position
    back, axes = -turned.T @ moved, turned.T
    control = np.array([back[0], back[1], np.arctan2(axes[1, 0], axes[0, 0])])
    roll = np.arctan2(axes[2, 1], axes[2, 2])
    return control, np.array(
        [back[2], roll, np.arctan2(-axes[2, 0], np.hypot(axes[0, 0], axes[1, 0]))]
    )


def camera_motion(camera: Camera, control: FloatArray) -> tuple[FloatArray, FloatArray]:
    """R (3, 3) and t (3,) as `robot_motion` has them, of a robot that stays upright."""
    c, s = np.cos(control[2]), np.sin(control[2])
    turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    moved = -turned @ np.append(control[:2], 0.0)
    R = camera.rotation.T @ turned @ camera.rotation
    return R, camera.rotation.T @ (moved - camera.position + turned @ camera.position)


def _camera_jacobian(camera: Camera, R: FloatArray, t: FloatArray) -> FloatArray:
    """(6, 6) slope of the robot's control and tilt by a turn (3,) of R and a shift (3,) of t.

    Roll and pitch are taken for small.
    """
    turned = camera.rotation @ R @ camera.rotation.T
    slope = np.zeros((6, 6))
    x, y, z = camera.rotation @ t + camera.position
    # back = -turned^T moved; both factors turn about the camera's axes
    about = turned.T @ camera.rotation
    slope[[0, 1, 3], :3] = (
        turned.T @ np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]]) @ (camera.rotation)
    )
    slope[[2, 4, 5], :3] = -about[[2, 0, 1]]
    slope[[0, 1, 3], 3:] = -turned.T @ camera.rotation
    return slope


def _prior_weight(camera: Camera, covariance: FloatArray, R: FloatArray) -> FloatArray:
    """(6, 6) information on turn and shift of the camera."""
    spread = np.zeros((6, 6))
    spread[:3, :3] = covariance + 1e-10 * np.eye(3)
    spread[[3, 4, 5], [3, 4, 5]] = np.square(TILT)
    slope = _camera_jacobian(camera, R, np.zeros(3))
    return np.asarray(slope.T @ np.linalg.solve(spread, slope))


@kernel()
def _accumulate(
    pairs: Pairs,
    view: tuple[float, float, float, float],
    R: FloatArray,
    t: FloatArray,
    pixel_sigma: float,
    soft: float,
    at: FloatArray,
    information: FloatArray,
    gradient: FloatArray,
    square: FloatArray,
) -> None:
    """Add up what points say of a better motion, by what each misses this one.

    What a point misses has the covariance N = A + s^2 d d^T, of pixels and depth now and of the
    inverse depth before: N^-1 = A^-1 - q g g^T, g = A^-1 d, q = s^2 / (1 + s^2 d^T g)
    (Sherman & Morrison, 1950).

    Args:
        pairs: k points.
        view: focal lengths and centre of the camera, in pixels.
        R: (3, 3) turn of the camera.
        t: (3,) its shift.
        pixel_sigma: standard deviation of a pixel, each way.
        soft: standard deviations from which a point counts for less.
        at: (k,) inverse depths before about which all is linear; becomes those that the motion
            makes likely.
        information: (6, 6) by turn and shift, added to.
        gradient: (6,), added to.
        square: (k,) becomes what each misses, normalized; infinite behind the camera.
    """
    fx, fy, cx, cy = view
    P, J, d, missed, sure = np.zeros((3, 3)), np.empty((3, 6)), np.empty(3), np.empty(3), np.ones(3)
    pull, g = np.empty(6), np.empty(3)
    for i in range(len(at)):
        h, u, v = at[i], (pairs.before[i, 0] - cx) / fx, (pairs.before[i, 1] - cy) / fy
        a = R[0, 0] * u + R[0, 1] * v + R[0, 2]
        b = R[1, 0] * u + R[1, 1] * v + R[1, 2]
        c = R[2, 0] * u + R[2, 1] * v + R[2, 2]
        z = c + h * t[2]
        if z <= FRONT:
            square[i] = np.inf
            continue
        x, y = (a + h * t[0]) / z, (b + h * t[1]) / z
        again = np.isfinite(pairs.inverse_depth_now[i])  # its depth has been measured anew
        seen = h / z if again else 0.0
        missed[0] = pairs.now[i, 0] - (fx * x + cx)
        missed[1] = pairs.now[i, 1] - (fy * y + cy)
        missed[2] = pairs.inverse_depth_now[i] - seen if again else 0.0
        sure[0] = sure[1] = 1 / (2 * pixel_sigma**2)  # of A^-1: both frames err
        sure[2] = 1 / pairs.sigma_now[i] ** 2 if again else 1.0
        P[0, 0], P[0, 2], P[1, 1], P[1, 2] = fx / z, -fx * x / z, fy / z, -fy * y / z
        P[2, 2] = -seen / z  # P is the slope by the point, divided by its depth before
        for j in range(3):
            J[j, 0] = P[j, 2] * b - P[j, 1] * c
            J[j, 1] = P[j, 0] * c - P[j, 2] * a
            J[j, 2] = P[j, 1] * a - P[j, 0] * b
            d[j] = 0.0
            for m in range(3):
                J[j, 3 + m] = h * P[j, m]
                d[j] += P[j, m] * t[m]
        d[2] += 1 / z if again else 0.0
        spread, along, total = 0.0, 0.0, 0.0
        for j in range(3):
            missed[j] += d[j] * (h - pairs.inverse_depth[i])
            g[j] = sure[j] * d[j]
            spread += d[j] * g[j]
            along += missed[j] * g[j]
            total += missed[j] ** 2 * sure[j]
        q = pairs.sigma[i] ** 2 / (1 + pairs.sigma[i] ** 2 * spread)
        at[i] = min(max(pairs.inverse_depth[i] + q * along, 0.0), CLOSEST)
        square[i] = total - q * along**2
        count = 1 / (1 + square[i] / soft**2) ** 2  # Geman & McClure (1987)
        for m in range(6):
            pull[m] = J[0, m] * g[0] + J[1, m] * g[1] + J[2, m] * g[2]
        for m in range(6):
            gradient[m] -= count * q * pull[m] * along
            for j in range(3):
                gradient[m] += count * J[j, m] * sure[j] * missed[j]
            for k in range(6):
                information[m, k] -= count * q * pull[m] * pull[k]
                for j in range(3):
                    information[m, k] += count * J[j, m] * sure[j] * J[j, k]


def _initial_motion(camera: Camera, pairs: Pairs) -> tuple[FloatArray, FloatArray] | None:
    """R and t by samples of points whose depth is known."""
    known = pairs.sigma < 0.5 * pairs.inverse_depth
    if known.sum() < MIN_PAIRS:
        return None
    points = directions(camera, pairs.before[known]) / pairs.inverse_depth[known, None]
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    cv2.setRNGSeed(0)
    found, turn, shift, agree = cv2.solvePnPRansac(
        points,
        pairs.now[known],
        matrix,
        None,
        iterationsCount=MAX_TRIALS,
        reprojectionError=TOLERANCE,
        confidence=CONFIDENCE,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not found or agree is None or len(agree) < MIN_PAIRS:
        return None
    return np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(shift, np.float64).ravel()


def _rotation_vector(R: FloatArray) -> FloatArray:
    """(3,) a turn as a vector along its axis."""
    return np.asarray(cv2.Rodrigues(R)[0], np.float64).ravel()
