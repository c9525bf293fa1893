"""ScanMatch against its definition and closed forms."""

from functools import cache

import numpy as np
import pytest

from saccade.errors import ConfigError, ImageError
from saccade.evaluation.scanpaths import (
    GazePath,
    ScanMatchConfig,
    path_scores,
    scanmatch,
)

SHAPE = (600, 800)


def paths(rng, count, low=3):
    return [
        GazePath(rng.uniform((0, 0), (799, 599), (n, 2)), rng.uniform(0.1, 0.9, n))
        for n in rng.integers(low, 10, count)
    ]


def best_alignment(first, second, config):
    """The best score of all alignments, by trying all; over that of the longer with itself."""
    size = np.array([config.columns, config.rows])
    a, b = (np.floor((each.xy + 0.5) / SHAPE[::-1] * size) for each in (first, second))

    @cache
    def best(i, j):
        if i == len(a) or j == len(b):
            return config.gap * (len(a) - i + len(b) - j)
        aligned = config.threshold - np.linalg.norm(a[i] - b[j]) + best(i + 1, j + 1)
        return max(aligned, config.gap + best(i + 1, j), config.gap + best(i, j + 1))

    return best(0, 0) / (config.threshold * max(len(a), len(b)))


@pytest.mark.parametrize("config", [ScanMatchConfig(), ScanMatchConfig(8, 6, 2.0, -0.5)])
def test_scanmatch_is_the_best_of_all_alignments(rng, config):
    first, second = paths(rng, 20, 1), paths(rng, 20, 1)
    expected = [best_alignment(a, b, config) for a, b in zip(first, second, strict=True)]
    np.testing.assert_allclose(scanmatch(first, second, SHAPE, config), expected, rtol=1e-12)


def test_scanmatch_of_equal_far_and_repeated_paths(rng):
    path = GazePath(np.array([[10.0, 10], [400, 300]]), np.array([0.1, 0.3]))
    far = GazePath(np.array([[790.0, 590], [790, 10]]), path.duration)
    np.testing.assert_allclose(scanmatch([path, path], [path, far], SHAPE), [1, 0])
    binned = ScanMatchConfig(time_bin=0.1)
    slow = GazePath(path.xy, np.array([0.1, 0.7]))  # 2 of 4 against 2 of 8 letters are its own
    assert scanmatch([path], [slow], SHAPE)[0] == 1
    assert scanmatch([path], [slow], SHAPE, binned)[0] == pytest.approx(4 / 8)
    unknown = GazePath(path.xy, np.full(2, np.nan))
    with pytest.raises(ImageError, match="duration"):
        scanmatch([unknown], [path], SHAPE, binned)
    with pytest.raises(ImageError, match="at least one"):
        scanmatch([GazePath(np.zeros((0, 2)), np.zeros(0))], [path], SHAPE)
    with pytest.raises(ConfigError, match="gap"):
        ScanMatchConfig(gap=1.0)


def test_the_movements_of_a_path_are_its_own(rng):
    path = GazePath(
        np.array([[0.0, 0], [40, 30], [70, 30], [70, 50]]), np.array([0.1, 0.2, 0.3, 1])
    )
    scores = path_scores(path, paths(rng, 3), SHAPE, ScanMatchConfig())
    assert scores.amplitude == pytest.approx((50 + 30 + 20) / 3)
    assert scores.horizontal == pytest.approx(2 / 3)
    assert (scores.seconds, scores.fixations) == (pytest.approx(0.4), 4)
