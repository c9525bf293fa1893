"""Simulated camera drives with ground truth, by a fixed camera or one that pans.

Walls are vertical and the camera is level: each image column intersects one wall, at one depth.
The remaining texture lookup per sample is one call of OpenCV's remap.
"""

from bisect import bisect_right
from dataclasses import dataclass
from functools import cache
from threading import Lock
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import ConfigError
from saccade.frames import Camera, CameraTurn, Drive, Frame, Gaze, GazeLimits
from saccade.plane import steps_between
from saccade.simulation.drive_config import DriveConfig, LightConfig, OdometryConfig
from saccade.simulation.floor_plan import drive_course
from saccade.simulation.scene import ACROSS, DOWN, GROUND, Scene, floor_scene
from saccade.types import Float32Array, FloatArray, Image, IntArray, LandmarkMap, Trajectory

SAMPLES_PER_PIXEL = (3, 2)
"""Samples per pixel, across and down, which are averaged."""
NEAR_PLANE = 0.02
"""Near clipping plane, meters along the optical axis."""
WAVES = 4
"""Number of sine waves in a drift."""
PERIODS = (8.0, 40.0)
"""Shortest and longest period of these waves in seconds."""


class Columns(NamedTuple):
    """Intersections of n image columns with the walls."""

    wall: IntArray
    """(n,) index of the wall."""
    depth: FloatArray
    """(n,) meters along the optical axis."""
    position: FloatArray
    """(n,) meters along its band."""
    stretch: FloatArray
    """(n,) meters of wall per pixel across."""


def camera_position(camera: Camera, pose: FloatArray, right: bool = False) -> FloatArray:
    """(2,) position of the left or right camera of a robot at a pose (3,)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    ahead, left = camera.position[0], camera.position[1] - (camera.baseline if right else 0.0)
    return np.array([pose[0] + c * ahead - s * left, pose[1] + s * ahead + c * left])


def render(
    scene: Scene, camera: Camera, pose: FloatArray, right: bool = False
) -> npt.NDArray[np.uint8]:
    """The image of a level camera on a robot at a pose (3,), or of its right camera.

    Supersampled from the mipmap level that fits; (H, W) or (H, W, 3) as the atlas of the scene.
    """
    size = (camera.width, camera.height)
    x, y = (
        (np.arange(side * samples) + 0.5) / samples - 0.5
        for side, samples in zip(size, SAMPLES_PER_PIXEL, strict=True)
    )
    columns = intersect_walls(scene, camera, pose, x, right)
    across, down = _wall_texels(scene, camera, columns, y)
    horizon = int(np.searchsorted(y, camera.cy, side="right"))
    ground = _ground_texels(scene, camera, pose, x, y[horizon:], right)
    depth = camera.fy * camera.position[2] / (y[horizon:, None] - camera.cy)
    for walls, floor in zip((across, down), ground, strict=True):
        np.copyto(walls[horizon:], floor, where=depth < columns.depth)
    samples = cv2.remap(scene.atlas, across, down, cv2.INTER_LINEAR)
    return np.asarray(cv2.resize(samples, size, interpolation=cv2.INTER_AREA), np.uint8)


def motion_blur(image: npt.NDArray[np.uint8], width: float) -> npt.NDArray[np.uint8]:
    """An image averaged over a motion along its rows, `width` in pixels."""
    half = int(np.ceil(width / 2 - 0.5))
    if half < 1:
        return image
    kernel = np.full((1, 2 * half + 1), 1.0)
    kernel[0, [0, -1]] = width / 2 + 0.5 - half
    blurred = cv2.filter2D(image, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.uint8)


def render_depth(scene: Scene, camera: Camera, pose: FloatArray) -> FloatArray:
    """(H, W) meters along the optical axis at pixel centers; NaN for the sky."""
    x, y = np.arange(camera.width), np.arange(camera.height)[:, None]
    wall = intersect_walls(scene, camera, pose, x, False).depth
    tangent = (y - camera.cy) / camera.fy
    height = camera.position[2] - tangent * wall
    with np.errstate(divide="ignore"):
        ground = camera.position[2] / tangent
    return np.where(height > scene.wall_height, np.nan, np.where(height < 0, ground, wall))


def intersect_walls(
    scene: Scene, camera: Camera, pose: FloatArray, x: FloatArray | IntArray, right: bool
) -> Columns:
    """The nearest wall in each image column x (n,), in pixels."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    slant = (x - camera.cx) / camera.fx
    ray = np.stack([c + s * slant, s - c * slant], 1)  # (n, 2) per meter along the axis
    slope = np.array([s, -c]) / camera.fx  # of the ray, per pixel
    along = scene.end - scene.start
    length = np.hypot(*along.T)
    along = along / length[:, None]  # (m, 2)
    front = np.stack([along[:, 1], -along[:, 0]], 1)  # (m, 2) normals towards the viewer
    to_start = scene.start - camera_position(camera, pose, right)
    facing = ray @ front.T  # (n, m)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (to_start * front).sum(1) / facing
        position = depth * (ray @ along.T) - (to_start * along).sum(1)
    slack = 1e-9 * length  # so that no ray passes between two adjacent walls
    hit = (facing < 0) & (depth > NEAR_PLANE) & (position >= -slack) & (position <= length + slack)
    depth = np.where(hit, depth, np.inf)
    wall = depth.argmin(1)
    rows = np.arange(len(x))
    depth, position = depth[rows, wall], position[rows, wall]
    turn = (slope @ front.T)[wall] / facing[rows, wall]
    stretch = depth * np.abs((slope @ along.T)[wall] - turn * (ray * along[wall]).sum(1))
    return Columns(wall, depth, position + scene.offset[wall], stretch)


