"""How the robot moved from one frame to the next, by what its camera saw."""

from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.frames import Camera
from saccade.types import Float32Array, FloatArray

BoolArray: TypeAlias = npt.NDArray[np.bool_]
Prior: TypeAlias = tuple[FloatArray, FloatArray]
"""Control (3,) that is expected, and its covariance (3, 3)."""

FEWEST = 6
"""Points that tell a motion."""
AGREES = 4.0
"""Standard deviations by which a point may miss the motion of the others."""
TOLERANCE = 1.5
"""Pixels by which it may in the first guess."""
TRIES = 100
CONFIDENCE = 0.999
TILT = (0.05, 0.02, 0.02)
"""Standard deviations of metres up, radians rolled and pitched from one frame to the next,
where points without depth have to tell the motion."""
SOFTNESS = (16.0, 8.0, 4.0, 2.0)
"""Standard deviations from which a point counts for less, round by round: from a guess to what
is known. The last stays."""
CLOSEST = 1.0
"""Inverse depth, 1 / metres, that a point has at most."""
ROUNDS = 12
SETTLED = 1e-6


class Motion(NamedTuple):
    """What the camera says of the way from one frame to the next."""

    control: FloatArray
    """(3,) metres ahead and to the left, radians turned, on the ground."""
    tilt: FloatArray
    """(3,) metres up, radians rolled to the right and pitched down."""
    covariance: FloatArray
    """(3, 3) of the control."""
    agrees: BoolArray
    """(k,) which points move as the robot did."""
    rotation: FloatArray
    """(3, 3) that turns the camera's frame of before into that of now."""
    shift: FloatArray
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


