"""What light and sensor do to a picture, frame by frame."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from saccade.frames import Camera
from saccade.simulation.drive_config import LightConfig
from saccade.types import Float32Array, FloatArray

WAVES = 4
"""Of different lengths that make up a drift."""
PERIODS = (8.0, 40.0)
"""Seconds, of the shortest and the longest of them."""


@dataclass(frozen=True, eq=False, repr=False)
class Illumination:
    """The light of a drive, drawn once and for all; frame i is the same whenever it is taken."""

    gain: FloatArray
    """(n,)."""
    gamma: FloatArray
    """(n,)."""
    vignetting: FloatArray
    """(n,) share of the light that is missing in the corners."""
    noise: float
    """Standard deviation of each pixel, in steps of 1/255."""
    falloff: Float32Array
    """(H, W) 0 in the middle of the image, 1 in its corners."""
    seed: int
    """Of the noise."""

    @classmethod
    def drawn(
        cls, config: LightConfig, camera: Camera, time: FloatArray, seed: np.random.SeedSequence
    ) -> "Illumination":
        """The light at times (n,) in seconds."""
        drifts, flicker, noise = seed.spawn(3)
        gain, gamma, vignetting = (_drift(time, each) for each in drifts.spawn(3))
        flickering = np.random.default_rng(flicker).standard_normal(len(time))
        across = (np.arange(camera.width) - (camera.width - 1) / 2) / (camera.width / 2)
        down = (np.arange(camera.height) - (camera.height - 1) / 2) / (camera.width / 2)
        squared = across**2 + down[:, None] ** 2
        return cls(
            gain=config.brightness * np.exp(config.gain * gain + config.flicker * flickering),
            gamma=np.exp(config.gamma * gamma),
            vignetting=np.clip(config.vignetting * (1 + vignetting / 3), 0, 1),
            noise=config.noise,
            falloff=(squared / squared.max()).astype(np.float32),
            seed=int(noise.generate_state(1, np.uint64)[0]),
        )

    def apply(
        self, picture: npt.NDArray[np.uint8], frame: int, camera: int
    ) -> npt.NDArray[np.uint8]:
        """What the sensor makes of a picture.

        Args:
            picture: (H, W) or (H, W, 3).
            frame: its number.
            camera: 0 is the left one, 1 the right: the same light, but noise of its own.
        """
        gamma = float(self.gamma[frame])
        curve = (255 * (np.arange(256) / 255) ** gamma).astype(np.float32)
        missing = np.float32(self.vignetting[frame]) * self.falloff
        factor = np.asarray(cv2.pow(np.float32(self.gain[frame]) * (1 - missing), gamma))
        seen: Float32Array = np.asarray(cv2.LUT(picture, curve), np.float32)
        seen *= factor if picture.ndim == 2 else factor[:, :, None]
        bits = np.random.SFC64([self.seed, frame, camera])
        noise = np.random.Generator(bits).standard_normal(seen.shape, np.float32)
        noise *= np.float32(self.noise)
        return np.asarray(cv2.add(seen, noise, dtype=cv2.CV_8U), np.uint8)  # rounds, saturates


def _drift(time: FloatArray, seed: np.random.SeedSequence) -> FloatArray:
    """(n,) a smooth function of time with mean 0 and standard deviation 1 over a long time."""
    rng = np.random.default_rng(seed)
    periods = np.geomspace(*PERIODS, WAVES) * rng.uniform(0.85, 1.15, WAVES)
    phases = rng.uniform(0, 2 * np.pi, WAVES)
    waves = np.sin(2 * np.pi * time[:, None] / periods + phases)
    return np.asarray(waves.sum(1) * np.sqrt(2 / WAVES))
