"""The attention models by name, and their common interface."""

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from saccade.attention.boolean_maps import BooleanConfig, boolean_saliency
from saccade.attention.combined import AttentionConfig, FaceDetector, attention_saliency
from saccade.attention.contrast import contrast_saliency
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.fitted import FittedModel
from saccade.attention.symmetry import SymmetryConfig, symmetric_pairs_at, symmetry_saliency
from saccade.types import Float32Array, SymmetricPairs

MODEL_NAMES = ("attention", "contrast", "symmetry", "boolean")
"""Names of the models, which are also the names of their settings."""
REFERENCE_SIZE = 800
"""Longer side in pixels of the image for which `PAIR_RADIUS` is given."""
PAIR_RADIUS = 12.0
"""Search radius in pixels for symmetric pairs around a fixation."""


@dataclass(frozen=True)
class AttentionModel:
    """An attention model with its settings."""

    settings: AttentionConfig | ContrastConfig | SymmetryConfig | BooleanConfig | FittedModel
    """Settings; their type selects the model."""
    faces: FaceDetector | None = None
    """Face detector for the attention model and fitted models; None for no faces."""

    def maps(self, image: npt.NDArray[Any]) -> Any:
        """Returns the model's result for an image, a subclass of `SaliencyMaps`."""
        match self.settings:
            case ContrastConfig():
                return contrast_saliency(image, self.settings)
            case SymmetryConfig():
                return symmetry_saliency(image, self.settings)
            case BooleanConfig():
                return boolean_saliency(image, self.settings)
            case AttentionConfig():
                return attention_saliency(image, self.settings, faces=self.faces)
            case FittedModel():
                return self.settings.maps(image, self.faces)

    def pairs(self, image: Float32Array, xy: npt.NDArray[Any]) -> list[SymmetricPairs]:
        """Strongest symmetric pairs at each of (n, 2) positions; none without symmetry."""
        settings = self.settings
        if isinstance(settings, FittedModel):
            settings = settings.attention
        if isinstance(settings, AttentionConfig):
            settings = settings.symmetry
        if not isinstance(settings, SymmetryConfig):
            return []
        radius = PAIR_RADIUS * max(image.shape) / REFERENCE_SIZE
        positions = [(x, y) for x, y in xy]
        return symmetric_pairs_at(image, positions, settings, radius=radius, max_pairs=2)
