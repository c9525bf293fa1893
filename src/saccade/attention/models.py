"""The saliency models by name, and their common interface."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.attention.boolean_maps import BooleanConfig, boolean_saliency
from saccade.attention.combined import AttentionConfig, attention_saliency
from saccade.attention.contrast import contrast_saliency
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.fitted import FittedModel
from saccade.attention.maps import SaliencyMaps
from saccade.attention.symmetry import SymmetryConfig, symmetric_pairs_at, symmetry_saliency
from saccade.errors import ConfigError, ImageError, Settings
from saccade.types import Float32Array, SymmetricPairs


class SaliencyModel(NamedTuple):
    """A saliency model in the table."""

    function: Callable[[npt.NDArray[Any], Any], SaliencyMaps]
    """Maps of an image, (H, W) or (H, W, 3) RGB, with settings."""
    settings: type[Settings]
    """Class of its settings, whose class methods are the presets."""


MODELS = {
    "attention": SaliencyModel(attention_saliency, AttentionConfig),
    "contrast": SaliencyModel(contrast_saliency, ContrastConfig),
    "symmetry": SaliencyModel(symmetry_saliency, SymmetryConfig),
    "boolean": SaliencyModel(boolean_saliency, BooleanConfig),
}
"""The models by name, which is also the name of their settings."""
Saliency: TypeAlias = Callable[[npt.NDArray[Any]], Any]
"""A user's model: function from an image (H, W, 3) to a map (h, w) of the whole image."""
REFERENCE_SIZE = 800
"""Longer side in pixels of the image for which `PAIR_RADIUS` is given."""
PAIR_RADIUS = 12.0
"""Search radius in pixels for symmetric pairs around a fixation."""
MAX_SALIENCY = 1e15
"""Maximum magnitude in a map, for which sums of squares stay finite in float32."""


@dataclass(frozen=True)
class AttentionModel:
    """A saliency model with its settings."""

    settings: Settings | Saliency
    """Settings of a model in `MODELS`, a `FittedModel`, or a user's function."""

    def maps(self, image: npt.NDArray[Any]) -> SaliencyMaps:
        """The maps of an image.

        Raises:
            ImageError: as the model; or a function returns no map.
            ConfigError: settings of no model; or a function fails.
        """
        if isinstance(self.settings, FittedModel):
            return self.settings.maps(image)
        for row in MODELS.values():
            if type(self.settings) is row.settings:
                return row.function(image, self.settings)
        if callable(self.settings):
            return maps_of(self.settings, image)
        names = ", ".join(row.settings.__name__ for row in MODELS.values())
        found = type(self.settings).__name__
        raise ConfigError(f"model: expected {names}, FittedModel or a function, found {found}")

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


def maps_of(function: Saliency, image: npt.NDArray[Any]) -> SaliencyMaps:
    """The map of a user's function, with its minimum at 0."""
    name = getattr(function, "__name__", type(function).__name__)
    try:
        values = function(image)
    except Exception as error:  # raised by the user's own function
        raise ConfigError(f"model: {name}: failed: {error}") from error
    if isinstance(values, SaliencyMaps):
        return values
    saliency = checked_map(values, name)
    return SaliencyMaps(saliency - min(saliency.min(), np.float32(0)), image.shape[:2])


def checked_map(values: Any, name: str) -> Float32Array:
    """Validates a map from a file or from a user's model.

    Raises:
        ImageError: not finite numbers of shape (h, w); the message names the map.
    """
    expected = f"{name}: expected finite numbers of shape (h, w)"
    try:
        array = np.asarray(values)
    except (TypeError, ValueError) as error:
        raise ImageError(f"{expected}: {error}") from error
    if array.ndim != 2 or array.size == 0 or array.dtype.kind not in "buif":
        raise ImageError(f"{expected}, found {array.dtype} of shape {array.shape}")
    if not (np.abs(array.astype(np.float64)) < MAX_SALIENCY).all():
        raise ImageError(f"{expected} under {MAX_SALIENCY:g}, found NaN or others")
    return array.astype(np.float32)
