"""Similarity of two scanpaths: ScanMatch and MultiMatch, many pairs at once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from saccade.errors import ImageError, require_valid, setting
from saccade.types import BoolArray, FloatArray, IntArray

MULTIMATCH = ("shape", "direction", "length", "position", "duration")
"""The dimensions of MultiMatch, in the order of its results."""


@dataclass(frozen=True)
class GazePath:
    """A scanpath with the durations of its fixations."""

    xy: FloatArray
    """(n, 2) positions in image pixels, in their order."""
    duration: FloatArray
    """(n,) of each fixation in seconds; NaN where unknown."""


@dataclass(frozen=True)
class ScanMatchConfig:
    """Settings of ScanMatch; the defaults are those it was published with.

    Source: Cristino, Mathot, Theeuwes & Gilchrist, *ScanMatch: A novel method for comparing
    fixation sequences* (Behavior Research Methods 2010).
    """

    columns: int = setting(12, 1, 1000)
    """Columns of the grid over the image."""
    rows: int = setting(8, 1, 1000)
    """Rows of the grid over the image."""
    threshold: float = setting(3.5, above=0)
    """Distance in cells at which a substitution scores 0; it scores the threshold less the
    distance, so that nearer cells are aligned and farther ones are not."""
    gap: float = setting(0.0, maximum=0)
    """Score of a gap in the alignment; not above 0."""
    time_bin: float | None = setting(None, above=0)
    """Seconds for which a fixation counts once; None counts each once, whatever its duration."""

    def __post_init__(self) -> None:
        require_valid(self)


def scanmatch(
    first: Sequence[GazePath],
    second: Sequence[GazePath],
    image_shape: tuple[int, int],
    config: ScanMatchConfig | None = None,
) -> FloatArray:
    """ScanMatch similarity of pairs of scanpaths.

    The score of the best global alignment (Needleman & Wunsch 1970) of the cells in which the
    fixations lie, over the score of the longer path with itself.

    Args:
        first: p paths of at least one fixation each.
        second: p paths to compare them with, in the same order.
        image_shape: (H, W).
        config: grid, substitution and gap.

    Returns:
        (p,) at most 1, which is that of equal paths; not below 0 without a gap penalty.

    Raises:
        ImageError: a path without fixations; or without durations where they are needed.
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


def multimatch(
    first: Sequence[GazePath], second: Sequence[GazePath], image_shape: tuple[int, int]
) -> FloatArray:
    """MultiMatch similarity of pairs of scanpaths, without simplification.

    Saccades are aligned by the cheapest path through the matrix of their vector differences; of
    the aligned pairs the median difference in five properties counts.

    Args:
        first: p paths; those of fewer than three fixations have no similarity.
        second: p paths to compare them with, in the same order.
        image_shape: (H, W); its diagonal is the unit of length.

    Returns:
        (p, 5) similarities from 0 to 1, as `MULTIMATCH` names them; NaN where a path is too
        short or has no durations.

    Source: Jarodzka, Holmqvist & Nystrom (ETRA 2010); Dewhurst et al. (Behavior Research Methods
    2012).
    """
    result = np.full((len(first), len(MULTIMATCH)), np.nan)
    long = [k for k in range(len(first)) if min(len(first[k].xy), len(second[k].xy)) >= 3]
    if not long:
        return result
    (start_a, vector_a, time_a, n), (start_b, vector_b, time_b, m) = (
        _saccades([paths[k] for k in long]) for paths in (first, second)
    )
    difference = vector_a[:, :, None] - vector_b[:, None]
    cost = np.hypot(difference[..., 0], difference[..., 1])
    i, j, aligned = _alignment(cost, n, m)
    pair = np.arange(len(long))[:, None]
    a, b = vector_a[pair, i], vector_b[pair, j]
    turn = np.abs(np.arctan2(a[..., 1], a[..., 0]) - np.arctan2(b[..., 1], b[..., 0]))
    diagonal = float(np.hypot(*image_shape))
    durations = time_a[pair, i], time_b[pair, j]
    differences = (
        np.linalg.norm(a - b, axis=2) / (2 * diagonal),
        np.minimum(turn, 2 * np.pi - turn) / np.pi,
        np.abs(np.linalg.norm(a, axis=2) - np.linalg.norm(b, axis=2)) / diagonal,
        np.linalg.norm(start_a[pair, i] - start_b[pair, j], axis=2) / diagonal,
        np.abs(durations[0] - durations[1]) / np.maximum(np.maximum(*durations), 1e-12),
    )
    for column, values in enumerate(differences):
        medians = [np.median(each[inside]) for each, inside in zip(values, aligned, strict=True)]
        result[long, column] = 1 - np.array(medians)
    return result


