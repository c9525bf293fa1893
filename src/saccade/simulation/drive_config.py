"""What a simulated camera drive is like: the place, the camera, the light, the odometry."""

from dataclasses import dataclass, replace

import numpy as np

from saccade.errors import require
from saccade.frames import Camera


@dataclass(frozen=True)
class LightConfig:
    """What light and sensor do to a picture: pixel = (gain vignette picture)^gamma + noise."""

    noise: float = 2.0
    """Standard deviation of each pixel, in steps of 1/255."""
    brightness: float = 1.0
    """Gain about which the light drifts."""
    gain: float = 0.08
    """Standard deviation of the logarithm of the gain, which drifts over a dozen seconds."""
    gamma: float = 0.04
    """Standard deviation of the logarithm of gamma, which drifts as well."""
    vignetting: float = 0.15
    """Share of the light that is missing in the corners of the image; drifts by a third of it."""
    flicker: float = 0.0
    """Standard deviation of the logarithm of a gain that is new with every frame."""

    def __post_init__(self) -> None:
        require(0 <= self.noise <= 128, "noise", "0 to 128", self.noise)
        require(0 < self.brightness <= 16, "brightness", "over 0, up to 16", self.brightness)
        require(0 <= self.vignetting <= 1, "vignetting", "0 to 1", self.vignetting)
        for name in ("gain", "gamma", "flicker"):
            require(0 <= getattr(self, name) <= 2, name, "0 to 2", getattr(self, name))


@dataclass(frozen=True)
class OdometryConfig:
    """What the odometry gets wrong: the same thing all the way, and something new in every step.

    Scale and drift have these sizes in every drive; their signs are drawn.
    """

    scale: float = 3.0
    """Per cent by which every distance is off."""
    drift: float = 1.5
    """Degrees per metre that are turned unnoticed."""
    white: float = 5.0
    """Standard deviation of each distance, in per cent of it; to the side a fifth of that."""
    turn: float = 0.8
    """Standard deviation of the heading after a metre, in degrees, new in every step."""

    def __post_init__(self) -> None:
        for name in ("scale", "drift", "white", "turn"):
            require(0 <= getattr(self, name) <= 50, name, "0 to 50", getattr(self, name))


@dataclass(frozen=True)
class DriveConfig:
    """A walled ring with posters, and a robot that drives round it with a camera."""

    size: tuple[float, float] = (11.0, 8.5)
    """Metres between the outer walls, along the first side of the ring and across it."""
    corridor: float = 2.2
    """Metres between the outer walls and the block in the middle."""
    wall_height: float = 2.4
    """Metres."""
    spacing: float = 1.6
    """Metres from poster to poster along a wall, at least."""
    posters: int = 0
    """How many different pictures there are on the posters; 0 for as many as there are."""
    mirrored: bool = False
    """Whether each poster is symmetric about its vertical axis."""
    turning_radius: float = 1.8
    """Metres, of the course's four corners."""
    sway: float = 0.08
    """Metres to the left of the middle of the corridor that the robot goes now and then; on the
    second lap elsewhere than on the first."""
    frames: int = 600
    """How many there are."""
    frames_per_lap: int = 300
    """How many of them make one lap."""
    frame_rate: float = 10.0
    """Frames per second."""
    image_size: tuple[int, int] = (320, 240)
    """Width and height in pixels."""
    field_of_view: float = 70.0
    """Degrees of the camera's field of view, across."""
    baseline: float = 0.15
    """Metres to the right camera; 0 for a single camera."""
    camera_height: float = 0.7
    """Metres above the ground."""
    color: bool = False
    """Whether the images are RGB; grey otherwise."""
    depth: bool = False
    """Whether the frames come with their true depth."""
    light: LightConfig = LightConfig()
    """Light and sensor."""
    odometry: OdometryConfig = OdometryConfig()
    """Errors of the odometry."""

    def __post_init__(self) -> None:
        sides = len(self.size) == 2 and all(3 <= side <= 20 for side in self.size)
        require(
            sides and sum(self.size) <= 24, "size", "two of 3 to 20 m, 24 m together", self.size
        )
        corridor, most = self.corridor, min(self.size) / 2 - 0.2
        require(1 <= corridor <= most, "corridor", f"1 to {most:g} m", corridor)
        height = self.wall_height
        require(1 <= height <= 4, "wall_height", "1 to 4 m", height)
        eye = self.camera_height
        require(0.05 <= eye < height, "camera_height", f"0.05 to under {height:g} m", eye)
        require(0.5 <= self.spacing <= 100, "spacing", "0.5 to 100 m", self.spacing)
        require(0 <= self.posters <= 1000, "posters", "0 to 1000", self.posters)
        require(0 <= self.sway <= 0.2 * corridor, "sway", "0 to a fifth of corridor", self.sway)
        aside = 0.2 * corridor + self.sway  # room between the course and the block's corners
        most = min((np.sqrt(0.5) * corridor - aside) / (np.sqrt(2) - 1), most)
        radius = self.turning_radius
        require(0.5 <= radius <= most, "turning_radius", f"0.5 to {most:.2f} m", radius)
        for name in ("frames", "frames_per_lap"):
            require(2 <= getattr(self, name) <= 10**6, name, "2 to 1e6", getattr(self, name))
        require(0 < self.frame_rate <= 1e4, "frame_rate", "over 0, up to 1e4", self.frame_rate)
        pixels = len(self.image_size) == 2 and all(16 <= side <= 4096 for side in self.image_size)
        require(pixels, "image_size", "two of 16 to 4096 px", self.image_size)
        require(
            20 <= self.field_of_view <= 120,
            "field_of_view",
            "20 to 120 degrees",
            self.field_of_view,
        )
        most = 0.25 * corridor
        require(0 <= self.baseline <= most, "baseline", f"0 to {most:g} m", self.baseline)

    @property
    def camera(self) -> Camera:
        """Level, above the middle of the robot, and looking ahead."""
        width, height = self.image_size
        focal = width / 2 / float(np.tan(np.deg2rad(self.field_of_view / 2)))
        return Camera(
            width,
            height,
            focal,
            focal,
            (width - 1) / 2,
            (height - 1) / 2,
            self.baseline,
            np.array([0.0, 0.0, self.camera_height]),
        )

    @classmethod
    def ring(cls) -> "DriveConfig":
        """Two laps of the ring with a stereo camera: the default."""
        return cls()

    @classmethod
    def mono(cls) -> "DriveConfig":
        """The ring with a single camera."""
        return cls(baseline=0.0)

    @classmethod
    def repeated(cls) -> "DriveConfig":
        """The ring with four pictures that hang again and again."""
        return cls(posters=4)

    @classmethod
    def mirror(cls) -> "DriveConfig":
        """The ring with posters that are symmetric about their vertical axis."""
        return cls(mirrored=True)

    @classmethod
    def dark(cls) -> "DriveConfig":
        """The ring at dusk: a third of the light, and more noise."""
        return replace(cls(), light=LightConfig(noise=5.0, brightness=0.35, vignetting=0.4))

    @classmethod
    def flicker(cls) -> "DriveConfig":
        """The ring under lamps that flicker and a camera that keeps adjusting itself."""
        return replace(cls(), light=LightConfig(gain=0.3, gamma=0.15, flicker=0.15))
