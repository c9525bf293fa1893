"""Base class for the results of the attention models."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.pictured import Pictured
from saccade.scale.pyramid import FloatMap, resize
from saccade.types import Float32Array


@dataclass(frozen=True, eq=False, repr=False)
class SaliencyMaps(Pictured):
    """Saliency of an image, from a model of this package or any other source.

    The cells of a map tile the image: see `saccade.scale.pyramid.cell_centers`.
    """

    saliency: npt.NDArray[Any]
    """(h, w), finite and nonnegative."""
    image_shape: tuple[int, int]
    """(H, W) of the image; additional dimensions are dropped."""
    without_center_bias: npt.NDArray[Any] = field(default_factory=lambda: np.zeros(0), kw_only=True)
    """(h, w) saliency without position priors; by default equal to `saliency`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "image_shape", tuple(self.image_shape[:2]))
        if self.without_center_bias.size == 0:
            object.__setattr__(self, "without_center_bias", self.saliency)

    @property
    def layers(self) -> dict[str, FloatMap]:
        """The maps by name, the saliency first."""
        return {"saliency": self.saliency}

    @property
    def upsampled(self) -> dict[str, Float32Array]:
        """Maps by name, enlarged bilinearly to the size of the image, (H, W) each."""
        return {name: resize(layer, self.image_shape) for name, layer in self.layers.items()}

    def __repr__(self) -> str:
        (h, w), (height, width) = self.saliency.shape[-2:], self.image_shape
        return f"{type(self).__name__}({w} x {h} cells of a {width} x {height} image)"
