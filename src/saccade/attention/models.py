"""The attention models by name, and what their results have in common."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy.typing as npt

    from saccade.attention.combined import FaceDetector
    from saccade.scale.pyramid import FloatMap
    from saccade.types import Float32Array, SymmetricPairs

REFERENCE_SIZE = 800
"""Longer side in pixels of an image to which `PAIR_RADIUS` applies."""
PAIR_RADIUS = 12.0
"""Radius in pixels about a fixation in which symmetric pairs are searched."""
FITTED = "fitted"
KINDS = {name: name for name in ("attention", "contrast", "symmetry", "boolean")}
"""Kind of the configuration of each model, as `saccade config` calls it."""


@dataclass(frozen=True, eq=False, repr=False)
class SaliencyMaps:
    """Base of the results of the models: saliency by size and by name.

    The cells of a map tile the image: see `saccade.scale.pyramid.cell_centers`.
    """

    saliency: "npt.NDArray[Any]"
    """(h, w), not negative."""
    image_shape: tuple[int, int]
    """(H, W) of the image."""

    @property
    def layers(self) -> "dict[str, npt.NDArray[Any]]":
        """The maps by name, the saliency first."""
        return {"saliency": self.saliency}

    @property
    def full_size(self) -> "dict[str, Float32Array]":
        """The maps by name at the size of the image, (H, W) each: bilinear where they grow."""
        from saccade.scale.pyramid import resize

        return {name: resize(layer, self.image_shape) for name, layer in self.layers.items()}

    def __repr__(self) -> str:
        (h, w), (height, width) = self.saliency.shape, self.image_shape
        return f"{type(self).__name__}({w} x {h} cells of a {width} x {height} image)"


@dataclass(frozen=True)
class AttentionModel:
    """An attention model with its settings."""

    model: str
    """One of `KINDS`, or `FITTED`."""
    settings: Any
    """Settings of the kind that `KINDS` names, or a FittedModel."""
    faces: "FaceDetector | None" = None
    """Finds faces, for the attention model and fitted ones; None for none."""

    def maps(self, image: "npt.NDArray[Any]") -> Any:
        """AttentionMaps of an image, or those of one model."""
        from saccade import attention

        if self.model == FITTED:
            return self.settings.maps(image, self.faces)
        if self.model == "symmetry":
            return attention.symmetry_saliency(image, self.settings)
        if self.model == "boolean":
            return attention.boolean_saliency(image, self.settings)
        if self.model == "contrast":
            return attention.contrast_saliency(image, self.settings)
        return attention.attention_saliency(image, self.settings, faces=self.faces)

    def pairs(self, image: "Float32Array", xy: "npt.NDArray[Any]") -> "list[SymmetricPairs]":
        """The strongest symmetric pairs at each of (n, 2) positions; none without symmetry."""
        from saccade.attention.symmetry import symmetric_pairs_at

        if self.model in ("contrast", "boolean"):
            return []
        settings = self.settings
        if self.model != "symmetry":
            settings = getattr(settings, "attention", settings).symmetry
        radius = PAIR_RADIUS * max(image.shape) / REFERENCE_SIZE
        positions = [(x, y) for x, y in xy]
        return symmetric_pairs_at(image, positions, settings, radius=radius, max_pairs=2)


def bare_saliency(maps: Any) -> "FloatMap":
    """The saliency (h, w) of a model's maps, without a prior of the position."""
    bare: FloatMap = getattr(maps, "bare", maps.saliency)
    return bare
