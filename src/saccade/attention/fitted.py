"""A model of fixations whose weights were fitted to people's, by `saccade fit`."""

from dataclasses import dataclass, field

import numpy as np

from saccade.attention.combined import AttentionConfig
from saccade.attention.faces import FaceDetector
from saccade.attention.features import AROUND, FACES, GEOMETRY, TIMES, feature_maps, map_names
from saccade.attention.models import SaliencyMaps
from saccade.errors import require, require_types
from saccade.pyramid import FloatMap
from saccade.types import Image


@dataclass(frozen=True, eq=False, repr=False)
class FittedMaps(SaliencyMaps):
    """Saliency of a fitted model.

    The cells tile the image: see `saccade.pyramid.cell_centers`.
    """

    saliency: FloatMap
    """(h, w) float32, in proportion to the density of fixations; its maximum is 1."""
    image_shape: tuple[int, int]
    """(H, W) of the image."""

    @property
    def layers(self) -> dict[str, FloatMap]:
        """The saliency by name."""
        return {"saliency": self.saliency}


@dataclass(frozen=True)
class FittedModel:
    """Weights of the features of an image: the logarithm of the density of fixations.

    The default is the attention map itself. `saccade.load_model` reads a file of `saccade fit`.
    """

    features: tuple[str, ...] = ("attention",)
    """Their names; see `saccade.attention.features`."""
    weights: tuple[float, ...] = (1.0,)
    """Weight of each."""
    fitted_to: str = ""
    """What it was fitted to, for the reader."""
    attention: AttentionConfig = field(default_factory=AttentionConfig)
    """Settings of the maps."""

    def __post_init__(self) -> None:
        require_types(self)
        known = {*map_names(self.attention), *GEOMETRY, FACES}
        for name in self.features:
            text = isinstance(name, str)
            parts = [part.partition(AROUND) for part in name.split(TIMES)] if text else []
            holds = 0 < len(parts) < 3 and all(
                base in known and (not around or _is_size(cells)) for base, around, cells in parts
            )
            require(holds, "features", "names of features of its attention settings", name)
        finite = all(isinstance(w, float) and np.isfinite(w) for w in self.weights)
        matching = len(self.weights) == len(self.features) > 0
        expected = f"a finite number for each of the {len(self.features)} features"
        require(finite and matching, "weights", expected, len(self.weights))

    def maps(self, image: Image, faces: FaceDetector | None = None) -> FittedMaps:
        """The saliency of an image.

        Args:
            image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
            faces: finds (n, 4) boxes of faces, for a model with faces; None for none in sight.

        Raises:
            ImageError: as `attention_saliency`.
        """
        values = feature_maps(image, self.features, self.attention, faces)  # (k, h, w)
        log_density = np.tensordot(np.array(self.weights), values, 1)  # (h, w)
        saliency = np.exp(log_density - log_density.max()).astype(np.float32)
        height, width = np.shape(image)[:2]
        return FittedMaps(saliency, (height, width))


def _is_size(cells: str) -> bool:
    return cells.isdecimal() and 0 < int(cells) <= 100
