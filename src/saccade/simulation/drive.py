"""Simulated camera drives with ground truth, by a fixed camera or one that pans."""

from bisect import bisect_right
from functools import cache
from threading import Lock

import numpy as np

from saccade.frames import CameraTurn, Drive, Frame, Gaze, GazeLimits, steps_between
from saccade.simulation.drive_config import DriveConfig, OdometryConfig
from saccade.simulation.rendering import Illumination, render, render_depth
from saccade.simulation.scene import Scene, floor_scene, planned_course
from saccade.slam.models import wrap
from saccade.types import FloatArray, Image, Trajectory

ENCODER_SIGMA = float(np.radians(0.1))
"""Standard deviation of the measured pan, in radians, by default."""


class PanCamera:
    """The pan of a camera over time, from the gazes it was told.

    Args:
        limits: range, rate and latency.
        sigma: standard deviation of the encoder in radians.
        seed: of its noise.
    """

    def __init__(
        self, limits: GazeLimits | None = None, sigma: float = ENCODER_SIGMA, seed: int = 0
    ) -> None:
        self.limits = limits or GazeLimits()
        self._sigma, self._seed = sigma, seed
        self._start, self._target = [-np.inf], [0.0]  # times at which it turns to each
        self._reason = [""]

    def turn_to(self, time: float, gaze: Gaze) -> None:
        """Begin to turn, after the latency; commands come in the order of their times."""
        self._start.append(time + self.limits.latency)
        self._target.append(float(np.clip(gaze.pan, *self.limits.pan)))
        self._reason.append(gaze.reason)

    def angle(self, time: float) -> float:
        """True pan at a time, by the commands up to now."""
        pan = self._target[0]
        for k in range(1, len(self._start)):
            end = self._start[k + 1] if k + 1 < len(self._start) else np.inf
            turned = self.limits.rate * max(0.0, min(end, time) - self._start[k])
            pan += float(np.clip(self._target[k] - pan, -turned, turned))
        return pan

    def measured(self, time: float) -> CameraTurn:
        """The pan as the encoder measures it, and the reason of the command that it follows."""
        rng = np.random.default_rng([self._seed, round(1e6 * max(time, 0.0))])
        pan = self.angle(time) + self._sigma * rng.standard_normal()
        reason = self._reason[bisect_right(self._start, time) - 1]
        return CameraTurn(pan, 0.0, self._sigma, reason)


def lap_length(config: DriveConfig) -> float:
    """Length of the center line in metres."""
    along, across = (side - config.corridor for side in config.size)
    return 2 * (along + across) - (8 - 2 * np.pi) * config.turning_radius


def drive_course(config: DriveConfig, seed: np.random.SeedSequence) -> FloatArray:
    """Poses (frames, 3) of the robot on a rounded rectangle with a lateral oscillation.

    It starts at the origin, in the middle of the first side, heading along it, and turns left.
    The heading is tangential to the path. The seed determines the wavelength of the oscillation.
    Other worlds have a course of their own, see `floor_plans`.
    """
    if config.world != "ring":
        return planned_course(config.world, config.frames, config.frames_per_lap)
    lap = lap_length(config)
    s = np.arange(config.frames) * lap / config.frames_per_lap
    wave = 2 * np.pi / (lap * np.random.default_rng(seed).uniform(0.3, 0.45))
    lateral = config.sway * (1 - np.cos(wave * s)) / 2
    slope = config.sway * wave * np.sin(wave * s) / 2
    center, curvature = _center_line(config, s)
    x, y, heading = center.T
    tangent = heading + np.arctan2(slope, 1 - curvature * lateral)
    return np.stack(
        [x - lateral * np.sin(heading), y + lateral * np.cos(heading), wrap(tangent)], 1
    )


