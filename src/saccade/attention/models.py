"""The attention models by name, each with its settings and the layers of its result."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy.typing as npt

    from saccade.types import Float32Array, SymmetricPairs

REFERENCE_SIZE = 800
"""Longer side in pixels of an image at which a fixation is as wide as `PAIR_RADIUS` says."""
PAIR_RADIUS = 12.0
"""Pixels about a fixation in which the pairs that drew it there are sought."""


KINDS = {"contrast": "contrast", "symmetry": "symmetry", "both": "attention"}
"""By the name of a model, the kind of its configuration as `saccade config` calls it."""


@dataclass(frozen=True)
class AttentionModel:
    """A model of attention with its settings."""

    model: str
    """One of `KINDS`."""
    settings: Any
    """Of the kind that `KINDS` names."""
    keep_features: bool = False
    """Whether the maps of contrast hold their feature maps."""

    def maps(self, image: "npt.NDArray[Any]") -> Any:
        """ContrastMaps, SymmetryMaps or AttentionMaps of an image."""
        from saccade import attention

        if self.model == "symmetry":
            return attention.symmetry_saliency(image, self.settings)
        if self.model == "contrast":
            return attention.contrast_saliency(
                image, self.settings, keep_features=self.keep_features
            )
        return attention.attention_saliency(image, self.settings, keep_features=self.keep_features)

    def pairs(self, image: "Float32Array", xy: "npt.NDArray[Any]") -> "list[SymmetricPairs]":
        """What makes each of (n, 2) places symmetric; none where symmetry does not count."""
        from saccade.attention import symmetric_pairs

        if self.model == "contrast":
            return []
        settings = self.settings if self.model == "symmetry" else self.settings.symmetry
        within = PAIR_RADIUS * max(image.shape) / REFERENCE_SIZE
        return [
            symmetric_pairs(image, tuple(each), settings, radius=within, max_pairs=2) for each in xy
        ]


def contrast_of(maps: Any) -> Any:
    """The ContrastMaps in maps of contrast or of both."""
    return getattr(maps, "contrast", maps)


def layers_of(maps: Any, model: str) -> "dict[str, Float32Array]":
    """The saliency and what it is made of, by name."""
    layers = {"saliency": maps.saliency}
    if model == "both":
        layers |= {"contrast": maps.contrast.saliency, "symmetry": maps.symmetry.saliency}
    if model != "symmetry":
        contrast = contrast_of(maps)
        layers |= {name: getattr(contrast, name) for name in ("intensity", "color", "orientation")}
    return layers
