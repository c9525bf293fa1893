"""What a model of fixations is compared with: the center, other images' fixations, and people."""

from collections.abc import Iterator, Mapping
from dataclasses import astuple
from functools import partial

import numpy as np

from saccade.evaluation.fixations import FixationScores, fixation_density, inside, score
from saccade.evaluation.prediction import Model, other_fixations
from saccade.types import FixationTable, Float32Array, FloatArray

CENTER_WIDTH = 0.25
"""Standard deviation of the Gaussian in the center, as a fraction of each side."""


def center_model(sizes: Mapping[str, tuple[int, int]]) -> Model:
    """A Gaussian in the center, which sees nothing of the image."""

    def centered(name: str) -> Float32Array:
        y, x = (
            np.exp(-((((np.arange(side) + 0.5) / side - 0.5) / CENTER_WIDTH) ** 2) / 2)
            for side in sizes[name]
        )
        return np.outer(y, x).astype(np.float32)

    return centered


def shuffled_model(
    fixations: Mapping[str, FloatArray], sizes: Mapping[str, tuple[int, int]], sigma: float
) -> Model:
    """The density of the fixations of all other images: the baseline of the information gain."""

    def density(name: str) -> Float32Array:
        others = other_fixations(name, fixations, sizes)
        return fixation_density(others, sizes[name], sigma).astype(np.float32)

    return density


def score_people(
    table: FixationTable,
    fixations: Mapping[str, FloatArray],
    sizes: Mapping[str, tuple[int, int]],
    skip: int,
    sigma: float,
) -> Iterator[tuple[str, FixationScores]]:
    """Each viewer of an image against the fixation density of the others: the ceiling of models.

    Args:
        table: fixations of several viewers and images.
        fixations: by image, (n, 2), as `fixations_by_image` has them.
        sizes: by image, (H, W).
        skip: number of first fixations of each viewer that are left out.
        sigma: standard deviation of the blur in pixels.

    Yields:
        The name of each image with two viewers or more, and the mean over its viewers.
    """
    counted = table.index >= skip
    for name in fixations:
        size = sizes[name]
        others = other_fixations(name, fixations, sizes)
        baseline = fixation_density(others, size, sigma)
        scored = partial(score, others=others, sigma=sigma, baseline=baseline)
        here = counted & (table.image == name)
        rows = []
        for viewer in np.unique(table.viewer[here]):
            own = inside(table.xy[here & (table.viewer == viewer)], size)
            rest = inside(table.xy[here & (table.viewer != viewer)], size)
            if len(own) and len(rest):
                rows.append(astuple(scored(fixation_density(rest, size, sigma), own)))
        if rows:
            yield name, FixationScores(*np.mean(rows, axis=0).tolist())
