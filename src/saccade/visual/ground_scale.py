"""How far the robot went, by how the road moves under its camera.

One camera does not know how large the world is. The height of the camera over the ground does:
a road in front of it moves in the image by as many heights as the robot goes.
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.frames import Camera
from saccade.types import FloatArray, IntArray
from saccade.visual.camera import directions
from saccade.visual.egomotion import Motion
from saccade.visual.optical_flow import ByteArray

ShortArray: TypeAlias = npt.NDArray[np.int16]

NEAR, FAR = 6.0, 16.0
"""Metres before the camera between which the ground is taken for a road."""
HALF_WIDTH = 1.3
"""Metres to each side."""
ROWS, COLUMNS = 3, 4
"""Pixels from one that is compared to the next."""
BLUR, KERNEL = 1.5, (7, 7)
"""Standard deviation in pixels by which both images are smoothed, and where that is cut."""
TILT = np.radians((0.7, 1.0))
"""Standard deviations of the road's pitch and roll under the robot."""
SEAM = 8
"""Pixels around them that smoothing needs."""
MARGIN = 128
"""Pixels around them in which the next image is looked at."""
SEEN = 0.3
"""Share of them that must be found there."""
COMMON = 7.0
"""By how much the root of the mean error of many pixels exceeds that of as many independent ones:
what makes the road no plane is the same for neighbors."""
SHORTEST = 0.3
"""Heights that the robot must go."""
ROUNDS = 15
SETTLED = 1e-3
WHITE_NOISE = 0.04
"""Standard deviation of a single measurement, as a share of the way."""


class GroundMotion(NamedTuple):
    """What the road says of the way."""

    distance: float
    """Metres, if the camera is as high as its calibration says."""
    tilt: tuple[float, float]
    """Radians by which the road was pitched and rolled under the robot."""