def _wall_texels(
    scene: Scene, camera: Camera, columns: Columns, y: FloatArray
) -> tuple[Float32Array, Float32Array]:
    """Column and row (rows, n) in the atlas of each sample, ignoring the ground."""
    texels = scene.wall_texels
    i = _mipmap_level(texels * columns.stretch / SAMPLES_PER_PIXEL[0], ACROSS)
    j = _mipmap_level(texels * columns.depth / camera.fy / SAMPLES_PER_PIXEL[1], DOWN)
    band = scene.band[columns.wall]
    left = np.stack([levels.left for levels in scene.wall_levels])[band, i]
    width = np.stack([levels.width for levels in scene.wall_levels])[band, i]
    top = np.stack([levels.top for levels in scene.wall_levels])[band, j]
    across = left + np.clip(columns.position * texels / 2**i - 0.5, 0, width - 1)
    first = (scene.wall_height - camera.position[2]) * texels / 2**j - 0.5
    slope = columns.depth / camera.fy * texels / 2**j
    down = np.multiply.outer((y - camera.cy).astype(np.float32), slope.astype(np.float32))
    down += first.astype(np.float32)
    np.maximum(down, np.float32(-1), out=down)
    down += top.astype(np.float32)
    return np.broadcast_to(across.astype(np.float32), down.shape).copy(), down


def _ground_texels(
    scene: Scene, camera: Camera, pose: FloatArray, x: FloatArray, y: FloatArray, right: bool
) -> tuple[Float32Array, Float32Array]:
    """Column and row (rows, n) in the atlas of each ground sample below the horizon."""
    depth = camera.fy * camera.position[2] / (y - camera.cy)
    texels, levels = scene.ground.texels, scene.ground_levels
    long = (
        depth**2 / (camera.fy * camera.position[2]) / SAMPLES_PER_PIXEL[1]
    )  # meters from sample to sample
    wide = depth / camera.fx / SAMPLES_PER_PIXEL[0]
    i = _mipmap_level(texels * np.sqrt(long * wide), GROUND)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    east, south = (camera_position(camera, pose, right) - scene.ground.corner) * (1, -1)
    slant = ((x - camera.cx) / camera.fx).astype(np.float32)
    texel = []
    for start, ahead, across, first in ((east, c, s, levels.left), (south, -s, c, levels.top)):
        scale = texels / 2**i
        middle = ((start + depth * ahead) * scale - 0.5)[:, None].astype(np.float32)
        coordinate = np.multiply.outer((depth * across * scale).astype(np.float32), slant)
        coordinate += middle
        coordinate += first[i][:, None].astype(np.float32)
        texel.append(coordinate)
    return texel[0], texel[1]


