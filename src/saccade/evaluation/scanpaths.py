"""Scanpath prediction: similarity of model scanpaths and human scanpaths, image by image."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from saccade.attention.maps import SaliencyMaps
from saccade.attention.scanpath import ScanpathConfig, scanpath
from saccade.attention.scanpath_model import (
    ScanpathModelConfig,
    most_probable_scanpath,
    sample_scanpaths,
)
from saccade.errors import ImageError, LogError, Settings, setting
from saccade.evaluation.prediction import FixationData
from saccade.types import Float32Array, FloatArray, IntArray, Scanpath


@dataclass(frozen=True)
class GazePath:
    """A scanpath with the durations of its fixations."""

    xy: FloatArray
    """(n, 2) positions in image pixels, in temporal order."""
    duration: FloatArray
    """(n,) durations of the fixations in seconds; NaN if unknown."""


@dataclass(frozen=True)
class ScanMatchConfig(Settings):
    """Settings of ScanMatch, with the published defaults.

    Source: Cristino, Mathot, Theeuwes & Gilchrist, *ScanMatch: A novel method for comparing
    fixation sequences* (Behavior Research Methods 2010).
    """

    columns: int = setting(12, 1, 1000)
    """Columns of the grid over the image."""
    rows: int = setting(8, 1, 1000)
    """Rows of the grid over the image."""
    threshold: float = setting(3.5, above=0)
    """Maximum distance in cells of aligned fixations: a substitution scores the threshold minus the
    distance."""
    gap: float = setting(0.0, maximum=0)
    """Score of a gap in the alignment; not above 0."""
    time_bin: float | None = setting(None, above=0)
    """Time bin in seconds, by which long fixations are repeated; None ignores durations."""


def scanmatch(
    first: Sequence[GazePath],
    second: Sequence[GazePath],
    image_shape: tuple[int, int],
    config: ScanMatchConfig | None = None,
) -> FloatArray:
    """ScanMatch similarity of pairs of scanpaths.

    The score of the best global alignment (Needleman & Wunsch 1970) of the fixated cells, divided
    by the score of the longer path with itself.

    Args:
        first: p paths with at least one fixation each.
        second: p paths to compare, in the same order.
        image_shape: (H, W).
        config: grid, substitution and gap.

    Returns:
        (p,) similarity, 1 for equal paths, and at least 0 without a gap penalty.

    Raises:
        ImageError: a path without fixations, or without durations if time bins are used.
    """
    config = config or ScanMatchConfig()
    cells_a, n = _padded([_cells(path, image_shape, config) for path in first])
    cells_b, m = _padded([_cells(path, image_shape, config) for path in second])
    offset = cells_a[:, :, None] - cells_b[:, None]
    substitution = config.threshold - np.hypot(offset[..., 0], offset[..., 1])
    score = np.zeros((len(n), cells_a.shape[1] + 1, cells_b.shape[1] + 1))
    score[:, :, 0] = config.gap * np.arange(score.shape[1])
    score[:, 0, :] = config.gap * np.arange(score.shape[2])
    for i in range(1, score.shape[1]):
        for j in range(1, score.shape[2]):
            aligned = score[:, i - 1, j - 1] + substitution[:, i - 1, j - 1]
            skipped = np.maximum(score[:, i - 1, j], score[:, i, j - 1]) + config.gap
            score[:, i, j] = np.maximum(aligned, skipped)
    best = score[np.arange(len(n)), n, m]
    return np.asarray(best / (config.threshold * np.maximum(n, m)))


def _cells(path: GazePath, image_shape: tuple[int, int], config: ScanMatchConfig) -> FloatArray:
    """(k, 2) grid column and row of each fixation, repeated for each time bin."""
    if len(path.xy) == 0:
        raise ImageError("scanpath: expected at least one fixation, found none")
    grid = np.array([config.columns, config.rows])
    cells = np.floor((path.xy + 0.5) / image_shape[::-1] * grid).clip(0, grid - 1)
    if config.time_bin is None:
        return np.asarray(cells)
    if not np.isfinite(path.duration).all():
        raise ImageError("scanpath: expected the duration of each fixation for time bins")
    repeats = np.maximum(1, np.round(path.duration / config.time_bin)).astype(np.int64)
    return np.asarray(np.repeat(cells, repeats, axis=0))


def _padded(paths: Sequence[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Paths (k, d) as a zero-padded array (p, n, d), and their lengths."""
    lengths = np.array([len(path) for path in paths], np.int64)
    padded = np.zeros((len(paths), int(lengths.max()), paths[0].shape[1]))
    for k, path in enumerate(paths):
        padded[k, : len(path)] = path
    return padded, lengths


PEOPLE = "people"
OTHERS = "other images"
WALK = "centered walk"
SAMPLED = "sampled"
SIMILAR = "sampled, similar"
MOST_PROBABLE = "most probable"
DETERMINISTIC = "winner-take-all"
SOURCES = (PEOPLE, OTHERS, WALK, SAMPLED, SIMILAR, MOST_PROBABLE, DETERMINISTIC)
"""Sources of the scanpaths that are compared with human scanpaths."""
WALK_SIGMA = 0.25
"""Center bias of the centered walk if the model has none."""


