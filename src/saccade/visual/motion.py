"""How the robot moved from one frame to the next: by its camera, and by what came before."""

from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.frames import Camera
from saccade.slam.consistency import chi_square_gate
from saccade.types import Float32Array, FloatArray
from saccade.visual.camera import from_pixels

BoolArray: TypeAlias = npt.NDArray[np.bool_]

FEWEST = 6
"""Points that tell a motion."""
TOLERANCE = 1.5
"""Pixels by which a point may miss the motion of the others."""
TRIES = 200
CONFIDENCE = 0.9999


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


def motion_between(
    camera: Camera, before: Float32Array, depth: FloatArray, now: Float32Array
) -> Motion | None:
    """The motion that most points agree with.

    Args:
        camera: the calibration.
        before: (k, 2) pixels in the first frame.
        depth: (k,) metres there, NaN where not known: such points are asked afterwards.
        now: (k, 2) pixels in the second frame.

    Returns:
        The motion, or None where too few points agree with any.
    """
    known = np.isfinite(depth)
    if known.sum() < FEWEST:
        return None
    points = from_pixels(camera, before[known].astype(np.float64), depth[known])
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    seen = now[known].astype(np.float64)
    cv2.setRNGSeed(0)
    found, turn, shift, agree = cv2.solvePnPRansac(
        points,
        seen,
        matrix,
        None,
        iterationsCount=TRIES,
        reprojectionError=TOLERANCE,
        confidence=CONFIDENCE,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not found or agree is None or len(agree) < FEWEST:
        return None
    inside = agree.ravel()
    turn, shift = cv2.solvePnPRefineLM(points[inside], seen[inside], matrix, None, turn, shift)
    rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64)  # robot before -> camera now
    agrees = np.zeros(len(before), np.bool_)
    agrees[np.flatnonzero(known)[inside]] = True
    # points of the robot's frame of before, in that of now
    turned = camera.rotation @ rotation
    moved = camera.rotation @ np.asarray(shift, np.float64).ravel() + camera.place
    back = -turned.T @ moved
    control = np.array([back[0], back[1], np.arctan2(turned.T[1, 0], turned.T[0, 0])])
    pitch = np.arctan2(-turned.T[2, 0], np.hypot(turned.T[0, 0], turned.T[1, 0]))
    roll = np.arctan2(turned.T[2, 1], turned.T[2, 2])
    _, slopes = cv2.projectPoints(points[inside], turn, shift, matrix, np.zeros(4))
    covariance = _control_covariance(camera, np.asarray(slopes[:, :6]), turned)
    return Motion(control, np.array([back[2], roll, pitch]), covariance, agrees)


def _control_covariance(camera: Camera, slopes: FloatArray, turned: FloatArray) -> FloatArray:
    """(3, 3) from the slopes (2k, 6) of pixels by turn and shift of the camera.

    The pixels of both frames err, and so do the depths: the deviation is that of a point that
    just agrees.
    """
    spread = np.linalg.inv(slopes.T @ slopes + 1e-9 * np.eye(6)) * TOLERANCE**2
    by_control = np.zeros((3, 6))
    by_control[2, :3] = -camera.rotation[2]  # a turn to the left is one about the axis up
    by_control[:2, 3:] = -(turned.T @ camera.rotation)[:2]
    return np.asarray(by_control @ spread @ by_control.T)


def joined(
    first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Two independent estimates (3,) with covariances (3, 3) as one.

    Where they contradict each other the first counts alone.
    """
    apart, total = first[0] - second[0], first[1] + second[1]
    weighed = np.linalg.solve(total, apart)
    if apart @ weighed > chi_square_gate(3, 0.9999):
        return first
    spread = second[1]
    return second[0] + spread @ weighed, spread - spread @ np.linalg.solve(total, spread)


@dataclass
class Foresight:
    """The next motion, from odometry and from how the robot moved before."""

    acceleration: FloatArray
    """(3,) standard deviations of the change of speed ahead, to the left (m/s) and of the turn
    rate (rad/s) in a second."""
    _speed: FloatArray | None = field(default=None, init=False)
    _spread: FloatArray = field(default_factory=lambda: np.zeros((3, 3)), init=False)

    def foresee(
        self, control: FloatArray, covariance: FloatArray, seconds: float
    ) -> tuple[FloatArray, FloatArray]:
        """Odometry joined with what the last motion lets expect.

        Args:
            control: (3,) by odometry.
            covariance: (3, 3).
            seconds: since the last frame.

        Returns:
            (3,) and its covariance (3, 3). Where the two contradict each other odometry counts
            alone: the robot may have been stopped, lifted, or turned round.
        """
        if self._speed is None or seconds <= 0:
            return control, covariance
        expected = self._speed * seconds
        spread = self._spread * seconds**2 + np.diag(np.square(self.acceleration * seconds**2))
        return joined((control, covariance), (expected, spread))

    def saw(self, control: FloatArray, covariance: FloatArray, seconds: float) -> None:
        """Hear how the robot did move, (3,), and how sure that is (3, 3)."""
        if seconds > 0:
            self._speed, self._spread = control / seconds, covariance / seconds**2


def step_between(before: FloatArray, after: FloatArray) -> FloatArray:
    """(3,) one pose (3,) in the frame of another: metres ahead and to the left, radians."""
    c, s = np.cos(before[2]), np.sin(before[2])
    dx, dy = after[:2] - before[:2]
    turn = (after[2] - before[2] + np.pi) % (2 * np.pi) - np.pi
    return np.array([c * dx + s * dy, c * dy - s * dx, turn])
