"""Metric scale of a single camera from the ground plane, by direct image alignment.

Images of the ground determine the translation of a single camera in units of its height, and the
height of the camera is part of the calibration.
"""

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from saccade.frames import Camera, directions
from saccade.types import BoolArray, FloatArray, IntArray
from saccade.visual.egomotion import Egomotion
from saccade.visual.optical_flow import ByteArray
from saccade.visual.robot_motion import CameraPose

MIN_GROUND_DISTANCE = 6.0
"""Minimum distance of the sampled ground in front of the camera, in meters."""
MAX_GROUND_DISTANCE = 16.0
"""Maximum distance of the sampled ground, in meters."""
GROUND_HALF_WIDTH = 1.3
"""Half the width of the sampled ground, in meters."""
ROW_STEP = 3
"""Spacing of the sampled rows, in pixels."""
COLUMN_STEP = 4
"""Spacing of the sampled columns, in pixels."""
BLUR_SIGMA = 1.5
"""Standard deviation of the Gaussian filter, in pixels."""
GROUND_TILT_SIGMAS = np.radians((0.7, 1.0))
"""Standard deviations of the ground's pitch and roll relative to the robot, in radians."""
MIN_VISIBLE = 0.3
"""Minimum fraction of the samples inside the next image."""
NOISE_CORRELATION = 7.0
"""Inflation of the standard deviation of intensities: neighboring pixels share the deviation of the
ground from the plane."""
MIN_DISTANCE = 0.3
"""Minimum length of a measured translation, in camera heights."""
MAX_GROUND_ITERATIONS = 15
"""Maximum number of Gauss-Newton iterations."""
CONVERGED_DISTANCE = 1e-3
"""Maximum relative change of a converged distance."""
DISTANCE_NOISE = 0.04
"""Relative standard deviation of a measured distance."""


def with_gradients(image: ByteArray) -> FloatArray:
    """(3, h, w) gray image and its Sobel derivatives along x and y, per pixel."""
    dx, dy = (cv2.Sobel(image, cv2.CV_64F, *order, ksize=3) / 8 for order in ((1, 0), (0, 1)))
    return np.stack([image, dx, dy])


class GroundTracker:
    """Measures the distance that a camera of known height moved over the ground."""

    def __init__(self, camera: Camera) -> None:
        self._camera, self._pixels = camera, _ground_samples(camera)
        self.rays = directions(camera, self._pixels.astype(np.float64))
        """(m, 3) rays of the sampled pixels in the camera's frame."""

    def distance(self, previous: ByteArray, current: ByteArray, motion: Egomotion) -> float | None:
        """Length of the camera's translation between two gray images (H, W), in meters.

        Robust Gauss-Newton minimizes the photometric error of the ground over distance, tilt of the
        plane, and gain and offset of the intensity. `motion` provides rotation and direction.

        Returns:
            The distance; None if the robot moved too little or no ground plane fits.
        """
        height = float(self._camera.position[2])
        initial = float(np.linalg.norm(motion.translation))
        if initial < MIN_DISTANCE * height or len(self._pixels) == 0:
            return None
        columns, rows = self._pixels.T
        before, after = (
            np.asarray(cv2.GaussianBlur(image, (0, 0), BLUR_SIGMA), np.uint8)
            for image in (previous, current)
        )
        intensity = before[rows, columns].astype(np.float64)
        state = self._align(intensity, with_gradients(after), motion)
        if state is None or (np.abs(state[1:]) > 1.5 * GROUND_TILT_SIGMAS).any():
            return None
        return float(state[0]) * height

    def _align(
        self, intensity: FloatArray, images: FloatArray, motion: Egomotion
    ) -> FloatArray | None:
        """Distance in camera heights and two tilts in radians (3,); None if not converged."""
        length = float(np.linalg.norm(motion.translation))
        initial = length / float(self._camera.position[2])
        direction = motion.translation / length
        axes = self._plane_axes(direction)
        state, prior = (
            np.array([initial, 0.0, 0.0]),
            np.diag(np.append(0.0, GROUND_TILT_SIGMAS**-2.0)),
        )
        brightness = None  # gain and offset, negated
        for _ in range(MAX_GROUND_ITERATIONS):
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
            sigma = 1.48 * np.median(np.abs(residual - np.median(residual))) + 0.3
            weight = 1 / np.square(1 + np.square(residual / (2 * sigma)))  # Geman & McClure (1987)
            weight /= (NOISE_CORRELATION * sigma) ** 2
            information, gradient = A.T @ (A * weight[:, None]), A.T @ (weight * values)
            information[:3, :3] += prior
            gradient[:3] += prior @ state
            step = -np.linalg.solve(information + 1e-9 * np.eye(5), gradient)
            state, brightness = state + step[:3], step[3:]
            if not 0 < state[0] < 10 * initial:
                return None
            if abs(step[0]) < CONVERGED_DISTANCE * state[0]:
                return state
        return None

    def _plane_axes(self, direction: FloatArray) -> FloatArray:
        """(3, 3) normal of the ground, direction of the motion, and their cross product."""
        normal = np.cross(direction, self._camera.rotation[1])
        normal *= -np.sign(normal @ self._camera.rotation[2]) / np.linalg.norm(normal)
        return np.stack([normal, direction, np.cross(normal, direction)])


def warp_ground(
    camera: Camera, rays: FloatArray, pose: CameraPose, plane: FloatArray, images: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Samples the next image at m points of the ground plane.

    Args:
        camera: the camera.
        rays: rays (m, 3) of the points in the previous camera frame.
        pose: motion of the camera, in camera heights.
        plane: (3, 3) normal of the ground plane, of length 1 without tilt, and its derivatives by
            the two tilts times the distance.
        images: result (3, h, w) of `with_gradients` for the next image.

    Returns:
        Intensities (n,) of the n points inside the image, their derivatives (n, 3) by distance and
        tilts, and (m,) whether each point is inside.
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
    """Pixels (m, 2) of a rectangle of ground in front of the robot."""
    down = -camera.rotation[2]
    rows = np.arange(camera.height - 4, 0, -ROW_STEP)
    steepness = down[1] * (rows - camera.cy) / camera.fy + down[2]
    depth = camera.position[2] / np.where(steepness > 0, steepness, np.nan)
    near = (depth > MIN_GROUND_DISTANCE) & (depth < MAX_GROUND_DISTANCE)
    half = camera.fx * GROUND_HALF_WIDTH / depth[near]
    steps = COLUMN_STEP * np.arange(camera.width) + 0 * half[:, None]
    columns = (camera.cx - half[:, None] + steps).astype(np.int64)
    kept = (steps < 2 * half[:, None]) & (columns >= 0) & (columns < camera.width)
    pixels = np.stack([columns, np.broadcast_to(rows[near, None], columns.shape)], 2)
    return np.asarray(pixels[kept], np.int64)
