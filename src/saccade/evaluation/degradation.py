"""What a camera or the light may do to an image: noise, less contrast, blur."""

from dataclasses import dataclass

import cv2
import numpy as np

from saccade.errors import ConfigError, require
from saccade.types import Float32Array

KINDS = {"noise": (0.0, 255.0), "contrast": (0.0, 1.0), "blur": (0.0, 100.0)}
"""And the amounts that make sense, above the first."""
MIDDLE = 0.5
"""Grey to which contrast is scaled: nothing is cut off."""
LEVELS = 255


@dataclass(frozen=True)
class Degradation:
    """One kind of disturbance and how much of it."""

    kind: str
    """"noise" is added, normal and the same in every channel; "contrast" is scaled about
    middle grey; "blur" is Gaussian."""
    amount: float
    """Standard deviation of noise in grey levels of 255; factor of contrast; standard deviation
    of blur in pixels."""

    def __post_init__(self) -> None:
        require(self.kind in KINDS, "disturbance", f"one of {', '.join(KINDS)}", self.kind)
        least, most = KINDS[self.kind]
        name = f"disturbance: {self.kind}"
        require(
            least < self.amount <= most, name, f"above {least:g}, at most {most:g}", self.amount
        )

    @classmethod
    def parse(cls, text: str) -> "Degradation":
        """The one that is written as `noise:20`.

        Raises:
            ConfigError: it is written otherwise, or the amount makes no sense.
        """
        kind, _, amount = text.partition(":")
        try:
            return cls(kind, float(amount))
        except ValueError as error:
            if isinstance(error, ConfigError):
                raise
            expected = "such as noise:20, contrast:0.5 or blur:2"
            raise ConfigError(f"disturbance: expected {expected}, found {text!r}") from error

    def __str__(self) -> str:
        return f"{self.kind}:{self.amount:g}"

    def apply(self, image: Float32Array, seed: int) -> Float32Array:
        """The image as an 8-bit camera would give it under the disturbance.

        Args:
            image: (H, W) or (H, W, 3) in [0, 1].
            seed: of the noise.
        """
        changed = image
        if self.kind == "noise":
            shape = (*image.shape[:2], *(1 for _ in image.shape[2:]))
            noise = np.random.default_rng(seed).standard_normal(shape, np.float32)
            changed = image + noise * np.float32(self.amount / LEVELS)
        elif self.kind == "contrast":
            changed = MIDDLE + (image - MIDDLE) * np.float32(self.amount)
        else:
            changed = np.asarray(cv2.GaussianBlur(image, (0, 0), self.amount), np.float32)
        return np.asarray(np.rint(changed.clip(0, 1) * LEVELS) / LEVELS, np.float32)
