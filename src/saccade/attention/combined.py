"""Attention: the weighted sum of contrast and symmetry saliency.

The saliency of each model is normalized by N as the conspicuity maps are in A.14, so that a model
with a single outstanding maximum decides over one with many equal maxima.
"""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from saccade.attention.contrast import ContrastConfig, ContrastMaps, contrast_saliency
from saccade.attention.contrast_config import MAX_WEIGHT
from saccade.attention.models import SaliencyMaps
from saccade.attention.normalize import Normalization, normalize, rescale
from saccade.attention.symmetry import SymmetryConfig, SymmetryMaps, symmetry_saliency
from saccade.errors import require, require_types
from saccade.pyramid import FloatMap, resize
from saccade.types import Image


@dataclass(frozen=True)
class AttentionConfig:
    """Weights of contrast and symmetry, and the settings of each.

    The default predicts human fixations best; docs/symmetry.md says how it was chosen.
    """

    contrast_weight: float = 0.1
    """Weight of contrast in the saliency."""
    symmetry_weight: float = 1.0
    """The same for symmetry."""
    normalization: Normalization = "local-maxima"
    """Normalization of both maps; see `saccade.attention.normalize`."""
    contrast: ContrastConfig = field(default_factory=ContrastConfig)
    """Settings of the contrast model."""
    symmetry: SymmetryConfig = field(default_factory=SymmetryConfig)
    """Settings of the symmetry model."""

    def __post_init__(self) -> None:
        for name in ("contrast_weight", "symmetry_weight"):
            weight = getattr(self, name)
            require(0 < weight <= MAX_WEIGHT, name, f"above 0, at most {MAX_WEIGHT:g}", weight)
        require_types(self)

    @classmethod
    def kootstra2010(cls) -> Self:
        """The source's contrast and symmetry, of equal weight."""
        return cls(
            contrast_weight=1.0,
            contrast=ContrastConfig.kootstra2010(),
            symmetry=SymmetryConfig.kootstra2010(),
        )


@dataclass(frozen=True, eq=False, repr=False)
class AttentionMaps(SaliencyMaps):
    """Saliency and the maps of the two models.

    The cells tile the image: see `saccade.pyramid.cell_centers`.
    """

    saliency: FloatMap
    """(h, w) in [0, 1], of the size of the contrast map."""
    contrast: ContrastMaps
    """Contrast saliency and its conspicuity maps."""
    symmetry: SymmetryMaps
    """Symmetry saliency and its levels."""
    image_shape: tuple[int, int]
    """(H, W) of the image."""

    @property
    def layers(self) -> dict[str, FloatMap]:
        """Saliency, that of the two models, and the conspicuity maps of contrast, by name."""
        models = {"contrast": self.contrast.saliency, "symmetry": self.symmetry.saliency}
        return {"saliency": self.saliency, **models} | {
            name: values for name, values in self.contrast.layers.items() if name != "saliency"
        }


def attention_saliency(
    image: Image, config: AttentionConfig | None = None, *, keep_features: bool = False
) -> AttentionMaps:
    """Saliency from contrast and symmetry.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        config: the weights, and the settings of both models.
        keep_features: whether the maps of contrast hold their feature maps.

    Returns:
        Saliency (h, w), and the maps of each model.

    Raises:
        ImageError: as `contrast_saliency` and `symmetry_saliency`.
    """
    config = config or AttentionConfig()
    contrast = contrast_saliency(image, config.contrast, keep_features=keep_features)
    symmetry = symmetry_saliency(image, config.symmetry)
    maps = (contrast.saliency, resize(symmetry.saliency, contrast.saliency.shape))
    normalized = [normalize(values, config.normalization, radius=None) for values in maps]
    summed = config.contrast_weight * normalized[0] + config.symmetry_weight * normalized[1]
    return AttentionMaps(
        saliency=rescale(summed).astype(np.float32),
        contrast=contrast,
        symmetry=symmetry,
        image_shape=contrast.image_shape,
    )
