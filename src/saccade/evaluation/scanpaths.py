"""Scanpath prediction: scanpaths of models and people beside those of people, image by image."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from saccade.attention.scanpath import ScanpathConfig, scanpath
from saccade.attention.scanpath_model import (
    ScanpathModelConfig,
    most_probable_scanpath,
    sample_scanpaths,
)
from saccade.errors import LogError
from saccade.evaluation.fixations import inside
from saccade.evaluation.scanpath_similarity import (
    GazePath,
    ScanMatchConfig,
    multimatch,
    scanmatch,
)
from saccade.types import FixationTable, Float32Array, FloatArray, Scanpath

PEOPLE, OTHERS, WALK = "people", "other images", "centered walk"
SAMPLED, SIMILAR = "sampled", "sampled, similar"
MOST_PROBABLE, DETERMINISTIC = "most probable", "winner-take-all"
SOURCES = (PEOPLE, OTHERS, WALK, SAMPLED, SIMILAR, MOST_PROBABLE, DETERMINISTIC)
"""Where the scanpaths come from that are compared with those of people."""
WALK_SIGMA = 0.25
"""Center bias of the centered walk where the model has none."""


@dataclass(frozen=True)
class PathScores:
    """A scanpath beside those of the people who saw the image; means over them."""

    scanmatch: float
    """ScanMatch similarity, at most 1."""
    shape: float
    """MultiMatch similarity of the saccades as vectors, 0 to 1; NaN under three fixations."""
    direction: float
    """MultiMatch of the directions of the saccades."""
    length: float
    """MultiMatch of the amplitudes of the saccades."""
    position: float
    """MultiMatch of the positions of the fixations."""
    duration: float
    """MultiMatch of the durations of the fixations; NaN where these are unknown."""
    amplitude: float
    """Mean amplitude of the path's own saccades, in pixels; NaN without any."""
    horizontal: float
    """Fraction of them within 45 degrees of the horizontal; NaN without any."""
    seconds: float
    """Mean duration of the path's own fixations; NaN where unknown."""
    fixations: float
    """Number of the path's own fixations."""


class PathRow(NamedTuple):
    """A scanpath with its scores."""

    image: str
    source: str
    """One of `SOURCES`."""
    number: int
    """Number of the path among those of its source on this image; of people the viewer."""
    path: GazePath
    scores: PathScores


class Viewing(NamedTuple):
    """Fixations of people on an image."""

    shape: tuple[int, int]
    """(H, W) of the image."""
    paths: Mapping[int, GazePath]
    """By viewer; at least one fixation each, inside the image."""


def viewings(
    table: FixationTable, sizes: Mapping[str, tuple[int, int]], drop: int
) -> dict[str, Viewing]:
    """The scanpaths of the viewers of each image, of two viewers or more.

    Args:
        table: fixations of several viewers and images.
        sizes: (H, W) by image; images without are left out.
        drop: number of first fixations of each viewer that are left out.

    Raises:
        LogError: fewer than two images with two viewers.
    """
    result = {}
    for name, shape in sizes.items():
        here = np.flatnonzero((table.image == name) & (table.index >= drop))
        paths = {}
        for viewer in np.unique(table.viewer[here]):
            rows = here[table.viewer[here] == viewer]
            rows = rows[np.argsort(table.index[rows], kind="stable")]
            rows = rows[[len(inside(table.xy[row : row + 1], shape)) > 0 for row in rows]]
            if len(rows):
                unknown = np.full(len(rows), np.nan)
                duration = unknown if table.duration is None else table.duration[rows]
                paths[int(viewer)] = GazePath(table.xy[rows], duration)
        if len(paths) > 1:
            result[name] = Viewing(shape, paths)
    if len(result) < 2:
        raise LogError(f"fixations: expected two images of two viewers, found {len(result)}")
    return result


@dataclass(frozen=True)
class PathSettings:
    """Settings of the comparison of paths."""

    fixations: int
    """Fixations of each path of a model, and the most of a person's that are compared."""
    samples: int = 15
    """Paths that are drawn from the model for each image."""
    model: ScanpathModelConfig = field(default_factory=ScanpathModelConfig)
    network: ScanpathConfig = field(default_factory=ScanpathConfig)
    similarity: ScanMatchConfig = field(default_factory=ScanMatchConfig)
    seed: int = 0
    """Seed of the samples."""