def _mipmap_level(texels: FloatArray, levels: int) -> IntArray:
    """Mipmap level for samples that cover `texels` of the finest level.

    A texel is at least 0.84 of a sample, since edges shift where samples skip texels.
    """
    return np.clip(np.ceil(np.log2(np.maximum(texels, 1)) - 0.25), 0, levels - 1).astype(np.int64)


@dataclass(frozen=True, eq=False, repr=False)
class Illumination:
    """Illumination of n frames, and the noise of the sensor."""

    gain: FloatArray
    """(n,)."""
    gamma: FloatArray
    """(n,)."""
    vignetting: FloatArray
    """(n,) fraction of the intensity lost in the corners."""
    noise: float
    """Standard deviation of each pixel, in steps of 1/255."""
    falloff: Float32Array
    """(H, W) squared distance from the image center, 1 in the corners."""
    seed: int
    """Seed of the noise."""

    @classmethod
    def sample(
        cls, config: LightConfig, camera: Camera, time: FloatArray, seed: np.random.SeedSequence
    ) -> "Illumination":
        """Illumination drawn for times (n,) in seconds."""
        drifts, flicker, noise = seed.spawn(3)
        gain, gamma, vignetting = (_drift(time, stream) for stream in drifts.spawn(3))
        independent = np.random.default_rng(flicker).standard_normal(len(time))
        across, down = (
            (np.arange(side) - (side - 1) / 2) / (camera.width / 2)
            for side in (camera.width, camera.height)
        )
        squared = across**2 + down[:, None] ** 2
        return cls(
            gain=config.brightness
            * np.exp(config.gain_sigma * gain + config.flicker_sigma * independent),
            gamma=np.exp(config.gamma_sigma * gamma),
            vignetting=np.clip(config.vignetting * (1 + vignetting / 3), 0, 1),
            noise=config.noise_sigma,
            falloff=(squared / squared.max()).astype(np.float32),
            seed=int(noise.generate_state(1, np.uint64)[0]),
        )

    def apply(self, image: npt.NDArray[np.uint8], frame: int, camera: int) -> npt.NDArray[np.uint8]:
        """The image of the sensor, from that under ideal illumination, (H, W) or (H, W, 3).

        The left camera, 0, and the right, 1, have equal illumination and independent noise.
        """
        gamma = float(self.gamma[frame])
        curve = (255 * (np.arange(256) / 255) ** gamma).astype(np.float32)
        loss = np.float32(self.vignetting[frame]) * self.falloff
        factor = np.asarray(cv2.pow(np.float32(self.gain[frame]) * (1 - loss), gamma))
        exposed: Float32Array = np.asarray(cv2.LUT(image, curve), np.float32)
        exposed *= factor if image.ndim == 2 else factor[:, :, None]
        bits = np.random.SFC64([self.seed, frame, camera])
        noise = np.random.Generator(bits).standard_normal(exposed.shape, np.float32)
        noise *= np.float32(self.noise)
        return np.asarray(cv2.add(exposed, noise, dtype=cv2.CV_8U), np.uint8)  # rounds, saturates


def _drift(time: FloatArray, seed: np.random.SeedSequence) -> FloatArray:
    """(n,) smooth random function of time with mean 0 and standard deviation 1."""
    rng = np.random.default_rng(seed)
    periods = np.geomspace(*PERIODS, WAVES) * rng.uniform(0.85, 1.15, WAVES)
    phases = rng.uniform(0, 2 * np.pi, WAVES)
    waves = np.sin(2 * np.pi * time[:, None] / periods + phases)
    return np.asarray(waves.sum(1) * np.sqrt(2 / WAVES))