def paired(
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


def motion_between(
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
    if len(pairs.before) < FEWEST:
        return None
    guess = _first_guess(camera, pairs) if alone else camera_motion(camera, prior[0])
    if guess is None:
        return None
    (R, t), at = guess, pairs.inverse_depth
    weight = np.zeros((6, 6)) if alone else _prior_weight(camera, prior[1], R)
    rounds = SOFTNESS[-2:] if alone else SOFTNESS
    for i in range(ROUNDS):
        slopes, missed, share, at = _missed(camera, pairs, at, R, t, pixel_sigma)
        square = np.einsum("ni,ni->n", missed, missed)
        soft = rounds[min(i, len(rounds) - 1)]
        count = 1 / np.square(1 + square / soft**2) * share  # Geman & McClure (1987)
        information = np.einsum("n,nia,nib->ab", count, slopes, slopes) + weight
        away = np.append(_angles(R @ guess[0].T), t - guess[1])
        step = np.linalg.solve(
            information + 1e-9 * np.eye(6),
            np.einsum("n,nia,ni->a", count, slopes, missed) - weight @ away,
        )
        R, t = cv2.Rodrigues(step[:3])[0] @ R, t + step[3:]
        if i >= len(rounds) and np.abs(step).max() < SETTLED:
            break
    agrees = (square < AGREES**2) & (share > 0)
    if agrees.sum() < FEWEST:
        return None
    control, tilt = robot_motion(camera, R, t)
    B = _by_camera(camera, R, t)[:3]
    spread = B @ np.linalg.inv(information + 1e-9 * np.eye(6)) @ B.T
    return Motion(control, tilt, spread, agrees, R, t, not alone)


def robot_motion(camera: Camera, R: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The robot's control (3,) and tilt (3,), points X of the camera's frame becoming R X + t."""
    turned = camera.rotation @ R @ camera.rotation.T
    moved = camera.rotation @ t + camera.place - turned @ camera.place
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
    return R, camera.rotation.T @ (moved - camera.place + turned @ camera.place)


def _by_camera(camera: Camera, R: FloatArray, t: FloatArray) -> FloatArray:
    """(6, 6) slope of the robot's control and tilt by a turn (3,) of R and a shift (3,) of t.

    Roll and pitch are taken for small.
    """
    turned = camera.rotation @ R @ camera.rotation.T
    slope = np.zeros((6, 6))
    arm = camera.rotation @ R @ camera.rotation.T @ camera.place  # of the camera, turned
    for k in range(3):
        axis = camera.rotation[:, k]
        moved = camera.rotation @ t + camera.place - arm
        # back = -turned^T moved; both factors turn about the axis
        slope[[0, 1, 3], k] = turned.T @ np.cross(axis, moved) + turned.T @ np.cross(axis, arm)
        about = turned.T @ axis
        slope[[2, 4, 5], k] = -about[[2, 0, 1]]
    slope[[0, 1, 3], 3:] = -turned.T @ camera.rotation
    return slope


def _prior_weight(camera: Camera, covariance: FloatArray, R: FloatArray) -> FloatArray:
    """(6, 6) information on turn and shift of the camera."""
    spread = np.zeros((6, 6))
    spread[:3, :3] = covariance + 1e-10 * np.eye(3)
    spread[[3, 4, 5], [3, 4, 5]] = np.square(TILT)
    slope = _by_camera(camera, R, np.zeros(3))
    return np.asarray(slope.T @ np.linalg.solve(spread, slope))


def _missed(
    camera: Camera, pairs: Pairs, at: FloatArray, R: FloatArray, t: FloatArray, pixel_sigma: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """By how much points miss a motion, in standard deviations.

    Args:
        camera: the calibration.
        pairs: k points.
        at: (k,) inverse depths before about which all is linear.
        R: (3, 3) turn of the camera.
        t: (3,) its shift.
        pixel_sigma: standard deviation of a pixel, each way.

    Returns:
        Slopes (k, 3, 6) by turn and shift, what is missed (k, 3), across, down and in inverse
        depth; (k,) 1 where a point is before the camera, 0 elsewhere; and (k,) the inverse
        depths before that the motion makes likely.
    """
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    ray = np.concatenate([(pairs.before - centre) / focal, np.ones((len(pairs.before), 1))], 1)
    turned = ray @ R.T
    seen = turned + at[:, None] * t  # the point, times its inverse depth before
    front = seen[:, 2] > 0.05
    z = np.where(front, seen[:, 2], 1.0)
    flat = seen[:, :2] / z[:, None]
    again = np.isfinite(pairs.inverse_depth_now)
    missed = np.zeros((len(ray), 3))
    missed[:, :2] = pairs.now - (flat * focal + centre)
    missed[:, 2] = np.where(again, pairs.inverse_depth_now - at / z, 0.0)

    def projected(by: FloatArray) -> FloatArray:
        """Slopes (k, 3, c) of pixels and inverse depth from those of `seen`."""
        across = (by[:, :2] - flat[:, :, None] * by[:, 2:]) / z[:, None, None] * focal[:, None]
        deep = -(at / z**2 * again)[:, None, None] * by[:, 2:]
        return np.concatenate([across, deep], 1)

    by_seen = np.zeros((len(ray), 3, 6))
    by_seen[:, 0, 1], by_seen[:, 0, 2] = turned[:, 2], -turned[:, 1]
    by_seen[:, 1, 0], by_seen[:, 1, 2] = -turned[:, 2], turned[:, 0]
    by_seen[:, 2, 0], by_seen[:, 2, 1] = turned[:, 1], -turned[:, 0]
    by_seen[:, :, 3:] = at[:, None, None] * np.eye(3)
    by_depth = projected(np.broadcast_to(t[:, None], (len(ray), 3, 1)))[:, :, 0]
    by_depth[:, 2] += again / z
    noise = (by_depth * pairs.sigma[:, None] ** 2)[:, :, None] * by_depth[:, None]
    noise[:, [0, 1], [0, 1]] += 2 * pixel_sigma**2  # both frames err
    noise[:, 2, 2] += np.where(again, pairs.sigma_now**2, 1.0)
    missed += by_depth * (at - pairs.inverse_depth)[:, None]
    root = np.linalg.inv(np.linalg.cholesky(noise))
    white = (root @ missed[:, :, None])[:, :, 0]
    likely = (white * (root @ by_depth[:, :, None])[:, :, 0]).sum(1) * pairs.sigma**2
    likely = (pairs.inverse_depth + likely).clip(0.0, CLOSEST)
    return root @ projected(by_seen), white, front.astype(np.float64), likely


def _first_guess(camera: Camera, pairs: Pairs) -> tuple[FloatArray, FloatArray] | None:
    """R and t by samples of points whose depth is known."""
    known = pairs.sigma < 0.5 * pairs.inverse_depth
    if known.sum() < FEWEST:
        return None
    focal = np.array([camera.fx, camera.fy])
    flat = (pairs.before[known] - (camera.cx, camera.cy)) / focal
    points = np.concatenate([flat, np.ones((len(flat), 1))], 1) / pairs.inverse_depth[known, None]
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    cv2.setRNGSeed(0)
    found, turn, shift, agree = cv2.solvePnPRansac(
        points,
        pairs.now[known],
        matrix,
        None,
        iterationsCount=TRIES,
        reprojectionError=TOLERANCE,
        confidence=CONFIDENCE,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not found or agree is None or len(agree) < FEWEST:
        return None
    return np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(shift, np.float64).ravel()


def _angles(R: FloatArray) -> FloatArray:
    """(3,) a turn as a vector along its axis."""
    return np.asarray(cv2.Rodrigues(R)[0], np.float64).ravel()
