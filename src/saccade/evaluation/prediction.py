"""A saliency model scored on a set of images that people looked at."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass

import numpy as np

from saccade.errors import ImageError, LogError
from saccade.evaluation.fixations import FixationScores, score
from saccade.evaluation.intervals import mean_interval
from saccade.types import Float32Array, FloatArray

SEED = 20101  # of the bootstrap: the interval of the same scores is always the same


@dataclass(frozen=True, eq=False)
class PredictionScores:
    """What each image scored, and all of them together."""

    image: Sequence[str]
    """Names, in the order of `scores`."""
    scores: Sequence[FixationScores]
    """One for each image."""

    def mean(self) -> FixationScores:
        """Every metric's mean over the images."""
        return FixationScores(*self._table().mean(axis=0).tolist())

    def interval(self, confidence: float = 0.95) -> tuple[FixationScores, FixationScores]:
        """Lower and upper end of each mean, by bootstrap over the images."""
        low, high = mean_interval(self._table(), confidence, SEED)
        return FixationScores(*low.tolist()), FixationScores(*high.tolist())

    def _table(self) -> FloatArray:
        return np.array([astuple(each) for each in self.scores])  # (images, scores)


def score_model(
    model: Callable[[str], Float32Array],
    fixations: Mapping[str, FloatArray],
    sizes: Mapping[str, tuple[int, int]],
    sigma: float = 24.0,
) -> Iterator[tuple[str, FixationScores]]:
    """Score a model image by image.

    Args:
        model: gives the (H, W) saliency map of the image of a name.
        fixations: by image, (n, 2) x and y in pixels.
        sizes: by image, (H, W); fixations of one image are scaled to another by them.
        sigma: of the blurred fixations, in pixels.

    Yields:
        The name and the scores of each image.

    Raises:
        LogError: there is only one image, so that nothing can be shuffled.
        ImageError: a map or a fixation is not of its image; names the image.
    """
    if len(fixations) < 2:
        raise LogError(f"fixations: expected at least two images, found {len(fixations)}")
    relative = {name: (xy + 0.5) / sizes[name][::-1] for name, xy in fixations.items()}
    for name, xy in fixations.items():
        others = np.vstack([places for other, places in relative.items() if other != name])
        height, width = sizes[name]
        scaled = (others * (width, height) - 0.5).clip(0, (width - 1, height - 1))
        try:
            yield name, score(model(name), xy, scaled, sigma)
        except ImageError as error:
            raise ImageError(f"{name}: {error}") from error
