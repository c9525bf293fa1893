"""How far the robot went, by how the road moves under its camera.

One camera does not know how large the world is. The height of the camera over the ground does:
a road in front of it moves in the image by as many heights as the robot goes.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from saccade.frames import Camera
from saccade.types import Float32Array, FloatArray, IntArray
from saccade.visual.following import ByteArray
from saccade.visual.motion import Motion

NEAR, FAR = 6.0, 16.0
"""Metres before the camera between which the ground is taken for a road."""
HALF_WIDTH = 1.3
"""Metres to each side."""
ROWS, COLUMNS = 3, 4
"""Pixels from one that is compared to the next."""
BLUR = 1.5
"""Standard deviation in pixels by which both images are smoothed."""
TILT = np.radians((0.7, 1.0))
"""Standard deviations of the road's pitch and roll under the robot."""
SHORTEST = 0.3
"""Heights that the robot must go."""
ROUNDS = 15
SETTLED = 1e-3
WHITE = 0.04
"""Standard deviation of a single measurement, as a share of the way."""


class RoadMotion(NamedTuple):
    """What the road says of the way."""

    distance: float
    """Metres, if the camera is as high as its calibration says."""
    tilt: tuple[float, float]
    """Radians by which the road was pitched and rolled under the robot."""


def road_motion(
    camera: Camera, before: ByteArray, now: ByteArray, motion: Motion
) -> RoadMotion | None:
    """How far the camera went between two images.

    The brightness of the road before the robot is carried from one image to the other by a
    plane whose distance and tilt are found by least squares (Gauss-Newton).

    Args:
        camera: the calibration; its height must be known.
        before: (H, W) grey values.
        now: (H, W).
        motion: how the camera turned, and which way it went.

    Returns:
        None where the robot went too short a way, or what is before it is no road.
    """
    height = float(camera.place[2])
    way = float(np.linalg.norm(motion.shift))
    pixels = _trapezoid(camera)
    if way < SHORTEST * height or len(pixels) == 0:
        return None
    top = max(0, int(pixels[:, 1].min()) - 40)
    first, second = (_smooth(image[top:]) for image in (before, now))
    slope = [
        np.asarray(cv2.Sobel(second, cv2.CV_32F, i, 1 - i, ksize=3) / 8, np.float32) for i in (1, 0)
    ]
    at = first[pixels[:, 1] - top, pixels[:, 0]].astype(np.float64)
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    ray = np.concatenate([(pixels - centre) / focal, np.ones((len(pixels), 1))], 1)
    turned, ahead = ray @ motion.rotation.T, motion.shift / way
    normal = np.cross(ahead, camera.rotation[1])  # the way is along the road, whatever its slope
    normal *= -np.sign(normal @ camera.rotation[2]) / np.linalg.norm(normal)
    axes = np.stack([normal, ahead, np.cross(normal, ahead)])  # (3, 3)
    found, weight = np.array([way / height, 0.0, 0.0]), np.diag(np.append(0.0, TILT**-2.0))
    missed = None
    for _ in range(ROUNDS):
        plane = axes.T @ (found[0] * np.append(1.0, found[1:]))
        seen = turned + (ray @ plane)[:, None] * ahead
        flat = seen[:, :2] / seen[:, 2:]
        place = (flat * focal + centre - (0, top)).astype(np.float32)
        inside = (place > 1).all(1) & (place < (camera.width - 2, len(second) - 2)).all(1)
        light, across, down = (_sampled(image, place) for image in (second, slope[0], slope[1]))
        by_shift = (ahead[:2] - flat * ahead[2]) / seen[:, 2:] * focal
        steep = across * by_shift[:, 0] + down * by_shift[:, 1]
        by_plane = (ray @ axes.T) * (1.0, found[0], found[0])
        by_plane[:, 0] = ray @ (plane / found[0])
        J = np.concatenate(
            [steep[:, None] * by_plane, -at[:, None], -np.ones((len(at), 1))], 1
        )  # the light may have changed by a factor and a shift
        if missed is None:
            missed = light - at * (light.sum() / max(at.sum(), 1.0))
        spread = 1.48 * float(np.median(np.abs(missed - np.median(missed)))) + 0.3
        count = inside / np.square(1 + np.square(missed / (2 * spread))) / spread**2
        information, gradient = J.T @ (J * count[:, None]), J.T @ (count * light)
        information[:3, :3] += weight
        gradient[:3] += weight @ found
        step = -np.linalg.solve(information + 1e-9 * np.eye(5), gradient)
        missed, found = light + J @ step, found + step[:3]
        if not 0 < found[0] < 10 * way / height:
            return None
        if abs(step[0]) < SETTLED * found[0]:
            break
    else:
        return None
    if (np.abs(found[1:]) > 1.5 * TILT).any():
        return None
    return RoadMotion(float(found[0]) * height, (float(found[1]), float(found[2])))


@dataclass
class Scale:
    """How long odometry's metre is, by the road.

    Both may be wrong all the time: odometry by its wheels, the road by the height of the camera.
    What they differ by is shared out by how far each can be trusted.
    """

    odometry_sigma: float
    """Standard deviation of the share by which every true distance is longer than odometry's."""
    height_sigma: float
    """Standard deviation of the share by which every distance by the road is too long."""

    def __post_init__(self) -> None:
        self._wrong = np.zeros(2)  # of odometry, of the road
        self._spread = np.diag(np.square([self.odometry_sigma, self.height_sigma]))

    @property
    def factor(self) -> float:
        """By which distances of odometry are to be multiplied."""
        return 1.0 + float(self._wrong[0])

    @property
    def sigma(self) -> float:
        """Standard deviation of the factor."""
        return float(np.sqrt(self._spread[0, 0]))

    @property
    def road(self) -> float:
        """By which distances by the road are to be divided."""
        return 1.0 + float(self._wrong[1])

    def heard(self, ratio: float) -> None:
        """Take in the distance by the road, divided by that of odometry times `factor`."""
        missed = ratio - 1.0 - self._wrong[1]
        total = self._spread.sum() + WHITE**2
        if missed**2 < 9 * total:
            gain = self._spread.sum(1) / total
            self._wrong = self._wrong + gain * missed
            self._spread = self._spread - np.outer(gain, gain) * total


def _trapezoid(camera: Camera) -> IntArray:
    """(m, 2) pixels of the ground before the robot."""
    down = -camera.rotation[2]
    rows = np.arange(camera.height - 4, 0, -ROWS)
    steep = down[1] * (rows - camera.cy) / camera.fy + down[2]
    depth = camera.place[2] / np.where(steep > 0, steep, np.nan)
    road = [np.zeros((0, 2), np.int64)]
    for row, z in zip(rows.tolist(), depth.tolist(), strict=True):
        if NEAR < z < FAR:
            half = camera.fx * HALF_WIDTH / z
            columns = np.arange(camera.cx - half, camera.cx + half, COLUMNS).astype(np.int64)
            columns = columns[(columns >= 0) & (columns < camera.width)]
            road.append(np.stack([columns, np.full(len(columns), row)], 1))
    return np.concatenate(road)


def _smooth(image: ByteArray) -> Float32Array:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), BLUR), np.float32)


def _sampled(image: Float32Array, place: Float32Array) -> FloatArray:
    """(m,) brightness at pixels (m, 2)."""
    found = cv2.remap(image, place[None], None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
    return np.asarray(found[0], np.float64)
