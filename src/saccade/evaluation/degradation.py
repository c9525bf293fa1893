"""Image degradation: noise, loss of contrast, blur."""

from dataclasses import dataclass

import cv2
import numpy as np

from saccade.errors import ConfigError, require
from saccade.types import Float32Array

KINDS = {"noise": (0.0, 255.0), "contrast": (0.0, 1.0), "blur": (0.0, 100.0)}
"""Degradations with the open lower and closed upper limit of their amounts."""
MIDDLE_GRAY = 0.5
"""Fixed point of the scaling of contrast, at which nothing saturates."""
MAX_LEVEL = 255


@dataclass(frozen=True)
class Degradation:
    """One kind of image degradation and its amount."""

    kind: str
    """"noise": additive, normal, the same in every channel; "contrast": scaled about middle
    gray; "blur": Gaussian."""
    amount: float
    """Standard deviation of the noise in gray levels of 255; factor of the contrast; standard
    deviation of the blur in pixels."""

    def __post_init__(self) -> None:
        require(self.kind in KINDS, "degradation", f"one of {', '.join(KINDS)}", self.kind)
        low, high = KINDS[self.kind]
        name = f"degradation: {self.kind}"
        require(low < self.amount <= high, name, f"above {low:g}, at most {high:g}", self.amount)

    @classmethod
    def parse(cls, text: str) -> "Degradation":
        """Parses KIND:AMOUNT, such as `noise:20`.

        Raises:
            ConfigError: the text has another form, or the amount is out of range.
        """
        kind, _, amount = text.partition(":")
        try:
            return cls(kind, float(amount))
        except ValueError as error:
            if isinstance(error, ConfigError):
                raise
            expected = "such as noise:20, contrast:0.5 or blur:2"
            raise ConfigError(f"degradation: expected {expected}, found {text!r}") from error

    def __str__(self) -> str:
        return f"{self.kind}:{self.amount:g}"

    def apply(self, image: Float32Array, seed: int) -> Float32Array:
        """Degrades an image and quantizes it to 8 bits.

        Args:
            image: (H, W) or (H, W, 3) in [0, 1].
            seed: seed of the noise.
        """
        changed = image
        if self.kind == "noise":
            shape = (*image.shape[:2], *(1 for _ in image.shape[2:]))
            noise = np.random.default_rng(seed).standard_normal(shape, np.float32)
            changed = image + noise * np.float32(self.amount / MAX_LEVEL)
        elif self.kind == "contrast":
            changed = MIDDLE_GRAY + (image - MIDDLE_GRAY) * np.float32(self.amount)
        else:
            changed = np.asarray(cv2.GaussianBlur(image, (0, 0), self.amount), np.float32)
        return np.asarray(np.rint(changed.clip(0, 1) * MAX_LEVEL) / MAX_LEVEL, np.float32)
