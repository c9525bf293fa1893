"""What `saccade look` and `saccade evaluate fixations` look with."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    import numpy.typing as npt

    from saccade.types import Float32Array, SymmetricPairs

MEANT = 800
"""Longer side in pixels of an image at which a fixation is as wide as `WITHIN` says."""
WITHIN = 12.0
"""Pixels about a fixation in which the pairs that drew it there are sought."""


class Model(StrEnum):
    """What draws the eye."""

    contrast = "contrast"
    symmetry = "symmetry"
    both = "both"


ModelChoice = Annotated[Model, typer.Option(help="What draws the eye.")]

KINDS = {Model.contrast: "contrast", Model.symmetry: "symmetry", Model.both: "attention"}
"""Of the configuration of each, as `saccade config` calls it."""


@dataclass(frozen=True)
class Attention:
    """A model of attention with its settings."""

    model: Model
    settings: Any
    """Of the kind that `KINDS` names."""
    keep_features: bool = False
    """Whether the maps of contrast hold their feature maps."""

    @classmethod
    def named(
        cls, model: Model, preset: str | None, config: Path | None, *, keep_features: bool = False
    ) -> "Attention":
        """The model with the settings that the command line names."""
        from saccade.cli.settings import load_settings

        return cls(model, load_settings(KINDS[model], preset, config), keep_features)

    def maps(self, image: "npt.NDArray[Any]") -> Any:
        """ContrastMaps, SymmetryMaps or AttentionMaps of an image."""
        from saccade import attention

        if self.model is Model.symmetry:
            return attention.symmetry_saliency(image, self.settings)
        if self.model is Model.contrast:
            return attention.contrast_saliency(
                image, self.settings, keep_features=self.keep_features
            )
        return attention.attention_saliency(image, self.settings, keep_features=self.keep_features)

    def pairs(self, image: "Float32Array", xy: "npt.NDArray[Any]") -> "list[SymmetricPairs]":
        """What makes each of (n, 2) places symmetric; none where symmetry does not count."""
        from saccade.attention import symmetric_pairs

        if self.model is Model.contrast:
            return []
        settings = self.settings if self.model is Model.symmetry else self.settings.symmetry
        within = WITHIN * max(image.shape) / MEANT
        return [symmetric_pairs(image, tuple(each), settings, within=within, most=2) for each in xy]


def contrast_of(maps: Any) -> Any:
    """The ContrastMaps in maps of contrast or of both."""
    return getattr(maps, "contrast", maps)


def layers_of(maps: Any, model: Model) -> "dict[str, Float32Array]":
    """The saliency and what it is made of, by name."""
    layers = {"saliency": maps.saliency}
    if model is Model.both:
        layers |= {"contrast": maps.contrast.saliency, "symmetry": maps.symmetry.saliency}
    if model is not Model.symmetry:
        contrast = contrast_of(maps)
        layers |= {name: getattr(contrast, name) for name in ("intensity", "color", "orientation")}
    return layers
