"""A robot that drives round a course among landmarks: its log, and the truth."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np

from saccade.errors import require
from saccade.slam.models import wrap
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

LAYOUT_SEED = 2010
"""Where the landmarks of a world are does not change from run to run."""


@dataclass(frozen=True)
class WorldConfig:
    """A course, the landmarks along it, and what the sensors of the robot get wrong."""

    vehicle: Literal["robot", "car"] = "robot"
    """What errs: a robot's distance and turn, or a car's speed and steering angle."""
    length: float = 20 * np.pi
    """Of the course, in metres."""
    bends: float = 0.0
    """How much the curvature swings, three times a round; 0 is a circle, over 1 turns back."""
    steps: int = 1500
    """Of the robot along it, as many as there are poses after the first."""
    stride: float = 0.25
    """Metres driven in a step."""
    step_time: float = 1.0
    """Seconds that a step takes."""
    landmarks: int = 20
    """Scattered along the course."""
    beside: float = 5.0
    """Metres to either side of the course within which they are."""
    scan_every: int = 1
    """Steps from scan to scan."""
    range_limits: tuple[float, float] = (0.5, 5.0)
    """Metres within which a landmark is seen."""
    field_of_view: float = 360.0
    """Degrees of the field of view, in the middle of which is the way ahead."""
    range_percent: float = 5.0
    """Standard deviation of a range, in per cent of it."""
    range_sigma: float = 0.0
    """And what is added to that, in metres."""
    bearing_sigma: float = 3.0
    """Standard deviation of a bearing, in degrees."""
    odometry_percent: float = 2.0
    """f of a robot: standard deviations in a step of v metres are f v / sqrt 2 metres ahead and
    2 sqrt 2 f v radians of turn."""
    speed_sigma: float = 0.3
    """Standard deviation of a car's speed in a step, in metres per second."""
    steering_sigma: float = 3.0
    """Standard deviation of a car's steering angle in a step, in degrees."""
    wheel_base: float = 4.0
    """Metres between a car's axles."""

    def __post_init__(self) -> None:
        kinds = ("robot", "car")
        require(self.vehicle in kinds, "vehicle", f"one of {kinds}", self.vehicle)
        for name in ("steps", "landmarks", "scan_every"):
            require(1 <= getattr(self, name) <= 10**6, name, "1 to 1e6", getattr(self, name))
        for name in ("length", "stride", "step_time", "wheel_base"):
            require(0 < getattr(self, name) < 1e6, name, "over 0, under 1e6", getattr(self, name))
        for name in (
            "beside",
            "range_percent",
            "range_sigma",
            "bearing_sigma",
            "odometry_percent",
            "speed_sigma",
            "steering_sigma",
        ):
            require(0 <= getattr(self, name) < 1e3, name, "0 to under 1000", getattr(self, name))
        require(0 <= self.bends <= 3, "bends", "0 to 3", self.bends)
        require(
            0 < self.field_of_view <= 360,
            "field_of_view",
            "over 0 degrees, up to 360",
            self.field_of_view,
        )
        require(
            len(self.range_limits) == 2 and 0 <= self.range_limits[0] < self.range_limits[1] < 1e6,
            "range_limits",
            "two ascending numbers from 0",
            self.range_limits,
        )

    @classmethod
    def loop(cls) -> "WorldConfig":
        """A circle, after Huang, Mourikis & Roumeliotis (2010): the default."""
        return cls()

    @classmethod
    def slippery(cls) -> "WorldConfig":
        """The circle with half as much again of odometry noise."""
        return cls(odometry_percent=3.0)

    @classmethod
    def coarse(cls) -> "WorldConfig":
        """The circle with coarse sensors."""
        return cls(range_percent=10.0, bearing_sigma=10.0, odometry_percent=5.0)

    @classmethod
    def car(cls) -> "WorldConfig":
        """A car twice round a closed course with a laser, after Bailey et al. (2006)."""
        return cls(
            vehicle="car",
            length=400.0,
            bends=1.5,
            steps=10667,
            stride=0.075,
            step_time=0.025,
            landmarks=35,
            beside=20.0,
            scan_every=8,
            range_limits=(0.0, 30.0),
            field_of_view=180.0,
            range_percent=0.0,
            range_sigma=0.1,
            bearing_sigma=1.0,
        )


def simulate_world(config: WorldConfig = WorldConfig(), seed: int = 0) -> LandmarkLog:
    """Drive once through a world.

    Args:
        config: the world; its landmarks are where they are whatever the seed.
        seed: of the noise.

    Returns:
        A log that names its landmarks, with the truth: it begins at the true pose, the
        origin, and its covariances are those of the noise that was drawn.
    """
    rng = np.random.default_rng(seed)
    motion, exact = _controls(config)
    truth = _path(exact)  # (t + 1, 3)
    world = _layout(config)  # (n, 2)
    control, U = _odometry(config, motion, rng)
    pose, landmark, z = _observations(config, truth, world)
    sigma = np.empty(z.shape)
    sigma[:, 0] = config.range_percent / 100 * z[:, 0] + config.range_sigma
    sigma[:, 1] = np.deg2rad(config.bearing_sigma)
    time = config.step_time * np.arange(len(truth), dtype=np.float64)
    return LandmarkLog(
        name=f"simulated {config.vehicle}, seed {seed}",
        start=truth[0],
        time=time,
        motion="compose",
        control=control,
        control_covariance=U,
        observation_pose=pose,
        observation=z + sigma * rng.standard_normal(z.shape),
        observation_covariance=sigma[:, :, None] ** 2 * np.eye(2),
        landmark=landmark,
        truth=Trajectory(time, truth),
        landmark_truth=LandmarkMap(np.arange(len(world)), world),
    )


