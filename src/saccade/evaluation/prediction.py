"""Fixation prediction: saliency maps scored over a set of images."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from saccade.attention.values import as_saliency
from saccade.datasets.fixations.placement import image_shape, list_files
from saccade.datasets.saliency_maps import MapFiles, read_map
from saccade.errors import ImageError, LogError
from saccade.evaluation.fixations import (
    TINY,
    FixationScores,
    Map,
    distribution,
    fixation_density,
    inside,
    ranks,
    score,
    values_at,
)
from saccade.evaluation.intervals import ScoreSet
from saccade.io.files import IMAGE_SUFFIXES
from saccade.io.image import read_image
from saccade.scale.pyramid import resize
from saccade.types import FixationTable, Float32Array, FloatArray, IntArray

Blur = float | Callable[[tuple[int, int]], float]
"""Standard deviation in pixels, or a function that returns it for the (H, W) of an image."""
Model = Callable[[str], Float32Array]
"""Function from the name of an image to its (H, W) saliency."""
CENTER_WIDTH = 0.25
"""Standard deviation of the center Gaussian, as a fraction of each side."""


class PredictionScores(ScoreSet[str, FixationScores]):
    """Fixation scores by image name."""

    seed = 20101


@dataclass(frozen=True, eq=False)
class FixationData:
    """Recorded fixations on images, with the settings for scoring maps."""

    folder: Path
    """Folder of the images."""
    table: FixationTable
    """Fixations inside their images, sorted by image, subject, trial and index."""
    sizes: Mapping[str, tuple[int, int]]
    """(H, W) of each image with fixations, by which fixations are scaled between images."""
    sigma: float | Mapping[str, float] = 24.0
    """Standard deviation of the fixation blur in pixels, for all images or by name."""
    outside: int = 0
    """Number of fixations left out because they are outside their images."""

    @classmethod
    def of(cls, table: FixationTable, folder: str | Path, skip: int, sigma: Blur = 24.0) -> Self:
        """Builds the data from a table of fixations and a folder of images.

        Args:
            table: fixations of several subjects and images.
            folder: folder of the images.
            skip: number of initial fixations of each scanpath to leave out.
            sigma: standard deviation of the fixation blur, in pixels, or as a function of the
                (H, W) of an image.

        Raises:
            ImageError: an image cannot be read.
            LogError: no fixation is inside its image.
        """
        folder = Path(folder)
        order = np.lexsort((table.index, table.scanpath))
        table = table[order[table.index[order] >= skip]]
        names, index = np.unique(table.image, return_inverse=True)
        sizes = [image_shape(folder / name) for name in names.tolist()]
        visible = inside(table.xy, np.array(sizes)[index])
        table = table[visible]
        kept = {n: s for n, s in zip(names.tolist(), sizes, strict=True) if n in table.image}
        if not kept:
            raise LogError("fixations: expected some inside their images, found none")
        blur = {n: sigma(s) for n, s in kept.items()} if callable(sigma) else sigma
        return cls(folder, table, kept, blur, int((~visible).sum()))

    def sigma_of(self, name: str) -> float:
        """Standard deviation of the fixation blur on an image, in pixels."""
        return self.sigma[name] if isinstance(self.sigma, Mapping) else self.sigma

    def read(self, name: str) -> Float32Array:
        """Reads an image by name."""
        return read_image(self.folder / name)

    def on(self, name: str) -> FixationTable:
        """The fixations on an image."""
        first, last = (np.searchsorted(self.table.image, name, side) for side in ("left", "right"))
        return self.table[first:last]

    def elsewhere(self, name: str) -> FloatArray:
        """The fixations (m, 2) on all other images, scaled to the size of this image."""
        here = self.table.image == name
        height, width = self.sizes[name]
        scaled = (self.table.xy[~here] + 0.5) / self._shapes[~here, ::-1] * (width, height) - 0.5
        return np.asarray(scaled.clip(0, (width - 1, height - 1)))

    def density(self, name: str, xy: FloatArray) -> FloatArray:
        """The fixation density (H, W) of fixations (n, 2) on an image."""
        return fixation_density(xy, self.sizes[name], self.sigma_of(name))

    @cached_property
    def _shapes(self) -> IntArray:
        """(n, 2) height and width of the image of each fixation."""
        names, index = np.unique(self.table.image, return_inverse=True)
        return np.array([self.sizes[name] for name in names.tolist()])[index.reshape(-1)]

    @lru_cache(maxsize=2)  # noqa: B019 - the data live as long as the run
    def negatives(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Fixations on other images, and their density: the baseline of the information gain.

        For a single image there are none, and the density is empty.
        """
        others = self.elsewhere(name)
        return others, self.density(name, others) if len(others) else np.zeros((0, 0))

    def score(
        self, name: str, saliency: Map, xy: FloatArray, *, density: bool = False
    ) -> FixationScores:
        """Scores of a map (H, W), or density, for fixations (n, 2) on the image."""
        others, baseline = self.negatives(name)
        return score(saliency, xy, others, self.sigma_of(name), baseline, density=density)

    def center(self, name: str) -> Float32Array:
        """A Gaussian at the center of an image, independent of its content."""
        y, x = (
            np.exp(-((((np.arange(side) + 0.5) / side - 0.5) / CENTER_WIDTH) ** 2) / 2)
            for side in self.sizes[name]
        )
        return np.outer(y, x).astype(np.float32)

    def shuffled(self, name: str) -> Float32Array:
        """The density of the fixations on all other images."""
        return self.negatives(name)[1].astype(np.float32)