def score_paths(
    name: str,
    people: Mapping[str, Viewing],
    saliency: Float32Array,
    settings: PathSettings,
) -> Iterator[PathRow]:
    """Compare the scanpaths of every source with those of the people who saw an image.

    Args:
        name: of the image.
        people: scanpaths of the viewers by image, see `viewings`. Those of the next image stand
            for other images, scaled to this one.
        saliency: (h, w) of the image.
        settings: the models, and how paths are compared.

    Yields:
        Each path; a person is compared with the others only.
    """
    shape = people[name].shape
    seen = _cut(people[name].paths, settings.fixations)
    everyone = list(seen.values())
    for viewer, path in seen.items():
        others = [each for other, each in seen.items() if other != viewer]
        yield _row(name, PEOPLE, viewer, path, others, shape, settings)
    names = list(people)
    stranger = people[names[(names.index(name) + 1) % len(names)]]
    scale = np.array(shape[::-1]) / stranger.shape[::-1]
    seed = settings.seed * len(names) + names.index(name)
    for viewer, path in _cut(stranger.paths, settings.fixations).items():
        moved = GazePath((path.xy + 0.5) * scale - 0.5, path.duration)
        yield _row(name, OTHERS, viewer, moved, everyone, shape, settings)
    for source, values, model in (
        (WALK, np.ones_like(saliency), walk_model(settings.model)),
        (SAMPLED, saliency, settings.model),
        (SIMILAR, saliency, ScanpathModelConfig.similar()),
    ):
        drawn = sample_scanpaths(
            values, shape, settings.samples, settings.fixations, model, seed=seed
        )
        for number in range(len(drawn)):
            path = GazePath(drawn.xy[number], drawn.duration[number])
            yield _row(name, source, number, path, everyone, shape, settings)
    probable = most_probable_scanpath(saliency, shape, settings.fixations)
    path = GazePath(probable.xy, durations_of(probable))
    yield _row(name, MOST_PROBABLE, 0, path, everyone, shape, settings)
    winners = scanpath(saliency, shape, settings.fixations, settings.network)
    if len(winners):
        path = GazePath(winners.xy, durations_of(winners))
        yield _row(name, DETERMINISTIC, 0, path, everyone, shape, settings)


def walk_model(model: ScanpathModelConfig) -> ScanpathModelConfig:
    """The model of a walk about the center: with a center bias, for a map without contrast."""
    return model if model.center_sigma else replace(model, center_sigma=WALK_SIGMA)


def durations_of(path: Scanpath) -> FloatArray:
    """(n,) seconds from each fixation to the next, NaN for the last."""
    return np.append(np.diff(path.time), np.nan)


def mean_fixations(people: Mapping[str, Viewing]) -> int:
    """The mean number of fixations of a viewer on an image, rounded."""
    counts = [len(path.xy) for viewing in people.values() for path in viewing.paths.values()]
    return round(float(np.mean(counts)))


def _cut(paths: Mapping[int, GazePath], count: int) -> dict[int, GazePath]:
    """The first fixations of each path."""
    return {name: GazePath(path.xy[:count], path.duration[:count]) for name, path in paths.items()}


def _row(
    name: str,
    source: str,
    number: int,
    path: GazePath,
    people: Sequence[GazePath],
    shape: tuple[int, int],
    settings: PathSettings,
) -> PathRow:
    """A path with its scores; the means of MultiMatch are over the pairs that have it."""
    copies = [path] * len(people)
    dimensions = multimatch(copies, people, shape)
    step = np.diff(path.xy, axis=0)
    similarity = scanmatch(copies, people, shape, settings.similarity)
    horizontal = np.abs(step[:, 0]) > np.abs(step[:, 1])
    movements = np.hypot(*step.T), horizontal.astype(np.float64), path.duration
    known = [similarity, *dimensions.T, *movements, np.array([float(len(path.xy))])]
    scores = PathScores(*(_mean(values) for values in known))
    return PathRow(name, source, number, path, scores)


def _mean(values: FloatArray) -> float:
    """Mean of what is known; NaN where nothing is."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
