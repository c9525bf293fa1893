"""Our models inside pysaliency, the toolbox of Kümmerer, Wallis & Bethge."""

from collections.abc import Callable
from typing import Any

import numpy as np

from saccade.types import Float32Array, Image


def as_pysaliency(predict: Callable[[Image], Float32Array]) -> Any:
    """A saliency model as pysaliency's `SaliencyMapModel`.

    Args:
        predict: from an (H, W, 3) uint8 image to its (H, W) saliency map, such as
            `lambda image: resize(contrast_saliency(image).saliency, image.shape[:2])`
            with `saccade.scale.pyramid.resize`.

    Returns:
        An object with pysaliency's methods: `saliency_map`, `AUC`, `NSS`, `CC` and so on.

    Raises:
        ImportError: pysaliency is not installed.
    """
    from pysaliency.saliency_map_models import SaliencyMapModel

    class Model(SaliencyMapModel):  # type: ignore[misc]
        def _saliency_map(self, stimulus: Image) -> Float32Array:
            image = stimulus if stimulus.ndim == 2 else stimulus[:, :, :3]
            return np.asarray(predict(np.asarray(image)))

    return Model()