def _center_line(config: DriveConfig, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Poses (n, 3) and curvatures (n,) of the center line at arc lengths (n,)."""
    along, across = (side - config.corridor for side in config.size)
    radius = config.turning_radius
    pieces = [(along / 2 - radius, 0.0)]  # length, curvature; the lap ends within the last
    for side in (across, along, across, along):
        pieces += [(np.pi / 2 * radius, 1 / radius), (side - 2 * radius, 0.0)]
    start = np.concatenate([[0.0], np.cumsum([length for length, _ in pieces])])
    poses = np.zeros((len(start), 3))
    for i, (length, k) in enumerate(pieces):
        poses[i + 1] = _advance(poses[i], np.array([length]), np.array([k]))[0]
    s = s % lap_length(config)
    piece = np.clip(np.searchsorted(start, s, side="right") - 1, 0, len(pieces) - 1)
    curvature = np.array([k for _, k in pieces])[piece]
    return _advance(poses[piece].T, s - start[piece], curvature), curvature


def _advance(pose: FloatArray, length: FloatArray, curvature: FloatArray) -> FloatArray:
    """Poses (n, 3) at the ends of arcs from a pose (3,) or (3, n)."""
    x, y, heading = pose
    turn = curvature * length
    chord = length * np.sinc(turn / (2 * np.pi))
    direction = heading + turn / 2
    ends = (x + chord * np.cos(direction), y + chord * np.sin(direction), heading + turn)
    return np.stack(ends, 1)


SIDEWAYS = 0.2
"""Lateral noise of the odometry, as a fraction of the longitudinal noise."""


def simulate_drive(
    config: DriveConfig | None = None, seed: int = 0, pan: PanCamera | None = None
) -> Drive:
    """Simulate a camera drive through a rectangular corridor.

    Args:
        config: scene, camera, illumination and odometry; None for the defaults.
        seed: of walls, posters, lateral oscillation, illumination, image noise and odometry noise,
            each with an independent random stream: one setting does not affect the others.
        pan: turns the camera while the drive is read, frame by frame; None for a fixed one.

    Returns:
        The drive with its ground truth, which starts at the origin. `load` renders a frame, from
        any thread and in any order; its first call builds the scene, which takes a second.
        The covariances are those of the simulated noise; the bias has the magnitudes of the scale
        error and the heading drift.
    """
    config = config or DriveConfig()
    scene_seed, course_seed, light_seed, odometry_seed = np.random.SeedSequence(seed).spawn(4)
    time = np.arange(config.frames) / config.frame_rate
    pose = drive_course(config, course_seed)
    bias = (config.odometry.scale_percent / 100, np.deg2rad(config.odometry.heading_drift))
    control, covariance = _odometry(config.odometry, steps_between(pose), odometry_seed)
    camera = config.camera
    illumination = Illumination.sample(config.light, camera, time, light_seed)
    build_once, lock = cache(lambda: floor_scene(config, scene_seed)), Lock()

    def scene() -> Scene:
        with lock:
            return build_once()

    def image(i: int, view: FloatArray, right: bool) -> Image:
        return illumination.apply(render(scene(), camera, view, right), i, int(right))

    def load(i: int) -> Frame:
        i = range(len(time))[i]
        view, turn = pose[i], None
        if pan is not None:
            turn = pan.measured(float(time[i]))
            view = view + np.array([0.0, 0.0, pan.angle(float(time[i]))])
        return Frame(
            time=float(time[i]),
            image=image(i, view, right=False),
            right=None if config.baseline is None else image(i, view, right=True),
            depth=render_depth(scene(), camera, view) if config.depth else None,
            turn=turn,
        )

    return Drive(
        name=f"simulated {config.world}, seed {seed}",
        camera=camera,
        time=time,
        control=control,
        control_covariance=covariance,
        load=load,
        start=pose[0],
        odometry_bias=(bias[0], float(bias[1]), 0.0),
        truth=Trajectory(time, pose),
    )


def _odometry(
    config: OdometryConfig, steps: FloatArray, seed: np.random.SeedSequence
) -> tuple[FloatArray, FloatArray]:
    """Measured increments (t, 3), and the covariance (t, 3, 3) of their noise."""
    rng = np.random.default_rng(seed)
    signs = rng.choice([-1.0, 1.0], 2)
    scale = signs[0] * config.scale_percent / 100
    drift = signs[1] * np.deg2rad(config.heading_drift)
    measured = steps * (1 / (1 + scale), 1 / (1 + scale), 1)
    measured[:, 2] -= drift * measured[:, 0]
    distance = np.hypot(*steps[:, :2].T)
    along = config.distance_percent / 100 * distance
    turn = np.deg2rad(config.heading_sigma) * np.sqrt(distance)
    sigma = np.stack([along, SIDEWAYS * along, turn], 1)
    measured += sigma * rng.standard_normal(sigma.shape)
    return measured, sigma[:, :, None] ** 2 * np.eye(3)
