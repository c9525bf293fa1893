"""Configuration of a simulated camera drive: scene, camera, illumination, odometry."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from saccade.errors import Settings, require, setting
from saccade.frames import Camera

WorldName: TypeAlias = Literal["ring", "rooms", "hall"]
"""Floor plans."""
MIN_HALL = 5.0
"""Least side of the course of a hall in meters: its blocks stand inside."""


@dataclass(frozen=True)
class LightConfig(Settings):
    """Illumination and sensor: pixel = (gain vignetting image)^gamma + noise."""

    noise_sigma: float = setting(2.0, 0, 128)
    """Standard deviation of the pixel noise, in steps of 1/255."""
    brightness: float = setting(1.0, 1e-3, 16)
    """Mean gain."""
    gain_sigma: float = setting(0.08, 0, 2)
    """Standard deviation of the logarithm of the gain, which drifts over a dozen seconds."""
    gamma_sigma: float = setting(0.04, 0, 2)
    """Standard deviation of the logarithm of gamma, which drifts as slowly."""
    vignetting: float = setting(0.15, 0, 1)
    """Fraction of the intensity lost in the corners of the image; drifts by a third of it."""
    flicker_sigma: float = setting(0.0, 0, 2)
    """Standard deviation of the logarithm of a gain that is independent in every frame."""


@dataclass(frozen=True)
class OdometryConfig(Settings):
    """Systematic and random errors of the odometry.

    Scale error and heading drift have these magnitudes in every drive; their signs are drawn.
    """

    scale_percent: float = setting(3.0, 0, 50)
    """Scale error of all distances, in percent."""
    heading_drift_deg: float = setting(1.5, 0, 50)
    """Heading drift, in degrees per meter."""
    distance_percent: float = setting(5.0, 0, 50)
    """Standard deviation of each distance, in percent of it; to the side a fifth of that."""
    heading_sigma_deg: float = setting(0.8, 0, 50)
    """Standard deviation of the heading after one meter, in degrees."""


@dataclass(frozen=True)
class DriveConfig(Settings):
    """Walls with posters, and a robot with a camera that laps among them."""

    world: WorldName = "ring"
    """A corridor around a central block, two rooms joined by a door, or a hall with smooth walls,
    groups of posters and free-standing blocks. Size, corridor, turning radius and sway do not
    concern the rooms."""
    size: tuple[float, float] = setting((11.0, 8.5), 3, 24)
    """Meters between the outer walls, along the first side of the lap and across it."""
    corridor: float = 2.2
    """Meters between the outer walls and the central block; twice the distance of the course from
    the outer walls."""
    wall_height: float = setting(2.4, 1, 4)
    """Height of all walls in meters."""
    poster_spacing: float = setting(1.6, 0.5, 100)
    """Smallest distance of posters along a wall, in meters."""
    poster_groups: int = setting(3, 1, 12)
    """Number of groups of three posters on the outer walls of a hall; one is in view at the
    start."""
    blocks: int = setting(1, 0, 2)
    """Number of blocks inside the course of a hall, with a poster on each side."""
    posters: int | None = setting(None, 1, 1000)
    """Number of distinct images on the posters; None for all available ones."""
    mirrored_posters: bool = False
    """Whether each poster is symmetric about its vertical axis."""
    tags: int = setting(0, 0, 500)
    """Number of tags (tag36h11) on the outer walls, as far as there is room."""
    tag_size: float = setting(0.4, 0.05, 0.8)
    """Side of the black square of a tag, in meters."""
    turning_radius: float = 1.8
    """Radius of the four turns of the course, in meters."""
    sway: float = 0.08
    """Lateral oscillation to the left of the center line, in meters; its phase differs between
    laps."""
    frames: int = setting(600, 2, 10**6)
    """Number of frames."""
    frames_per_lap: int = setting(300, 2, 10**6)
    """Number of frames per lap; sets the speed."""
    frame_rate: float = setting(10.0, 1e-3, 1e4)
    """Frames per second."""
    image_size: tuple[int, int] = setting((320, 240), 16, 4096)
    """Width and height in pixels."""
    exposure: float = setting(0.01, 0, 1)
    """Exposure time in seconds, in which a camera that pans blurs the image."""
    field_of_view_deg: float = setting(70.0, 20, 120)
    """Horizontal field of view in degrees."""
    baseline: float | None = 0.15
    """Meters to the right camera; None for a single camera."""
    camera_height: float = 0.7
    """Meters above the ground."""
    color: bool = False
    """Whether the images are RGB; gray otherwise."""
    depth: bool = False
    """Whether the frames include their true depth."""
    light: LightConfig = LightConfig()
    """Illumination and sensor."""
    odometry: OdometryConfig = OdometryConfig()
    """Errors of the odometry."""

    def __post_init__(self) -> None:
        super().__post_init__()
        longest = 40 if self.world == "hall" else 24
        size = f"two of 3 to 24 m, {longest} m together"
        require(sum(self.size) <= longest, "size", size, self.size)
        corridor, max_radius = self.corridor, round(min(self.size) / 2 - 0.2, 3)
        inside = min(self.size) - corridor
        is_wide = self.world != "hall" or inside >= MIN_HALL
        require(is_wide, "corridor", f"{MIN_HALL} m less than the size of a hall", corridor)
        clearance = 0.2 * corridor + self.sway  # between the course and the corners of the block
        turning = min((np.sqrt(0.5) * corridor - clearance) / (np.sqrt(2) - 1), max_radius)
        if self.world == "hall":
            turning = inside / 2
        limits = {
            "corridor": (1, max_radius),
            "sway": (0, round(0.2 * corridor, 3)),
            "turning_radius": (0.5, round(float(turning), 3)),
            "camera_height": (0.05, round(self.wall_height - 1e-3, 3)),
            "baseline": (1e-3, round(0.25 * corridor, 3)),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            require(value is None or low <= value <= high, name, f"{low} to {high}", value)

    @property
    def camera(self) -> Camera:
        """The level camera, above the origin of the robot and looking ahead."""
        width, height = self.image_size
        focal = width / 2 / float(np.tan(np.deg2rad(self.field_of_view_deg / 2)))
        return Camera(
            width,
            height,
            focal,
            focal,
            (width - 1) / 2,
            (height - 1) / 2,
            self.baseline or 0.0,
            np.array([0.0, 0.0, self.camera_height]),
        )

    @classmethod
    def ring(cls) -> "DriveConfig":
        """Two laps of the ring with a stereo camera: the default."""
        return cls()

    @classmethod
    def mono(cls) -> "DriveConfig":
        """The ring with a single camera."""
        return cls(baseline=None)

    @classmethod
    def repeated(cls) -> "DriveConfig":
        """The ring with four images repeated on all posters."""
        return cls(posters=4)

    @classmethod
    def mirror(cls) -> "DriveConfig":
        """The ring with posters that are symmetric about their vertical axis."""
        return cls(mirrored_posters=True)

    @classmethod
    def rooms(cls) -> "DriveConfig":
        """Once around two rooms joined by a door, with a narrow view."""
        return cls(world="rooms", frames=300, field_of_view_deg=50.0)

    @classmethod
    def hall(cls) -> "DriveConfig":
        """Two laps of a hall with few posters, with a narrow view."""
        return cls(
            world="hall",
            size=(16.0, 12.0),
            corridor=5.0,
            poster_spacing=1.2,
            frames=200,
            frames_per_lap=100,
            frame_rate=5.0,
            image_size=(240, 180),
            field_of_view_deg=50.0,
        )

    @classmethod
    def dark(cls) -> "DriveConfig":
        """The ring at dusk: a third of the intensity, and more noise."""
        return cls(light=LightConfig(noise_sigma=5.0, brightness=0.35, vignetting=0.4))

    @classmethod
    def flicker(cls) -> "DriveConfig":
        """The ring with flickering lamps and automatic exposure."""
        return cls(light=LightConfig(gain_sigma=0.3, gamma_sigma=0.15, flicker_sigma=0.15))
