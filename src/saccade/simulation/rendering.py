"""Renders the images of a level camera by ray casting, and its illumination and noise.

Walls are vertical and the camera is level: each image column intersects one wall, at one depth.
The remaining texture lookup per sample is one call of OpenCV's remap.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from saccade.frames import Camera
from saccade.simulation.drive_config import LightConfig
from saccade.simulation.scene import ACROSS, DOWN, GROUND, Scene
from saccade.types import Float32Array, FloatArray, IntArray

SAMPLES = (3, 2)
"""Samples per pixel, across and down, which are averaged."""
NEAREST = 0.02
"""Near clipping plane, metres along the optical axis."""
WAVES, PERIODS = 4, (8.0, 40.0)
"""Number of sine waves in a drift, and seconds of the shortest and the longest."""


class Columns(NamedTuple):
    """Intersections of n image columns with the walls."""

    wall: IntArray
    """(n,) index of the wall."""
    depth: FloatArray
    """(n,) metres along the optical axis."""
    position: FloatArray
    """(n,) metres along its band."""
    stretch: FloatArray
    """(n,) metres of wall per pixel across."""


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
        for side, samples in zip(size, SAMPLES, strict=True)
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


def render_depth(scene: Scene, camera: Camera, pose: FloatArray) -> FloatArray:
    """(H, W) metres along the optical axis at pixel centers; NaN for the sky."""
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
    ray = np.stack([c + s * slant, s - c * slant], 1)  # (n, 2) per metre along the axis
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
    hit = (facing < 0) & (depth > NEAREST) & (position >= -slack) & (position <= length + slack)
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
    i = _mipmap_level(texels * columns.stretch / SAMPLES[0], ACROSS)
    j = _mipmap_level(texels * columns.depth / camera.fy / SAMPLES[1], DOWN)
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
    long = depth**2 / (camera.fy * camera.position[2]) / SAMPLES[1]  # metres from sample to sample
    wide = depth / camera.fx / SAMPLES[0]
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
