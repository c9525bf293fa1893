"""Simulated landmark logs with ground truth."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from saccade.errors import Settings, require, setting
from saccade.plane import path_of
from saccade.slam.filter.robot_models import wrap
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

LAYOUT_SEED = 2010
"""Seed of the landmark positions, by default; they are equal in all runs."""

CALIBRATED = (0.001, 0.001)
"""Declared systematic errors of the ranges: the simulated sensor has none."""


@dataclass(frozen=True)
class WorldConfig(Settings):
    """A course, the landmarks along it, and the noise of the sensors."""

    vehicle: Literal["robot", "car"] = "robot"
    """Noise model: distance and turn of a robot, or speed and steering angle of a car."""
    course_length: float = setting(20 * np.pi, 1e-6, 1e6)
    """Length of one lap in meters."""
    curvature_amplitude: float = setting(0.0, 0, 3)
    """Amplitude of the curvature relative to its mean, with three periods per lap; 0 is a circle,
    over 1 includes turns to the other side."""
    steps: int = setting(1500, 1, 10**6)
    """Number of steps; there is one pose more."""
    step_length: float = setting(0.25, 1e-6, 1e6)
    """Meters per step."""
    step_time: float = setting(1.0, 1e-6, 1e6)
    """Seconds per step."""
    landmarks: int = setting(20, 1, 10**6)
    """Number of landmarks along the course."""
    landmark_spread: float = setting(5.0, 0, 1000)
    """Largest distance of a landmark from the course, to either side, in meters."""
    group_size: int = setting(1, 1, 10**6)
    """Number of landmarks in each group, within a meter or so; 1 for no groups."""
    layout: int = setting(LAYOUT_SEED, 0, 2**31)
    """Seed of the positions of the landmarks."""
    scan_interval: int = setting(1, 1, 10**6)
    """Steps per scan."""
    range_limits: tuple[float, float] = setting((0.5, 5.0), 0, below=1e6)
    """Smallest and largest range of an observation, in meters."""
    field_of_view_deg: float = setting(360.0, 0.1, 360)
    """Field of view about the heading, in degrees."""
    range_percent: float = setting(5.0, 0, 1000)
    """Standard deviation of a range, in percent of it."""
    range_sigma: float = setting(0.0, 0, 1000)
    """Standard deviation added to that, in meters."""
    bearing_sigma_deg: float = setting(3.0, 0, 1000)
    """Standard deviation of a bearing, in degrees."""
    odometry_percent: float = setting(2.0, 0, 1000)
    """Odometry noise f of a robot: standard deviations in a step of v meters are f v / sqrt 2
    meters ahead and 2 sqrt 2 f v radians of turn."""
    turn_sigma_deg: float = setting(0.0, 0, 1000)
    """Additional standard deviation of a robot's turn in a step, in degrees."""
    scale_percent: float = setting(0.0, 0, 1000)
    """Systematic error of a robot's distances, in percent, whose sign is drawn."""
    heading_drift_deg: float = setting(0.0, 0, 1000)
    """Systematic error of a robot's turns, in degrees per meter, whose sign is drawn."""
    speed_sigma: float = setting(0.3, 0, 1000)
    """Standard deviation of a car's speed in a step, in meters per second."""
    steering_sigma_deg: float = setting(3.0, 0, 1000)
    """Standard deviation of a car's steering angle in a step, in degrees."""
    wheel_base: float = setting(4.0, 1e-6, 1e6)
    """Meters between a car's axles."""

    def __post_init__(self) -> None:
        super().__post_init__()
        near, far = self.range_limits
        require(near < far, "range_limits", "two ascending numbers", self.range_limits)

    @classmethod
    def loop(cls) -> "WorldConfig":
        """A circle, after Huang, Mourikis & Roumeliotis (2010): the default."""
        return cls()

    @classmethod
    def slippery(cls) -> "WorldConfig":
        """The circle with 1.5 times the odometry noise."""
        return cls(odometry_percent=3.0)

    @classmethod
    def coarse(cls) -> "WorldConfig":
        """The circle with coarse sensors."""
        return cls(range_percent=10.0, bearing_sigma_deg=10.0, odometry_percent=5.0)

    @classmethod
    def car(cls) -> "WorldConfig":
        """A car with a laser scanner, two laps of a closed course, after Bailey et al. (2006)."""
        return cls(
            vehicle="car",
            course_length=400.0,
            curvature_amplitude=1.5,
            steps=10667,
            step_length=0.075,
            step_time=0.025,
            landmarks=35,
            landmark_spread=20.0,
            scan_interval=8,
            range_limits=(0.0, 30.0),
            field_of_view_deg=180.0,
            range_percent=0.0,
            range_sigma=0.1,
            bearing_sigma_deg=1.0,
        )


