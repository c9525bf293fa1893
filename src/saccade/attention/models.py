"""The saliency models by name, and their common interface."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from saccade.attention.combined import CHANNELS, AttentionConfig, Channel, attention_saliency
from saccade.attention.fitted import FittedModel
from saccade.attention.maps import SaliencyMaps
from saccade.attention.symmetry import SymmetryConfig, symmetric_pairs_at
from saccade.attention.values import as_saliency
from saccade.errors import ConfigError, Settings
from saccade.io.image import check_image, in_unit_range, repeat_gray
from saccade.types import Float32Array, SymmetricPairs


class SaliencyModel(NamedTuple):
    """A saliency model in the table."""

    function: Callable[[npt.NDArray[Any], Any], SaliencyMaps]
    """Maps of an image, (H, W) or (H, W, 3) RGB, with settings."""
    settings: type[Settings]
    """Class of its settings, whose class methods are the presets."""


def _of_channel(row: Channel) -> SaliencyModel:
    """The model of a channel alone."""

    def maps(image: npt.NDArray[Any], settings: Any) -> SaliencyMaps:
        return row.maps(check_image(image), settings, False)

    return SaliencyModel(maps, row.settings)


MODELS = {
    "attention": SaliencyModel(attention_saliency, AttentionConfig),
    **{name: _of_channel(row) for name, row in CHANNELS.items()},
}
"""The models by name, which is also the name of their settings."""
Saliency: TypeAlias = Callable[[npt.NDArray[Any]], Any]
"""A user's model: function from an image (H, W, 3) to a map (h, w) of the whole image."""
REFERENCE_SIZE = 800
"""Longer side in pixels of the image for which `PAIR_RADIUS` is given."""
PAIR_RADIUS = 12.0
"""Search radius in pixels for symmetric pairs around a fixation."""


@dataclass(frozen=True)
class AttentionModel:
    """A saliency model with its settings."""

    settings: Settings | Saliency
    """Settings of a model in `MODELS`, a `FittedModel`, or a user's function."""
    kind: str | None = None
    """Kind of a function's values, one of `values.KINDS`; None for that which it declares."""

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
        if callable(self.settings) or hasattr(self.settings, "log_density"):
            return maps_of(cast("Saliency", self.settings), image, self.kind)
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


def maps_of(function: Saliency, image: npt.NDArray[Any], kind: str | None = None) -> SaliencyMaps:
    """The map of a user's function, or of a model of pysaliency, with its minimum at 0.

    A model of pysaliency has a method `log_density` or `saliency_map`, which gets (H, W, 3) uint8.
    A function may declare its values by an attribute `kind`, one of `values.KINDS`.
    """
    name = getattr(function, "__name__", type(function).__name__)
    kind, predict = kind or getattr(function, "kind", None), function
    for method, of_method in (("log_density", "log-density"), ("saliency_map", "saliency")):
        if hasattr(function, method):
            levels = np.rint(255 * repeat_gray(in_unit_range(image))).astype(np.uint8)
            predict, kind, image = getattr(function, method), of_method, levels
            break
    try:
        values = predict(image)
    except Exception as error:  # raised by the user's own function
        raise ConfigError(f"model: {name}: failed: {error}") from error
    if isinstance(values, SaliencyMaps):
        return values
    saliency = as_saliency(values, name, image.shape[:2], kind)
    return SaliencyMaps(saliency - min(saliency.min(), np.float32(0)), image.shape[:2])
