"""A camera drive whose truth is known: the frames are rendered when they are asked for."""

from collections.abc import Callable
from threading import Lock

import numpy as np

from saccade.frames import Drive, Frame, steps_between
from saccade.simulation.course import drive_course
from saccade.simulation.drive_config import DriveConfig, OdometryConfig
from saccade.simulation.illumination import Illumination
from saccade.simulation.rendering import render, render_depth
from saccade.simulation.ring import ring_scene
from saccade.simulation.scene import Scene
from saccade.types import FloatArray, Trajectory

SIDEWAYS = 0.2
"""Noise of the odometry across the way, as a share of that along it."""


def simulate_drive(config: DriveConfig | None = None, seed: int = 0) -> Drive:
    """Drive through a ring with a camera.

    Args:
        config: the ring, the camera, the light, the odometry; the default one without.
        seed: of all that is drawn: the walls, which poster hangs where, the swaying of the robot,
            the light, the noise of the images and of the odometry. Each has a stream of its own:
            a change in one setting changes nothing else.

    Returns:
        The drive with its truth, which begins at the origin. `load` renders a frame, from any
        thread and in any order; at its first call it builds the place, which takes a second.
        The covariances are those of the noise that was drawn; the bias has the sizes of the
        scale and the drift that were.
    """
    config = config or DriveConfig()
    place, way, light, odometry = np.random.SeedSequence(seed).spawn(4)
    time = np.arange(config.frames) / config.frame_rate
    pose = drive_course(config, way)
    control, covariance = _odometry(config.odometry, steps_between(pose), odometry)
    camera = config.camera
    scene = _lazily(lambda: ring_scene(config, place))
    lit = Illumination.drawn(config.light, camera, time, light)

    def load(number: int) -> Frame:
        number = range(len(time))[number]
        pictures = [
            lit.apply(render(scene(), camera, pose[number], right), number, int(right))
            for right in ((False, True) if camera.baseline > 0 else (False,))
        ]
        return Frame(
            float(time[number]),
            pictures[0],
            pictures[1] if len(pictures) > 1 else None,
            render_depth(scene(), camera, pose[number]) if config.depth else None,
        )

    return Drive(
        name=f"simulated ring, seed {seed}",
        camera=camera,
        time=time,
        control=control,
        control_covariance=covariance,
        load=load,
        start=pose[0],
        odometry_bias=(config.odometry.scale / 100, float(np.deg2rad(config.odometry.drift)), 0.0),
        truth=Trajectory(time, pose),
    )


def _lazily(build: Callable[[], Scene]) -> Callable[[], Scene]:
    """`build`, called at the first need only: who wants no frames need not wait for the walls."""
    lock, built = Lock(), list[Scene]()

    def scene() -> Scene:
        with lock:
            if not built:
                built.append(build())
        return built[0]

    return scene


def _odometry(
    config: OdometryConfig, steps: FloatArray, seed: np.random.SeedSequence
) -> tuple[FloatArray, FloatArray]:
    """The steps (t, 3) as the wheels measure them, and the covariance (t, 3, 3) of their noise."""
    rng = np.random.default_rng(seed)
    signs = rng.choice([-1.0, 1.0], 2)
    scale = signs[0] * config.scale / 100
    drift = signs[1] * np.deg2rad(config.drift)
    measured = steps * (1 / (1 + scale), 1 / (1 + scale), 1)
    measured[:, 2] -= drift * measured[:, 0]
    way = np.hypot(*steps[:, :2].T)
    white = config.white / 100 * way
    turn = np.deg2rad(config.turn) * np.sqrt(way)
    sigma = np.stack([white, SIDEWAYS * white, turn], 1)
    measured += sigma * rng.standard_normal(sigma.shape)
    return measured, sigma[:, :, None] ** 2 * np.eye(3)