def _cells(path: GazePath, image_shape: tuple[int, int], config: ScanMatchConfig) -> FloatArray:
    """(k, 2) column and row of the grid for each fixation, repeated for each bin of time."""
    if len(path.xy) == 0:
        raise ImageError("scanpath: expected at least one fixation, found none")
    grid = np.array([config.columns, config.rows])
    cells = np.floor((path.xy + 0.5) / image_shape[::-1] * grid).clip(0, grid - 1)
    if config.time_bin is None:
        return np.asarray(cells)
    if not np.isfinite(path.duration).all():
        raise ImageError("scanpath: expected the duration of each fixation for bins of time")
    repeats = np.maximum(1, np.round(path.duration / config.time_bin)).astype(np.int64)
    return np.asarray(np.repeat(cells, repeats, axis=0))


def _saccades(paths: Sequence[GazePath]) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Starts (p, n, 2) and vectors (p, n, 2) of saccades, durations before them, and counts."""
    start, count = _padded([path.xy[:-1] for path in paths])
    vector, _ = _padded([np.diff(path.xy, axis=0) for path in paths])
    duration, _ = _padded([path.duration[:-1, None] for path in paths])
    return start, vector, duration[..., 0], count


def _alignment(cost: FloatArray, n: IntArray, m: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """The cheapest paths from (0, 0) to (n - 1, m - 1) in the first n, m of matrices (p, N, M).

    Returns:
        (p, N + M) rows and columns from the end to the start, and which of them count.
    """
    p, rows, columns = cost.shape
    total = np.full((p, rows + 1, columns + 1), np.inf)
    total[:, 0, 0] = 0
    for i in range(rows):
        for j in range(columns):
            before = np.minimum(total[:, i, j + 1], total[:, i + 1, j])
            total[:, i + 1, j + 1] = cost[:, i, j] + np.minimum(before, total[:, i, j])
    pair = np.arange(p)
    at_i, at_j = n - 1, m - 1
    path_i, path_j = np.zeros((2, p, rows + columns), np.int64)
    aligned = np.zeros((p, rows + columns), np.bool_)
    arrived = np.zeros(p, np.bool_)
    for step in range(rows + columns):
        path_i[:, step], path_j[:, step], aligned[:, step] = at_i, at_j, ~arrived
        arrived |= (at_i == 0) & (at_j == 0)
        origins = total[pair, at_i, at_j], total[pair, at_i, at_j + 1], total[pair, at_i + 1, at_j]
        move = np.stack(origins).argmin(axis=0)
        at_i = np.where(arrived, 0, at_i - (move != 2))
        at_j = np.where(arrived, 0, at_j - (move != 1))
    return path_i, path_j, aligned


def _padded(paths: Sequence[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Paths (k, d) of several lengths as one array (p, n, d), zero at the end; and the lengths."""
    lengths = np.array([len(path) for path in paths], np.int64)
    padded = np.zeros((len(paths), int(lengths.max()), paths[0].shape[1]))
    for k, path in enumerate(paths):
        padded[k, : len(path)] = path
    return padded, lengths
