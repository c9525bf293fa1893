"""Attention: contrast and symmetry together.

Each model's saliency is promoted by N as the conspicuity maps are in A.14, so that a display on
which one of them sees the odd item and the other only equals is decided by the first.
"""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from saccade.attention.contrast import ContrastConfig, ContrastMaps, contrast_saliency
from saccade.attention.contrast_config import HEAVIEST
from saccade.attention.normalize import NORMALIZATIONS, Normalization, normalize, rescale
from saccade.attention.symmetry import SymmetryConfig, SymmetryMaps, symmetry_saliency
from saccade.errors import require
from saccade.pyramid import FloatMap, resize
from saccade.types import Image


@dataclass(frozen=True)
class AttentionConfig:
    """How much contrast and symmetry count, and the settings of each.

    The default is what predicts the fixations of people best; how it was chosen stands in
    docs/symmetry.md.
    """

    contrast_weight: float = 0.1
    """Part of contrast in the saliency."""
    symmetry_weight: float = 1.0
    """The same for symmetry."""
    normalization: Normalization = "local-maxima"
    """How the map of each is promoted; see `saccade.attention.normalize`."""
    contrast: ContrastConfig = field(default_factory=ContrastConfig)
    """Settings of the contrast model."""
    symmetry: SymmetryConfig = field(default_factory=SymmetryConfig)
    """Settings of the symmetry model."""

    def __post_init__(self) -> None:
        for name in ("contrast_weight", "symmetry_weight"):
            weight = getattr(self, name)
            require(0 < weight <= HEAVIEST, name, f"above 0, at most {HEAVIEST:g}", weight)
        choices = ", ".join(NORMALIZATIONS)
        known = self.normalization in NORMALIZATIONS
        require(known, "normalization", f"one of {choices}", self.normalization)

    @classmethod
    def kootstra2010(cls) -> Self:
        """The source's contrast and symmetry, of equal weight."""
        return cls(
            contrast_weight=1.0,
            contrast=ContrastConfig.kootstra2010(),
            symmetry=SymmetryConfig.kootstra2010(),
        )


@dataclass(frozen=True, eq=False, repr=False)
class AttentionMaps:
    """Saliency and the maps of the two models.

    The cells tile the image: see `saccade.pyramid.cell_centers`.
    """

    saliency: FloatMap
    """(h, w) in [0, 1], of the size of the contrast map."""
    contrast: ContrastMaps
    """Saliency by contrast, and what it is made of."""
    symmetry: SymmetryMaps
    """Saliency by symmetry, and what it is made of."""
    image_shape: tuple[int, int]
    """(H, W) of the image."""

    def __repr__(self) -> str:
        height, width = self.saliency.shape
        rows, columns = self.image_shape
        return f"AttentionMaps({width} x {height} cells of a {columns} x {rows} image)"


def attention_saliency(
    image: Image, config: AttentionConfig | None = None, *, keep_features: bool = False
) -> AttentionMaps:
    """Where contrast and symmetry together draw the eye.

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
    both = (contrast.saliency, resize(symmetry.saliency, contrast.saliency.shape))
    by_contrast, by_symmetry = (normalize(m, config.normalization, radius=0) for m in both)
    summed = config.contrast_weight * by_contrast + config.symmetry_weight * by_symmetry
    return AttentionMaps(
        saliency=rescale(summed).astype(np.float32),
        contrast=contrast,
        symmetry=symmetry,
        image_shape=contrast.image_shape,
    )