def _controls(config: WorldConfig) -> tuple[FloatArray, FloatArray]:
    """What the vehicle is told in each step (t, 2), and the poses (t, 3) to which that leads.

    A robot is told distance and turn, a car speed and steering angle.
    """
    middle = (np.arange(config.steps) + 0.5) * config.stride / config.length  # rounds
    curvature = 2 * np.pi / config.length * (1 + config.bends * np.cos(6 * np.pi * middle))
    if config.vehicle == "robot":
        turn = curvature * config.stride
        commanded = np.stack([np.full(config.steps, config.stride), turn], 1)
        return commanded, _robot_steps(commanded)
    sine = curvature * config.wheel_base
    require(np.abs(sine).max() < 1, "bends", "a course that the car can follow", config.bends)
    speed = np.full(config.steps, config.stride / config.step_time)
    commanded = np.stack([speed, np.arcsin(sine)], 1)
    return commanded, _car_steps(config, commanded)


def _robot_steps(commanded: FloatArray) -> FloatArray:
    """Turn, then go ahead."""
    d, turn = commanded.T
    return np.stack([d * np.cos(turn), d * np.sin(turn), turn], 1)


def _car_steps(config: WorldConfig, commanded: FloatArray) -> FloatArray:
    """Of the front axle's middle, which goes where its wheels point."""
    d, steering = commanded[:, 0] * config.step_time, commanded[:, 1]
    across = d * np.sin(steering)
    return np.stack([d * np.cos(steering), across, across / config.wheel_base], 1)


def _odometry(
    config: WorldConfig, commanded: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """The steps as the vehicle measures them (t, 3), and their covariance (t, 3, 3)."""
    fraction = config.odometry_percent / 100 * config.stride
    sigma = np.array([fraction / np.sqrt(2), 2 * np.sqrt(2) * fraction])
    if config.vehicle == "car":
        sigma = np.array([config.speed_sigma, np.deg2rad(config.steering_sigma)])
    measured = commanded + sigma * rng.standard_normal(commanded.shape)
    B = np.zeros((len(commanded), 3, 2))
    if config.vehicle == "car":
        speed, c, s = measured[:, 0], np.cos(measured[:, 1]), np.sin(measured[:, 1])
        B[:, 0] = np.stack([c, -speed * s], 1) * config.step_time
        B[:, 1] = np.stack([s, speed * c], 1) * config.step_time
        B[:, 2] = B[:, 1] / config.wheel_base
        steps = _car_steps(config, measured)
    else:
        d, c, s = measured[:, 0], np.cos(measured[:, 1]), np.sin(measured[:, 1])
        B[:, 0] = np.stack([c, -d * s], 1)
        B[:, 1] = np.stack([s, d * c], 1)
        B[:, 2, 1] = 1.0
        steps = _robot_steps(measured)
    return steps, B @ np.diag(sigma**2) @ B.transpose(0, 2, 1)


def _path(steps: FloatArray) -> FloatArray:
    """Poses (t + 1, 3) from the origin on."""
    pose = np.zeros((len(steps) + 1, 3))
    np.cumsum(steps[:, 2], out=pose[1:, 2])
    c, s = np.cos(pose[:-1, 2]), np.sin(pose[:-1, 2])
    np.cumsum(c * steps[:, 0] - s * steps[:, 1], out=pose[1:, 0])
    np.cumsum(s * steps[:, 0] + c * steps[:, 1], out=pose[1:, 1])
    pose[:, 2] = wrap(pose[:, 2])
    return pose


def _layout(config: WorldConfig) -> FloatArray:
    """(n, 2) landmarks, anywhere along the course and to its sides."""
    rng = np.random.default_rng(LAYOUT_SEED)
    round_ = dataclasses.replace(config, steps=int(np.ceil(config.length / config.stride)))
    course = _path(_controls(round_)[1])
    near = course[rng.integers(0, len(course), config.landmarks)]  # (n, 3)
    left = np.stack([-np.sin(near[:, 2]), np.cos(near[:, 2])], 1)
    return near[:, :2] + left * rng.uniform(-config.beside, config.beside, (config.landmarks, 1))


def _observations(
    config: WorldConfig, truth: FloatArray, world: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """From which pose (k,) each landmark (k,) is seen, and its range and bearing (k, 2)."""
    scans = np.arange(0, len(truth), config.scan_every)
    there = world - truth[scans, None, :2]  # (scans, n, 2)
    z = np.empty(there.shape)
    z[..., 0] = np.hypot(there[..., 0], there[..., 1])
    z[..., 1] = wrap(np.arctan2(there[..., 1], there[..., 0]) - truth[scans, None, 2])
    near, far = config.range_limits
    seen = (z[..., 0] >= near) & (z[..., 0] <= far)
    seen &= np.abs(z[..., 1]) <= np.deg2rad(config.field_of_view / 2)
    scan, landmark = np.nonzero(seen)
    return scans[scan], landmark.astype(np.int64), z[seen]