def simulate_world(config: WorldConfig = WorldConfig(), seed: int = 0) -> LandmarkLog:
    """Simulate one run through a world.

    Args:
        config: the world; its landmarks do not depend on the seed.
        seed: of the noise.

    Returns:
        A log with landmark labels and ground truth. It starts at the true pose, the origin;
        its covariances describe the simulated noise.
    """
    rng = np.random.default_rng(seed)
    commands = _commands(config)
    truth = _poses(_increments(config, commands))  # (t + 1, 3)
    landmarks = _landmarks(config)  # (n, 2)
    bias = config.scale_percent / 100, float(np.deg2rad(config.heading_drift_deg))
    scale, drift = bias * np.random.default_rng((seed, 1)).choice([-1.0, 1.0], 2)
    distance, turn = commands.T
    is_robot = config.vehicle == "robot"
    if is_robot:  # by its wheels, without noise
        distance = distance / (1 + scale)
    control, U = _odometry(config, np.stack([distance, turn], 1), rng)
    if is_robot:
        control[:, 2] -= drift * distance
    pose, landmark, z = _observations(config, truth, landmarks)
    sigma = np.empty(z.shape)
    sigma[:, 0] = config.range_percent / 100 * z[:, 0] + config.range_sigma
    sigma[:, 1] = np.deg2rad(config.bearing_sigma_deg)
    z += sigma * rng.standard_normal(z.shape)
    z[:, 0] = np.abs(z[:, 0])  # no sensor gives a negative range
    time = config.step_time * np.arange(len(truth), dtype=np.float64)
    return LandmarkLog(
        name=f"simulated {config.vehicle}, seed {seed}",
        start=truth[0],
        time=time,
        control=control,
        control_covariance=U,
        odometry_bias=(*bias, 0.0),
        range_errors=CALIBRATED,
        observation_pose=pose,
        observation=z,
        observation_covariance=sigma[:, :, None] ** 2 * np.eye(2),
        landmark=landmark,
        truth=Trajectory(time, truth),
        landmark_truth=LandmarkMap(np.arange(len(landmarks)), landmarks),
    )


def _commands(config: WorldConfig) -> FloatArray:
    """Commands (t, 2): distance and turn of a robot, speed and steering angle of a car."""
    laps = (np.arange(config.steps) + 0.5) * config.step_length / config.course_length
    modulation = 1 + config.curvature_amplitude * np.cos(6 * np.pi * laps)
    curvature = 2 * np.pi / config.course_length * modulation
    if config.vehicle == "robot":
        return np.stack(
            [np.full(config.steps, config.step_length), curvature * config.step_length], 1
        )
    sine = curvature * config.wheel_base
    feasible, amplitude = bool(np.abs(sine).max() < 1), config.curvature_amplitude
    require(feasible, "curvature_amplitude", "a course that the car can steer", amplitude)
    speed = np.full(config.steps, config.step_length / config.step_time)
    return np.stack([speed, np.arcsin(sine)], 1)


def _increments(config: WorldConfig, commands: FloatArray) -> FloatArray:
    """Motion (t, 3) by commands (t, 2), in the frame of the vehicle.

    A robot turns, then goes ahead. The pose of a car is the middle of its front axle, which moves
    in the direction of its wheels.
    """
    d, angle = commands.T
    if config.vehicle == "robot":
        return np.stack([d * np.cos(angle), d * np.sin(angle), angle], 1)
    d = d * config.step_time
    lateral = d * np.sin(angle)
    return np.stack([d * np.cos(angle), lateral, lateral / config.wheel_base], 1)


def _odometry(
    config: WorldConfig, commands: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Measured increments (t, 3), and their covariance (t, 3, 3)."""
    is_car = config.vehicle == "car"
    fraction = config.odometry_percent / 100 * config.step_length
    turn = 2 * np.sqrt(2) * fraction + np.deg2rad(config.turn_sigma_deg)
    sigma = np.array([fraction / np.sqrt(2), turn])
    if is_car:
        sigma = np.array([config.speed_sigma, np.deg2rad(config.steering_sigma_deg)])
    measured = commands + sigma * rng.standard_normal(commands.shape)
    d, c, s = measured[:, 0], np.cos(measured[:, 1]), np.sin(measured[:, 1])
    B = np.zeros((len(commands), 3, 2))  # by the commands
    scale = config.step_time if is_car else 1.0
    B[:, 0] = np.stack([c, -d * s], 1) * scale
    B[:, 1] = np.stack([s, d * c], 1) * scale
    B[:, 2] = B[:, 1] / config.wheel_base if is_car else (0.0, 1.0)
    return _increments(config, measured), B @ np.diag(sigma**2) @ B.transpose(0, 2, 1)


def _poses(steps: FloatArray) -> FloatArray:
    """Poses (t + 1, 3) from the origin by increments (t, 3)."""
    pose = path_of(steps)
    pose[:, 2] = wrap(pose[:, 2])
    return pose


def _landmarks(config: WorldConfig) -> FloatArray:
    """(n, 2) random landmarks along the course and to its sides."""
    rng = np.random.default_rng(config.layout)
    steps_per_lap = int(np.ceil(config.course_length / config.step_length))
    lap = replace(config, steps=steps_per_lap)
    course = _poses(_increments(lap, _commands(lap)))
    groups = -(-config.landmarks // config.group_size)
    pose = course[rng.integers(0, len(course), groups)]  # (g, 3)
    left = np.stack([-np.sin(pose[:, 2]), np.cos(pose[:, 2])], 1)
    spread = config.landmark_spread
    center = pose[:, :2] + left * rng.uniform(-spread, spread, (groups, 1))
    if config.group_size == 1:
        return center
    xy = np.repeat(center, config.group_size, 0)[: config.landmarks]
    return xy + rng.standard_normal(xy.shape)


def _observations(
    config: WorldConfig, truth: FloatArray, landmarks: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Pose (k,) and landmark (k,) of each observation, and its range and bearing (k, 2)."""
    scans = np.arange(0, len(truth), config.scan_interval)
    offset = landmarks - truth[scans, None, :2]  # (scans, n, 2)
    z = np.empty(offset.shape)
    z[..., 0] = np.hypot(offset[..., 0], offset[..., 1])
    z[..., 1] = wrap(np.arctan2(offset[..., 1], offset[..., 0]) - truth[scans, None, 2])
    nearest, farthest = config.range_limits
    visible = (z[..., 0] >= nearest) & (z[..., 0] <= farthest)
    visible &= np.abs(z[..., 1]) <= np.deg2rad(config.field_of_view_deg / 2)
    scan, landmark = np.nonzero(visible)
    return scans[scan], landmark.astype(np.int64), z[visible]
