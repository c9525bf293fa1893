"""Illumination and sensor model: gain, vignetting, gamma and noise of each frame."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from saccade.frames import Camera
from saccade.simulation.drive_config import LightConfig
from saccade.types import Float32Array, FloatArray

WAVES = 4
"""Number of sine waves in a drift."""
PERIODS = (8.0, 40.0)
"""Seconds, of the shortest and the longest wave."""


@dataclass(frozen=True, eq=False, repr=False)
class Illumination:
    """Illumination of n frames; rendering frame i is deterministic."""

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
    """Of the noise."""

    @classmethod
    def sample(
        cls, config: LightConfig, camera: Camera, time: FloatArray, seed: np.random.SeedSequence
    ) -> "Illumination":
        """Illumination drawn for times (n,) in seconds."""
        drifts, flicker, noise = seed.spawn(3)
        gain, gamma, vignetting = (_drift(time, stream) for stream in drifts.spawn(3))
        independent = np.random.default_rng(flicker).standard_normal(len(time))
        across = (np.arange(camera.width) - (camera.width - 1) / 2) / (camera.width / 2)
        down = (np.arange(camera.height) - (camera.height - 1) / 2) / (camera.width / 2)
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
        """The image of the sensor.

        Args:
            image: (H, W) or (H, W, 3) under ideal illumination.
            frame: number of the frame.
            camera: 0 left, 1 right: equal illumination, independent noise.
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
