"""Simulated stereo tracks and odometry along a real trajectory, with errors of the calibration.

Side-slip, tilt and acceleration are those of the trajectory; noise, lifetimes and odometry have by
default the sizes measured on KITTI's drive 07.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from saccade.errors import Settings, setting
from saccade.frames import Camera, Drive, Frame, Tracks
from saccade.plane import steps_between
from saccade.types import FloatArray, IntArray, Trajectory

MIN_DISPARITY = 0.6
"""Pixels under which a point is not matched."""
UNKNOWN_SIGMA = (2.0, 2.0, 1.0)
"""Standard deviations of speeds (m/s) and turn rate (rad/s) where there is no odometry."""


@dataclass(frozen=True)
class TrackConfig(Settings):
    """Tracks, odometry, and by how much the calibration is wrong.

    Raises:
        ConfigError: a setting outside its range.
    """

    points: int = setting(75, 6, 1e4)
    """Largest number of points tracked at a time."""
    survival: float = setting(0.97, 0, 1)
    """Probability that a point is tracked into the next frame."""
    refresh: int = setting(12, 0, 1e6)
    """Mean number of frames after which all tracks end at once, so that none is common to two
    frames; 0 for tracks that are replaced one by one."""
    pixel_sigma: float = 0.25
    """Standard deviation of a pixel."""
    drift_sigma: float = 0.05
    """Standard deviation in pixels by which a track drifts from frame to frame."""
    disparity_sigma: float = 0.1
    """Standard deviation of a disparity in pixels, besides drift."""
    outliers: float = 0.015
    """Fraction of the points that move by themselves, by some pixels a frame."""
    focal: float = 0.0
    """Fraction by which the true focal length exceeds that of the calibration."""
    offset: float = 0.0
    """Pixels by which measured disparities are too large."""
    slope: float = 0.0
    """The same at the radius of a focal length, beside the offset."""
    distortion: float = 0.0
    """Radial distortion at the radius of a focal length, as a fraction of that."""
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector of the camera on the robot, in degrees in the robot's frame, that the
    calibration does not have."""
    odometry: bool = True
    """Whether there is odometry; its motion has no side-slip."""
    speed_sigma: float = 0.46
    """Standard deviation of a sample of the speed, in m/s."""
    turn_sigma: float = 0.036
    """Standard deviation of a sample of the turn rate, in rad/s."""
    speed_scale: float = 0.0
    """Fraction by which speeds are too large."""
    turn_bias: float = 0.0
    """Bias of the turn rate in rad/s."""
    declared: tuple[float, float, float] = (0.055, 0.0164, 0.0077)
    """Standard deviations of an increment that odometry declares: metres ahead and to the left,
    radians."""


def simulate_tracks(
    camera: Camera,
    poses: FloatArray,
    truth: Trajectory,
    config: TrackConfig,
    seed: int,
    name: str = "tracks",
) -> Drive:
    """A drive of stereo tracks.

    Args:
        camera: the calibration that is true.
        poses: (n, 3, 4) of the camera in the world.
        truth: (n,) poses of the robot.
        config: errors.
        seed: of all random numbers.
        name: of the drive.
    """
    rng = np.random.default_rng(seed)
    frames = _tracks(camera, poses, config, rng)
    control, covariance = _odometry(truth, config, rng)

    def load(number: int) -> Frame:
        return Frame(float(truth.time[number]), tracks=frames[number])

    R = cv2.Rodrigues(np.radians(config.rotation))[0]
    return Drive(
        name=name,
        camera=replace(camera, rotation=R.T @ camera.rotation),
        time=truth.time,
        control=control,
        control_covariance=covariance,
        has_odometry=config.odometry,
        load=load,
        start=truth.pose[0],
        truth=truth,
    )


def _tracks(
    camera: Camera, poses: FloatArray, config: TrackConfig, rng: np.random.Generator
) -> list[Tracks]:
    """The tracks of each frame."""
    focal = camera.fx * (1 + config.focal)
    center = np.array([camera.cx, camera.cy])
    id: IntArray = np.zeros(0, np.int64)
    point, drift, own = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2))
    frames, first = list[Tracks](), 0
    for pose in poses:
        ends = config.refresh > 0 and rng.random() < 1 / config.refresh
        kept = rng.random(len(id)) < (0.0 if ends else config.survival)
        id, point, drift, own = id[kept], point[kept], drift[kept], own[kept]
        count = config.points - len(id) if ends or len(id) == 0 or config.refresh == 0 else 0
        if count > 0:
            size = np.array([camera.width, camera.height])
            xy = (rng.normal((0.45, 0.38), (0.2, 0.2), (count, 2)) % 1) * size
            disparity = np.exp(rng.normal(np.log(14.0), 0.8, count)) * focal / 707
            depth = focal * camera.baseline / disparity.clip(1.0, 90.0)
            place = np.c_[(xy - center) / focal, np.ones(count)] * depth[:, None]
            id = np.concatenate([id, first + np.arange(count)])
            point = np.concatenate([point, place @ pose[:, :3].T + pose[:, 3]])
            drift = np.concatenate([drift, np.zeros((count, 3))])
            moves = (rng.random(count) < config.outliers)[:, None]
            own = np.concatenate([own, moves * rng.normal(0, 3, (count, 2))])
            first += count
        drift = drift + config.drift_sigma * rng.normal(size=drift.shape)
        drift[:, :2] += own
        local = (point - pose[:, 3]) @ pose[:, :3]
        ray = local[:, :2] / np.maximum(local[:, 2:], 0.5)
        squared = np.square(ray).sum(1, keepdims=True)
        xy = center + focal * ray * (1 + config.distortion * squared)
        disparity = focal * camera.baseline / np.maximum(local[:, 2], 0.5)
        disparity *= 1 + config.distortion * (3 * ray[:, 0] ** 2 + ray[:, 1] ** 2)
        disparity += config.offset + config.slope * ray[:, 0] + 0.5 * drift[:, 2]
        xy = xy + drift[:, :2] + config.pixel_sigma * rng.normal(size=xy.shape)
        disparity += config.disparity_sigma * rng.normal(size=len(xy))
        seen = (local[:, 2] > 2) & (disparity > MIN_DISPARITY)
        seen &= ((xy > 0) & (xy < (camera.width, camera.height))).all(1)
        id, point, drift, own = id[seen], point[seen], drift[seen], own[seen]
        frames.append(Tracks(id, xy[seen], disparity[seen]))
    return frames


def _odometry(
    truth: Trajectory, config: TrackConfig, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Increments (n - 1, 3) of a robot that never slips, and their covariances."""
    step, seconds = steps_between(truth.pose), np.diff(truth.time)
    n = len(step)
    if not config.odometry:
        sigma = np.outer(seconds, UNKNOWN_SIGMA)
        return np.zeros((n, 3)), np.square(sigma)[:, :, None] * np.eye(3)
    noise = rng.normal(size=(n + 1, 2)) * (config.speed_sigma, config.turn_sigma)
    noise = (noise[1:] + noise[:-1]) / 2 + (0.0, config.turn_bias)
    d = step[:, 0] * (1 + config.speed_scale) + noise[:, 0] * seconds
    phi = step[:, 2] + noise[:, 1] * seconds
    covariance = np.square(config.declared)[:, None] * np.eye(3)
    lever = np.zeros((n, 3, 3)) + np.eye(3)
    lever[:, 1, 2] = d / 2
    control = np.stack([d * np.cos(phi / 2), d * np.sin(phi / 2), phi], 1)
    return control, lever @ covariance @ lever.transpose(0, 2, 1)
