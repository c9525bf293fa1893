"""Fixation prediction: saliency maps scored over a set of images."""

from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.datasets.matlab import read_matrix
from saccade.errors import ImageError, LogError
from saccade.evaluation.fixations import (
    FixationScores,
    fixation_density,
    inside,
    score,
    score_density,
)
from saccade.evaluation.intervals import ScoreSet
from saccade.io.image import as_gray, read_image, read_stored
from saccade.io.npz import map_array
from saccade.scale.pyramid import resize
from saccade.types import FixationTable, Float32Array, FloatArray, Image


def _read_tiff(path: Path) -> npt.NDArray[Any]:
    """A map of any numbers, or an image in gray."""
    stored = read_stored(path)
    return stored if stored.ndim == 2 else as_gray(stored)


ARRAYS: dict[str, Callable[[Path], npt.NDArray[Any]]] = {
    ".npy": map_array,
    ".mat": read_matrix,
    ".tiff": _read_tiff,
}
"""Readers of maps of numbers, by suffix."""
MAX_SALIENCY = 1e15
"""Largest magnitude in a map from a file: squares of float32 can be summed up to it."""


Model = Callable[[str], Float32Array]
"""Function from the name of an image to its (H, W) saliency."""


class PredictionScores(ScoreSet[str, FixationScores]):
    """Fixation scores by the names of the images."""

    seed = 20101


def score_models(
    models: Mapping[str, Model],
    fixations: Mapping[str, FloatArray],
    sizes: Mapping[str, tuple[int, int]],
    sigma: float = 24.0,
    densities: Collection[str] = (),
) -> Iterator[tuple[str, dict[str, FixationScores]]]:
    """Score saliency models image by image.

    Args:
        models: by name, each maps the name of an image to its (H, W) saliency.
        fixations: by image, (n, 2) x and y in pixels.
        sizes: by image, (H, W); fixations of one image are scaled to another by them.
        sigma: standard deviation of the fixation blur, in pixels.
        densities: names of the models that are scored by `score_density`.

    Yields:
        The name of each image, and the scores of each model on it.

    Raises:
        LogError: there is only one image, so that nothing can be shuffled.
        ImageError: a map or a fixation does not fit its image; names the image.
    """
    if len(fixations) < 2:
        raise LogError(f"fixations: expected at least two images, found {len(fixations)}")
    for name, xy in fixations.items():
        others = other_fixations(name, fixations, sizes)
        baseline = fixation_density(others, sizes[name], sigma)
        try:
            yield (
                name,
                {
                    label: (score_density if label in densities else score)(
                        model(name), xy, others, sigma, baseline
                    )
                    for label, model in models.items()
                },
            )
        except ImageError as error:
            raise ImageError(f"{name}: {error}") from error


def other_fixations(
    name: str, fixations: Mapping[str, FloatArray], sizes: Mapping[str, tuple[int, int]]
) -> FloatArray:
    """The fixations (m, 2) of all other images, scaled to the size of one."""
    others = np.vstack(
        [(xy + 0.5) / sizes[other][::-1] for other, xy in fixations.items() if other != name]
    )
    height, width = sizes[name]
    scaled: FloatArray = (others * (width, height) - 0.5).clip(0, (width - 1, height - 1))
    return scaled


def fixations_by_image(
    table: FixationTable, images: Path, skip: int
) -> tuple[dict[str, FloatArray], dict[str, tuple[int, int]], int]:
    """The fixations of each image that lie inside it.

    Args:
        table: fixations of several viewers and images.
        images: folder of the images.
        skip: number of first fixations of each viewer that are left out.

    Returns:
        (n, 2) fixations and (H, W) size by image, and the number of fixations outside.

    Raises:
        ImageError: an image cannot be read.
    """
    counted = table.index >= skip
    fixations: dict[str, FloatArray] = {}
    sizes: dict[str, tuple[int, int]] = {}
    outside = 0
    for image in np.unique(table.image[counted]):
        name = str(image)
        height, width = read_image(images / name).shape[:2]
        xy = table.xy[counted & (table.image == image)]
        visible = inside(xy, (height, width))
        outside += len(xy) - len(visible)
        sizes[name] = (height, width)
        if len(visible):
            fixations[name] = visible
    return fixations, sizes, outside


def saliency_from_files(images: Path, maps: Path) -> Model:
    """A model that reads saliency maps from files, resized to their images.

    Args:
        images: folder of the images.
        maps: folder with a map for each image: NAME.npy, NAME.mat, NAME.png, NAME.tiff or a file
            of the same name.

    Returns:
        A function from the name of an image to its (H, W) map; it raises ImageError where
        there is no valid map.
    """

    def read(name: str) -> Float32Array:
        height, width = read_image(images / name).shape[:2]
        stem = Path(name).stem
        for array in (maps / f"{stem}{suffix}" for suffix in ARRAYS):
            if array.is_file():
                return resize(read_saliency_array(array), (height, width))
        for path in (maps / name, maps / f"{stem}.png"):
            if path.is_file():
                return resize(as_gray(read_image(path)), (height, width))
        raise ImageError(
            f"{maps}: expected a map for {name} (.npy, .mat, .png, .tiff or its own name)"
        )

    return read


def read_saliency_array(path: Path) -> Float32Array:
    """The (h, w) saliency map in an .npy or .tiff file of any type, or the only one in a .mat file.

    Raises:
        ImageError: the file is no array, or not one of finite numbers of shape (h, w).
    """
    try:
        array = ARRAYS[path.suffix](path)
    except LogError as error:
        raise ImageError(str(error)) from error
    except (OSError, ValueError) as error:
        raise ImageError(f"{path}: expected a map as .npy, found another file") from error
    if array.ndim != 2 or array.size == 0 or array.dtype.kind not in "buif":
        raise ImageError(
            f"{path}: expected numbers of shape (h, w), found {array.dtype} of shape {array.shape}"
        )
    if not (np.abs(array.astype(np.float64)) < MAX_SALIENCY).all():
        raise ImageError(
            f"{path}: expected finite numbers under {MAX_SALIENCY:g}, found NaN or others"
        )
    return array.astype(np.float32)


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