def score_models(
    models: Mapping[str, Model], data: FixationData, densities: Collection[str] = ()
) -> Iterator[tuple[str, dict[str, FixationScores]]]:
    """Score saliency models image by image.

    Args:
        models: functions from the name of an image to its (H, W) saliency, by name.
        data: the fixations.
        densities: names of the models whose maps are densities, see `fixations.score`.

    Yields:
        The name of each image, and the scores of each model on it.

    Raises:
        ImageError: a map or a fixation does not fit its image; the message names the image.
    """
    for name in data.sizes:
        xy = data.on(name).xy
        try:
            scores = {
                label: data.score(name, model(name), xy, density=label in densities)
                for label, model in models.items()
            }
        except ImageError as error:
            raise ImageError(f"{name}: {error}") from error
        yield name, scores


def score_people(data: FixationData) -> Iterator[tuple[str, FixationScores]]:
    """Scores each subject against the fixation density of the others: the ceiling of models.

    Yields:
        The name of each image with two or more subjects, and the mean over its subjects.
    """
    for name in data.sizes:
        seen = data.on(name)
        subjects = np.unique(seen.subject)
        rows = [
            data.score(name, data.density(name, seen.xy[seen.subject != each]), seen.xy[own])
            for each in subjects
            if (own := seen.subject == each).sum() < len(seen)
        ]
        if rows:
            yield name, PredictionScores([name] * len(rows), rows).mean()


class FixationRow(NamedTuple):
    """Scores of a fixation; their means over an image equal the scores of its map."""

    image: str
    model: str
    subject: int
    fixation: int
    """Its index."""
    x: float
    y: float
    auc: float
    """Fraction of the pixels that are less salient, ties counting half."""
    shuffled_auc: float
    """Shuffled AUC: AUC against the other images' fixations."""
    nss: float
    """Saliency in standard deviations above the mean of the map."""
    information_gain: float
    """Information gain in bits over the density of fixations on other images."""


def fixation_rows(name: str, maps: Mapping[str, Map], data: FixationData) -> Iterator[FixationRow]:
    """Scores of each fixation on an image for each model's map (H, W)."""
    seen = data.on(name)
    others, density = data.negatives(name)
    baseline = distribution(density)
    for model, saliency in maps.items():
        at, p = values_at(saliency, seen.xy), distribution(saliency)
        bits = np.log2(TINY + values_at(p, seen.xy)) - np.log2(TINY + values_at(baseline, seen.xy))
        columns = (
            *(seen.subject, seen.index, *seen.xy.T),
            ranks(at, saliency.ravel()),
            ranks(at, values_at(saliency, others)),
            (at - saliency.mean()) / (float(saliency.std()) or np.inf),
            bits,
        )
        for row in zip(*(column.tolist() for column in columns), strict=True):
            yield FixationRow(name, model, *row)


def saliency_from_files(images: Path, maps: Path, kind: str | None = None) -> Model:
    """A model that reads saliency maps from files, resized to their images.

    Args:
        images: folder of the images.
        maps: folder with a map for each image: its path with the suffix of an image, .npy or .mat.
        kind: kind of the values; see `saccade.attention.values.as_saliency`.

    Returns:
        A function from the name of an image to its (H, W) map; it raises ImageError if there is no
        valid map.
    """
    files = MapFiles(maps, list_files(images, IMAGE_SUFFIXES))

    def read(name: str) -> Float32Array:
        path, shape = files.find(name), image_shape(images / name)
        return resize(as_saliency(read_map(path), str(path), shape, kind), shape)

    return read


def read_saliency_array(path: Path) -> Float32Array:
    """Reads an (h, w) saliency map from .npy or an image, or the only map in a .mat file.

    Raises:
        ImageError: the file does not hold finite numbers of shape (h, w).
    """
    return as_saliency(read_map(path), str(path))
