"""A model of fixations whose weights were fitted to people's, by `saccade fit`."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from saccade.attention._saccade_basis_kernels import fill_logits
from saccade.attention.combined import AttentionConfig
from saccade.attention.faces import FaceDetector
from saccade.attention.features import AROUND, EARLY, FACES, GEOMETRY, feature_maps, map_names
from saccade.attention.models import SaliencyMaps
from saccade.attention.saccade_basis import FUNCTIONS, path_terms, saccade_tables
from saccade.errors import require, require_types
from saccade.scale.pyramid import FloatMap
from saccade.types import FloatArray, Image


@dataclass(frozen=True, eq=False, repr=False)
class FittedMaps(SaliencyMaps):
    """Saliency of a fitted model.

    The cells tile the image: see `saccade.scale.pyramid.cell_centers`.
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
    scanpath_weights: tuple[float, ...] = ()
    """Weights of `next_fixation_density`: of the features; of those in `features.EARLY`, over the
    number of the fixation; of the functions of `saccade_basis`. None for a static model."""

    @property
    def _early(self) -> list[int]:
        return [i for i, name in enumerate(self.features) if name in EARLY]

    def __post_init__(self) -> None:
        require_types(self)
        known = {*map_names(self.attention), *GEOMETRY, FACES}
        for name in self.features:
            base, around, cells = str(name).partition(AROUND)
            holds = base in known and (not around or _is_size(cells))
            require(holds, "features", "names of features of its attention settings", name)
        finite = all(isinstance(w, float) and np.isfinite(w) for w in self.weights)
        matching = len(self.weights) == len(self.features) > 0
        expected = f"a finite number for each of the {len(self.features)} features"
        require(finite and matching, "weights", expected, len(self.weights))
        count = len(self.features) + len(self._early) + FUNCTIONS
        finite = all(isinstance(w, float) and np.isfinite(w) for w in self.scanpath_weights)
        matching = len(self.scanpath_weights) in (0, count)
        expected = f"{count} finite numbers, or none"
        require(finite and matching, "scanpath_weights", expected, len(self.scanpath_weights))

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

    def next_fixation_density(
        self, image: Image, xy: npt.ArrayLike, faces: FaceDetector | None = None
    ) -> FloatArray:
        """The probability of each cell of the map to hold the next fixation.

        Args:
            image: as for `maps`.
            xy: (n, 2) fixations so far in pixels; the first is the center, or where it began.
            faces: as for `maps`.

        Returns:
            (h, w), of sum 1.

        Raises:
            ConfigError: the model is static.
            ImageError: as `attention_saliency`.
        """
        require(len(self.scanpath_weights) > 0, "scanpath_weights", "a model of scanpaths", "none")
        values = feature_maps(image, self.features, self.attention, faces)  # (k, h, w)
        height, width = np.shape(image)[:2]
        weights = np.array(self.scanpath_weights)
        splits = np.cumsum([len(self.features), len(self._early)])
        of_features, of_early, of_saccade = np.split(weights, splits)
        fields = np.stack(
            [
                np.tensordot(of_features, values, 1),
                np.tensordot(of_early, values[self._early], 1),
            ]
        )
        tables = saccade_tables(values.shape[1:], (height, width)) @ of_saccade
        path = np.asarray(xy, np.float64).reshape(-1, 2)
        anchors, factors = path_terms(path, values.shape[1:], (height, width))
        density = np.empty(values.shape[1:])
        fill_logits(fields, tables, anchors, factors, density)
        density = np.exp(density - density.max())
        return np.asarray(density / density.sum())


def _is_size(cells: str) -> bool:
    return cells.isdecimal() and 0 < int(cells) <= 100