class GroundTracker:
    """The ground before a camera, and how it moves in the image.

    Args:
        camera: the calibration; where its height is not known there is no road.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera, self._pixels = camera, _trapezoid(camera)
        self._rays = directions(camera, self._pixels.astype(np.float64))

    def motion(self, before: ByteArray, now: ByteArray, motion: Motion) -> GroundMotion | None:
        """How far the camera went between two images.

        The brightness of the road before the robot is carried from one image to the other by a
        plane whose distance and tilt are found by least squares (Gauss-Newton).

        Args:
            before: (H, W) grey values.
            now: (H, W).
            motion: how the camera turned, and which way it went.

        Returns:
            None where the robot went too short a way, or what is before it is no road.
        """
        camera, pixels, R = self._camera, self._pixels, motion.rotation
        height, way = float(camera.position[2]), float(np.linalg.norm(motion.translation))
        if way < SHORTEST * height or len(pixels) == 0:
            return None
        first, (left, top) = _smooth(before, pixels, SEAM)
        at = first[pixels[:, 1] - top, pixels[:, 0] - left].astype(np.float64)
        second, (left, top) = _smooth(now, pixels, MARGIN)
        view = camera.fx, camera.fy, camera.cx - left, camera.cy - top
        images = second, _gradient(second, 1, 0), _gradient(second, 0, 1)
        ahead = motion.translation / way
        normal = np.cross(ahead, camera.rotation[1])  # the way is along the road, up or down
        normal *= -np.sign(normal @ camera.rotation[2]) / np.linalg.norm(normal)
        axes = np.stack([normal, ahead, np.cross(normal, ahead)])  # (3, 3)
        found, weight = np.array([way / height, 0.0, 0.0]), np.diag(np.append(0.0, TILT**-2.0))
        light, J, lit = np.empty(len(at)), np.empty((len(at), 5)), None
        for _ in range(ROUNDS):
            tilted = axes.T @ np.append(1.0, found[1:])
            slope = np.stack([tilted, found[0] * axes[1], found[0] * axes[2]])
            n = _warp(self._rays, at, view, R, ahead, found[0], slope, images, light, J)
            if n < SEEN * len(at):
                return None
            seen, A = light[:n], J[:n]
            if lit is None:
                lit = np.array([-seen.sum() / min(A[:, 3].sum(), -1.0), 0.0])
            missed = seen + A[:, 3:] @ lit
            spread = 1.48 * _median(np.abs(missed - _median(missed))) + 0.3
            count = 1 / np.square(1 + np.square(missed / (2 * spread))) / (COMMON * spread) ** 2
            information, gradient = A.T @ (A * count[:, None]), A.T @ (count * seen)
            information[:3, :3] += weight
            gradient[:3] += weight @ found
            step = -np.linalg.solve(information + 1e-9 * np.eye(5), gradient)
            found, lit = found + step[:3], step[3:]
            if not 0 < found[0] < 10 * way / height:
                return None
            if abs(step[0]) < SETTLED * found[0]:
                break
        else:
            return None
        if (np.abs(found[1:]) > 1.5 * TILT).any():
            return None
        return GroundMotion(float(found[0]) * height, (float(found[1]), float(found[2])))


@kernel()
def _warp(
    rays: FloatArray,
    at: FloatArray,
    view: tuple[float, float, float, float],
    R: FloatArray,
    ahead: FloatArray,
    far: float,
    slope: FloatArray,
    images: tuple[ByteArray, ShortArray, ShortArray],
    light: FloatArray,
    J: FloatArray,
) -> int:
    """Look up points of the road in the next image.

    Args:
        rays: (m, 3) lines of sight to them before.
        at: (m,) how bright they were.
        view: focal lengths and centre of the next image, in pixels.
        R: (3, 3) turn of the camera.
        ahead: (3,) direction of its way.
        far: its length in heights over the road.
        slope: (3, 3) of the plane by the way and the two tilts; the plane is `far` times the first.
        images: the next one (h, w), and eight times its slopes across and down.
        light: (m,) becomes how bright they are now.
        J: (m, 5) becomes the slopes of that by way and tilts, and minus the brightness before and
            minus one: the light may have changed by a factor and a shift.

    Returns:
        How many of them are in the image: of so many `light` and `J` are filled.
    """
    (fx, fy, cx, cy), (gray, across, down) = view, images
    height, width = gray.shape
    n = 0
    for i in range(len(rays)):
        a, b, c = rays[i, 0], rays[i, 1], rays[i, 2]
        near = far * (a * slope[0, 0] + b * slope[0, 1] + c * slope[0, 2])
        z = a * R[2, 0] + b * R[2, 1] + c * R[2, 2] + near * ahead[2]
        if z <= 0.0:
            continue
        u = (a * R[0, 0] + b * R[0, 1] + c * R[0, 2] + near * ahead[0]) / z
        v = (a * R[1, 0] + b * R[1, 1] + c * R[1, 2] + near * ahead[1]) / z
        x, y = u * fx + cx, v * fy + cy
        if not (1 < x < width - 2 and 1 < y < height - 2):
            continue
        steep = _bilinear(across, x, y) / 8 * (ahead[0] - u * ahead[2]) / z * fx
        steep += _bilinear(down, x, y) / 8 * (ahead[1] - v * ahead[2]) / z * fy
        for j in range(3):
            J[n, j] = steep * (a * slope[j, 0] + b * slope[j, 1] + c * slope[j, 2])
        J[n, 3], J[n, 4] = -at[i], -1.0
        light[n] = _bilinear(gray, x, y)
        n += 1
    return n


@kernel()
def _bilinear(image: ByteArray | ShortArray, x: float, y: float) -> float:
    """An image at a place between four pixels (bilinear)."""
    i, j = int(y), int(x)
    p, q = y - i, x - j
    above: float = (1 - q) * image[i, j] + q * image[i, j + 1]
    below: float = (1 - q) * image[i + 1, j] + q * image[i + 1, j + 1]
    return (1 - p) * above + p * below


@dataclass
class OdometryScale:
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
    def ground_factor(self) -> float:
        """By which distances by the road are to be divided."""
        return 1.0 + float(self._wrong[1])

    def update(self, ratio: float) -> None:
        """Take in the distance by the road, divided by that of odometry times `factor`."""
        missed = ratio - 1.0 - self._wrong[1]
        total = self._spread.sum() + WHITE_NOISE**2
        if missed**2 < 9 * total:
            gain = self._spread.sum(1) / total
            self._wrong = self._wrong + gain * missed
            self._spread = self._spread - np.outer(gain, gain) * total


def _trapezoid(camera: Camera) -> IntArray:
    """(m, 2) pixels of the ground before the robot."""
    down = -camera.rotation[2]
    rows = np.arange(camera.height - 4, 0, -ROWS)
    steep = down[1] * (rows - camera.cy) / camera.fy + down[2]
    depth = camera.position[2] / np.where(steep > 0, steep, np.nan)
    road = [np.zeros((0, 2), np.int64)]
    for row, z in zip(rows.tolist(), depth.tolist(), strict=True):
        if NEAR < z < FAR:
            half = camera.fx * HALF_WIDTH / z
            columns = np.arange(camera.cx - half, camera.cx + half, COLUMNS).astype(np.int64)
            columns = columns[(columns >= 0) & (columns < camera.width)]
            road.append(np.stack([columns, np.full(len(columns), row)], 1))
    return np.concatenate(road)


def _median(values: FloatArray) -> float:
    """NumPy's takes six times as long, for the mean of the two in the middle and for NaN."""
    return float(np.partition(values, len(values) // 2)[len(values) // 2])


def _smooth(image: ByteArray, pixels: IntArray, margin: int) -> tuple[ByteArray, list[int]]:
    """The part of an image around some pixels, and its left upper corner, x and y."""
    corner = np.maximum(pixels.min(0) - margin, 0)
    end = pixels.max(0) + margin + 1
    part = image[corner[1] : end[1], corner[0] : end[0]]
    return np.asarray(cv2.GaussianBlur(part, KERNEL, BLUR), np.uint8), corner.tolist()


def _gradient(image: ByteArray, across: int, down: int) -> ShortArray:
    """Eight times the slope of an image across, or down."""
    return np.asarray(cv2.Sobel(image, cv2.CV_16S, across, down, ksize=3), np.int16)
