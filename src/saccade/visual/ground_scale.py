"""Metric scale of a single camera from the ground plane (direct image alignment).

A single camera does not measure the length of its motion, but its height above the ground gives
the scale: from the image of the ground follows the translation in camera heights.
"""

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from saccade.frames import Camera
from saccade.types import BoolArray, FloatArray, IntArray
from saccade.visual.camera import directions
from saccade.visual.egomotion import Egomotion
from saccade.visual.optical_flow import ByteArray
from saccade.visual.robot_motion import CameraPose

NEAR = 6.0
"""Least distance of the sampled ground in front of the camera, in meters."""
FAR = 16.0
"""Largest distance of the sampled ground, in meters."""
HALF_WIDTH = 1.3
"""Half the width of the sampled ground, in meters."""
ROW_STEP = 3
"""Rows between samples."""
COLUMN_STEP = 4
"""Columns between samples."""
BLUR_SIGMA = 1.5
"""Standard deviation of the Gaussian filter, in pixels."""
BLUR_SIZE = 7, 7
"""Size of its window."""
TILT_SIGMA = np.radians((0.7, 1.0))
"""Standard deviations of the ground's pitch and roll relative to the robot."""
MIN_VISIBLE = 0.3
"""Fraction of the samples that must be inside the next image."""
NOISE_CORRELATION = 7.0
"""Standard deviation of the mean over that for independent pixels: neighbors share the deviation
of the ground from the plane."""
MIN_DISTANCE = 0.3
"""Least length of a translation, in camera heights."""
MAX_ITERATIONS = 15
"""Largest number of iterations of Gauss-Newton."""
CONVERGED = 1e-3
"""Largest relative change of a converged distance."""
DISTANCE_NOISE = 0.04
"""Standard deviation of a measured distance, as a fraction of it."""


def with_gradients(image: ByteArray) -> FloatArray:
    """(3, h, w) a gray image and its derivatives along rows and columns (Sobel), in 1 / pixels."""
    dx, dy = (cv2.Sobel(image, cv2.CV_64F, *order, ksize=3) / 8 for order in ((1, 0), (0, 1)))
    return np.stack([image, dx, dy])


class GroundTracker:
    """Measures how far the camera moved over the ground, if the calibration has its height."""

    def __init__(self, camera: Camera) -> None:
        self._camera, self._pixels = camera, _ground_samples(camera)
        self.rays = directions(camera, self._pixels.astype(np.float64))
        """(m, 3) rays of the sampled pixels in the camera's frame."""

    def distance(self, previous: ByteArray, current: ByteArray, motion: Egomotion) -> float | None:
        """Length of the camera's translation between two gray images (H, W), in meters.

        Distance, tilt of the plane, gain and offset of the intensity minimize the photometric
        error of the ground (robust Gauss-Newton), for the rotation and the direction of a motion.
        None where the robot moved too little, or no ground plane fits.
        """
        height = float(self._camera.position[2])
        initial = float(np.linalg.norm(motion.translation))
        if initial < MIN_DISTANCE * height or len(self._pixels) == 0:
            return None
        columns, rows = self._pixels.T
        before, after = (
            np.asarray(cv2.GaussianBlur(image, BLUR_SIZE, BLUR_SIGMA), np.uint8)
            for image in (previous, current)
        )
        intensity = before[rows, columns].astype(np.float64)
        state = self._align(intensity, with_gradients(after), motion)
        if state is None or (np.abs(state[1:]) > 1.5 * TILT_SIGMA).any():
            return None
        return float(state[0]) * height

    def _align(
        self, intensity: FloatArray, images: FloatArray, motion: Egomotion
    ) -> FloatArray | None:
        """(3,) distance in camera heights and two tilts in radians; None if not converged."""
        length = float(np.linalg.norm(motion.translation))
        initial = length / float(self._camera.position[2])
        direction = motion.translation / length
        axes = self._plane_axes(direction)
        state, prior = np.array([initial, 0.0, 0.0]), np.diag(np.append(0.0, TILT_SIGMA**-2.0))
        brightness = None  # gain and offset, negated
        for _ in range(MAX_ITERATIONS):
            normal = axes.T @ np.append(1.0, state[1:])
            plane = np.stack([normal, state[0] * axes[1], state[0] * axes[2]])
            pose = motion.rotation, state[0] * direction
            values, by_plane, inside = warp_ground(self._camera, self.rays, pose, plane, images)
            if len(values) < MIN_VISIBLE * len(intensity):
                return None
            A = np.column_stack([by_plane, -intensity[inside], np.full(len(values), -1.0)])
            if brightness is None:
                brightness = np.array([-values.sum() / min(A[:, 3].sum(), -1.0), 0.0])
            residual = values + A[:, 3:] @ brightness
            sigma = 1.48 * _median(np.abs(residual - _median(residual))) + 0.3
            weight = 1 / np.square(1 + np.square(residual / (2 * sigma)))  # Geman & McClure (1987)
            weight /= (NOISE_CORRELATION * sigma) ** 2
            information, gradient = A.T @ (A * weight[:, None]), A.T @ (weight * values)
            information[:3, :3] += prior
            gradient[:3] += prior @ state
            step = -np.linalg.solve(information + 1e-9 * np.eye(5), gradient)
            state, brightness = state + step[:3], step[3:]
            if not 0 < state[0] < 10 * initial:
                return None
            if abs(step[0]) < CONVERGED * state[0]:
                return state
        return None

    def _plane_axes(self, direction: FloatArray) -> FloatArray:
        """(3, 3) normal of the ground, direction of motion along it, and their cross product."""
        normal = np.cross(direction, self._camera.rotation[1])
        normal *= -np.sign(normal @ self._camera.rotation[2]) / np.linalg.norm(normal)
        return np.stack([normal, direction, np.cross(normal, direction)])