ENCODER_SIGMA = float(np.radians(0.1))
"""Standard deviation of the measured pan, in radians, by default."""


class PanCamera:
    """The pan of a camera over time, from gaze commands.

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
        self._start, self._target = [-np.inf], [0.0]  # start time of each command
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
            pan += max(-turned, min(turned, self._target[k] - pan))
        return pan

    def measured(self, time: float) -> CameraTurn:
        """The pan as the encoder measures it, and the reason of the command that it follows."""
        rng = np.random.default_rng([self._seed, round(1e6 * max(time, 0.0))])
        pan = self.angle(time) + self._sigma * rng.standard_normal()
        reason = self._reason[bisect_right(self._start, time) - 1]
        return CameraTurn(pan, 0.0, self._sigma, reason)


SIDEWAYS = 0.2
"""Lateral noise of the odometry, as a fraction of the longitudinal noise."""


def simulate_drive(
    config: DriveConfig | None = None, seed: int = 0, pan: PanCamera | None = None
) -> Drive:
    """Simulate a camera drive.

    Args:
        config: scene, camera, illumination and odometry; None for the defaults.
        seed: of walls, posters, lateral oscillation, illumination, image noise and odometry noise,
            each with an independent random stream: one setting does not affect the others.
        pan: turns the camera while the drive is read, frame by frame; None for a fixed one.

    Returns:
        The drive with its ground truth, which starts at the origin. `load` renders a frame, from
        any thread and in any order; its first call builds the scene, which takes a second.
        The covariances describe the simulated noise; the bias has the magnitudes of the scale
        error and the heading drift.
    """
    config = config or DriveConfig()
    scene_seed, course_seed, light_seed, odometry_seed = np.random.SeedSequence(seed).spawn(4)
    time = np.arange(config.frames) / config.frame_rate
    pose = drive_course(config, course_seed)
    bias = (config.odometry.scale_percent / 100, np.deg2rad(config.odometry.heading_drift_deg))
    control, covariance = _odometry(config.odometry, steps_between(pose), odometry_seed)
    camera = config.camera
    illumination = Illumination.sample(config.light, camera, time, light_seed)
    build_once, lock = cache(lambda: floor_scene(config, scene_seed)), Lock()

    def scene() -> Scene:
        with lock:
            return build_once()

    def image(i: int, view: FloatArray, right: bool) -> Image:
        rendered = render(scene(), camera, view, right)
        if pan is not None:
            turned = pan.angle(time[i]) - pan.angle(time[i] - config.exposure)
            rendered = motion_blur(rendered, abs(turned) * camera.fx)
        return illumination.apply(rendered, i, int(right))

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


def tag_layout(config: DriveConfig, seed: int = 0) -> LandmarkMap:
    """True positions of the tags of a simulated drive.

    Raises:
        ConfigError: the drive has none.
    """
    scene_seed = np.random.SeedSequence(seed).spawn(4)[0]
    tags = floor_scene(config, scene_seed).tags
    if tags is None:
        raise ConfigError("tags: expected at least 1, found none on the walls")
    return tags


def _odometry(
    config: OdometryConfig, steps: FloatArray, seed: np.random.SeedSequence
) -> tuple[FloatArray, FloatArray]:
    """Measured increments (t, 3), and the covariance (t, 3, 3) of their noise."""
    rng = np.random.default_rng(seed)
    signs = rng.choice([-1.0, 1.0], 2)
    scale = signs[0] * config.scale_percent / 100
    drift = signs[1] * np.deg2rad(config.heading_drift_deg)
    measured = steps * (1 / (1 + scale), 1 / (1 + scale), 1)
    measured[:, 2] -= drift * measured[:, 0]
    distance = np.hypot(*steps[:, :2].T)
    along = config.distance_percent / 100 * distance
    turn = np.deg2rad(config.heading_sigma_deg) * np.sqrt(distance)
    sigma = np.stack([along, SIDEWAYS * along, turn], 1)
    measured += sigma * rng.standard_normal(sigma.shape)
    return measured, sigma[:, :, None] ** 2 * np.eye(3)