@dataclass(frozen=True)
class PathScores:
    """Scores of a scanpath against human scanpaths on the image, averaged over subjects."""

    scanmatch: float
    """ScanMatch similarity, at most 1."""
    amplitude: float
    """Mean amplitude of the path's own saccades, in pixels; NaN without any."""
    horizontal: float
    """Fraction of saccades within 45 degrees of the horizontal; NaN without any."""
    seconds: float
    """Mean duration of the path's own fixations in seconds; NaN if unknown."""
    fixations: float
    """Number of the path's own fixations."""


class PathRow(NamedTuple):
    """A scanpath with its scores."""

    image: str
    source: str
    """One of `SOURCES`."""
    scores: PathScores


class Viewing(NamedTuple):
    """Human scanpaths on an image."""

    shape: tuple[int, int]
    """(H, W) of the image."""
    paths: Mapping[tuple[int, int], GazePath]
    """Scanpaths by subject and number, each with at least one fixation inside the image."""


def viewings(data: FixationData) -> dict[str, Viewing]:
    """Human scanpaths of each image with two or more subjects.

    Raises:
        LogError: fewer than two images with two subjects.
    """
    result = {}
    for name, shape in data.sizes.items():
        seen = data.on(name)
        duration = np.full(len(seen), np.nan) if seen.duration is None else seen.duration
        paths, number = {}, seen.scanpath
        for path in np.unique(number):
            rows = np.flatnonzero(number == path)
            paths[int(seen.subject[rows[0]]), int(path)] = GazePath(seen.xy[rows], duration[rows])
        if len({subject for subject, _ in paths}) > 1:
            result[name] = Viewing(shape, paths)
    if len(result) < 2:
        raise LogError(f"fixations: expected two images of two subjects, found {len(result)}")
    return result


@dataclass(frozen=True)
class PathSettings:
    """Settings of the comparison of paths."""

    fixations: int
    """Number of fixations per model path, and maximum for human paths."""
    samples: int = 15
    """Number of paths drawn from the model for each image."""
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
    """Compares the scanpaths of every source with human scanpaths on an image.

    Args:
        name: name of the image.
        people: human scanpaths by image, see `viewings`. Scanpaths on the next image, scaled to
            this image, represent other images.
        saliency: (h, w) saliency of the image.
        settings: models, and settings of the comparison.

    Yields:
        Each path; subjects are compared with the other subjects only.
    """
    shape = people[name].shape
    seen = _cut(people[name].paths, settings.fixations)
    everyone = list(seen.values())

    def row(source: str, path: GazePath, subjects: Sequence[GazePath]) -> PathRow:
        return PathRow(name, source, path_scores(path, subjects, shape, settings.similarity))

    for (subject, _), path in seen.items():
        others = [each for (other, _), each in seen.items() if other != subject]
        yield row(PEOPLE, path, others)
    names = list(people)
    stranger = people[names[(names.index(name) + 1) % len(names)]]
    scale = np.array(shape[::-1]) / stranger.shape[::-1]
    seed = settings.seed * len(names) + names.index(name)
    for path in _cut(stranger.paths, settings.fixations).values():
        yield row(OTHERS, GazePath((path.xy + 0.5) * scale - 0.5, path.duration), everyone)
    maps, length = SaliencyMaps(saliency, shape), settings.fixations
    for source, values, model in (
        (WALK, SaliencyMaps(np.ones_like(saliency), shape), walk_model(settings.model)),
        (SAMPLED, maps, settings.model),
        (SIMILAR, maps, ScanpathModelConfig.similar()),
    ):
        drawn = sample_scanpaths(values, model, count=settings.samples, fixations=length, seed=seed)
        for each in zip(drawn.xy, drawn.duration, strict=True):
            yield row(source, GazePath(*each), everyone)
    for source, found in (
        (MOST_PROBABLE, most_probable_scanpath(maps, fixations=length)),
        (DETERMINISTIC, scanpath(maps, settings.network, fixations=length)),
    ):
        if len(found):
            yield row(source, GazePath(found.xy, durations_of(found)), everyone)


def walk_model(model: ScanpathModelConfig) -> ScanpathModelConfig:
    """Model of a random walk around the center, for a uniform map."""
    return model if model.center_sigma else replace(model, center_sigma=WALK_SIGMA)


def durations_of(path: Scanpath) -> FloatArray:
    """(n,) seconds from each fixation to the next; NaN for the last."""
    return np.append(np.diff(path.time), np.nan)


def mean_fixations(people: Mapping[str, Viewing]) -> int:
    """The mean number of fixations of a subject on an image, rounded."""
    counts = [len(path.xy) for viewing in people.values() for path in viewing.paths.values()]
    return round(float(np.mean(counts)))


def _cut(paths: Mapping[tuple[int, int], GazePath], count: int) -> dict[tuple[int, int], GazePath]:
    """The first fixations of each path."""
    return {name: GazePath(path.xy[:count], path.duration[:count]) for name, path in paths.items()}


def path_scores(
    path: GazePath, people: Sequence[GazePath], shape: tuple[int, int], config: ScanMatchConfig
) -> PathScores:
    """Scores of a path; means ignore unknown values and are NaN if all are unknown."""
    step = np.diff(path.xy, axis=0)
    known = path.duration[np.isfinite(path.duration)]
    return PathScores(
        scanmatch=float(scanmatch([path] * len(people), people, shape, config).mean()),
        amplitude=float(np.hypot(*step.T).mean()) if len(step) else np.nan,
        horizontal=float(np.mean(np.abs(step[:, 0]) > np.abs(step[:, 1]))) if len(step) else np.nan,
        seconds=float(known.mean()) if len(known) else np.nan,
        fixations=float(len(path.xy)),
    )