def warp_ground(
    camera: Camera, rays: FloatArray, pose: CameraPose, plane: FloatArray, images: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Sample the next image at m points of the ground plane, rays (m, 3) of the previous camera.

    `images` are those of `with_gradients`. Lengths of the pose are in camera heights. The rows of
    `plane` (3, 3) are its normal, of length 1 where it has no tilt, and `distance` times its
    derivatives by the two tilts.

    Returns:
        For the n points inside the image: (n,) intensities, (n, 3) their derivatives by distance
        and tilts; and (m,) which points they are.
    """
    R, t = pose
    distance = np.linalg.norm(t)
    by_plane = rays @ plane.T
    moved = rays @ R.T + by_plane[:, :1] * t
    height, width = images.shape[1:]
    z = np.where(moved[:, 2] > 0, moved[:, 2], np.nan)
    uv = moved[:, :2] / z[:, None]
    x, y = (uv * (camera.fx, camera.fy) + (camera.cx, camera.cy)).T
    inside = (x > 1) & (x < width - 2) & (y > 1) & (y < height - 2)
    at = np.stack([y[inside], x[inside]])
    values, dx, dy = (map_coordinates(each, at, np.float64, order=1) for each in images)
    by_shift = (t[:2] - uv[inside] * t[2]) / distance / z[inside, None]
    slope = (by_shift * (camera.fx, camera.fy) * np.stack([dx, dy], 1)).sum(1)
    return values, slope[:, None] * by_plane[inside], inside


def _ground_samples(camera: Camera) -> IntArray:
    """(m, 2) pixels of a trapezoid of ground in front of the robot."""
    down = -camera.rotation[2]
    rows = np.arange(camera.height - 4, 0, -ROW_STEP)
    steepness = down[1] * (rows - camera.cy) / camera.fy + down[2]
    depth = camera.position[2] / np.where(steepness > 0, steepness, np.nan)
    near = (depth > NEAR) & (depth < FAR)
    half = camera.fx * HALF_WIDTH / depth[near]
    steps = COLUMN_STEP * np.arange(camera.width) + 0 * half[:, None]
    columns = (camera.cx - half[:, None] + steps).astype(np.int64)
    kept = (steps < 2 * half[:, None]) & (columns >= 0) & (columns < camera.width)
    pixels = np.stack([columns, np.broadcast_to(rows[near, None], columns.shape)], 2)
    return np.asarray(pixels[kept], np.int64)


def _median(values: FloatArray) -> float:
    """The upper median; NumPy's averages two, checks for NaN, and takes six times as long."""
    return float(np.partition(values, len(values) // 2)[len(values) // 2])
