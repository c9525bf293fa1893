"""The scanpath model against its formula, its own samples, and closed forms."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import chisquare, kstest

import saccade
import saccade.scale.pyramid
from saccade.attention import scanpath_model
from saccade.attention.maps import SaliencyMaps
from saccade.attention.scanpath_model import ScanpathModelConfig
from saccade.errors import ConfigError, ImageError

SHAPE = (60, 80)
CONFIG = ScanpathModelConfig(
    exponent=1.3,
    floor=0.1,
    center_sigma=0.4,
    amplitude_scale=0.1,
    amplitude_exponent=0.8,
    horizontal=0.3,
    persistence=-0.4,
    inhibition=0.8,
    inhibition_sigma=0.15,
    inhibition_decay=0.6,
)
PAST = np.array([[10.0, 50.0], [30.5, 41.0], [50.0, 12.0]])


@pytest.fixture
def saliency():
    return np.random.default_rng(5).random((6, 8)) ** 2


def density_by_the_formula(saliency, past, config=CONFIG):
    """The next fixation's density cell by cell, as the module's docstring has it."""
    h, w = saliency.shape
    side, c = max(SHAPE), config
    history = [((x + 0.5) / side, (y + 0.5) / side) for x, y in past]
    values = np.empty((h, w))
    for row in range(h):
        for column in range(w):
            u, v = (column + 0.5) / w, (row + 0.5) / h
            x, y = u * SHAPE[1] / side, v * SHAPE[0] / side
            value = (saliency[row, column] / saliency.max() + c.floor) ** c.exponent
            value *= np.exp(-((u - 0.5) ** 2 + (v - 0.5) ** 2) / (2 * c.center_sigma**2))
            dx, dy = x - history[-1][0], y - history[-1][1]
            value *= (1 + np.hypot(dx, dy) ** 2 / c.amplitude_scale**2) ** -c.amplitude_exponent
            value *= 1 + c.horizontal * np.cos(2 * np.arctan2(dy, dx))
            if len(history) > 1:
                before = np.subtract(history[-1], history[-2])
                turn = np.arctan2(dy, dx) - np.arctan2(before[1], before[0])
                value *= 1 + c.persistence * np.cos(turn)
            for age, (px, py) in enumerate(reversed(history)):
                squared = (x - px) ** 2 + (y - py) ** 2
                strength = c.inhibition * c.inhibition_decay**age
                value *= 1 - strength * np.exp(-squared / (2 * c.inhibition_sigma**2))
            values[row, column] = value
    return values / values.sum()


@pytest.mark.kernel
@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_density_is_the_formula(saliency, count):
    found = saccade.next_fixation_density(SaliencyMaps(saliency, SHAPE), PAST[:count], CONFIG)
    np.testing.assert_allclose(found, density_by_the_formula(saliency, PAST[:count]), rtol=1e-9)


@pytest.mark.parametrize("max_trials", [0, 3, 400])
def test_samples_have_the_density(saliency, monkeypatch, max_trials):
    """Whether all, some or none of them are accepted proposals; the second fixation, too."""
    monkeypatch.setattr(scanpath_model, "MAX_REJECTIONS", max_trials)
    count, start, maps = 40_000, (20.0, 30.0), SaliencyMaps(saliency, SHAPE)
    paths = saccade.sample_scanpaths(maps, CONFIG, count=count, fixations=2, seed=7, start=start).xy
    first = density_by_the_formula(saliency, [start])
    assert chisquare(counts(paths[:, 0]), count * first.ravel()).pvalue > 1e-3
    expected = np.zeros(first.shape)
    for path in paths[:400]:
        expected += saccade.next_fixation_density(maps, [start, path[0]], CONFIG) / 400
    assert np.abs(counts(paths[:, 1]) / count - expected.ravel()).sum() < 0.1


def test_the_most_probable_path_is_the_best_of_all(saliency):
    """Of all paths of three fixations, by the likelihood of each, if the beam holds them all."""
    small = SaliencyMaps(saliency[:3, :4], (30, 40))
    centers = [(10 * column + 4.5, 10 * row + 4.5) for row in range(3) for column in range(4)]
    paths = list(product(centers, repeat=3))
    logs = [saccade.scanpath_log_likelihood(small, path, CONFIG).sum() for path in paths]
    found = saccade.most_probable_scanpath(small, CONFIG, fixations=3, beam=len(paths))
    np.testing.assert_allclose(found.xy, paths[int(np.argmax(logs))])
    np.testing.assert_allclose(found.time, 0.217 * np.array([1, 2, 3]))
    narrow = saccade.most_probable_scanpath(small, CONFIG, fixations=3, beam=3)
    log = saccade.scanpath_log_likelihood(small, narrow.xy, CONFIG).sum()
    assert log >= np.percentile(logs, 99)


def test_the_most_probable_path_goes_to_the_peaks_of_a_large_map():
    saliency = np.zeros((60, 80))
    saliency[15, 61], saliency[44, 22] = 1.0, 0.9
    maps = SaliencyMaps(saliency, (600, 800))
    path = saccade.most_probable_scanpath(maps, fixations=4)
    peaks = saccade.scale.pyramid.cell_centers([15, 44], [61, 22], saliency.shape, (600, 800))
    assert {*map(tuple, path.xy)} >= {*map(tuple, peaks)}
    assert len(saccade.most_probable_scanpath(maps, fixations=0)) == 0
    narrow = ScanpathModelConfig(center_sigma=0.01)
    (fixation,) = saccade.most_probable_scanpath(maps, narrow, fixations=1).xy
    assert np.abs(fixation - (399.5, 299.5)).max() < 40  # a cell of the search, of 4 x 10 pixels


def counts(xy):
    """Points in each cell of a map of 6 x 8 cells, row by row."""
    edges = np.linspace(-0.5, 59.5, 7), np.linspace(-0.5, 79.5, 9)
    return np.histogram2d(xy[:, 1], xy[:, 0], edges)[0].ravel()


def test_the_likelihood_is_the_product_of_the_densities(saliency):
    start, cells = (5.0, 5.0), [(5, 1), (4, 3), (1, 5)]
    logs = saccade.scanpath_log_likelihood(SaliencyMaps(saliency, SHAPE), PAST, CONFIG, start=start)
    for k, cell in enumerate(cells):
        past = np.vstack([[start], PAST[:k]])
        expected = density_by_the_formula(saliency, past)[cell] / 100  # pixels to a cell
        assert logs[k] == pytest.approx(np.log(expected))
    everywhere = ScanpathModelConfig(
        exponent=0.0,
        center_sigma=None,
        amplitude_exponent=0.0,
        horizontal=0.0,
        persistence=0.0,
        inhibition=0.0,
    )
    logs = saccade.scanpath_log_likelihood(SaliencyMaps(saliency, SHAPE), PAST, everywhere)
    np.testing.assert_allclose(logs, -np.log(60 * 80))


def test_durations_are_gamma_distributed_and_times_their_sums(saliency):
    config = ScanpathModelConfig(duration_mean=0.3, duration_shape=4.0)
    drawn = saccade.sample_scanpaths(SaliencyMaps(saliency, SHAPE), config, count=2000, fixations=5)
    assert kstest(drawn.duration.ravel(), "gamma", (4.0, 0, 0.075)).pvalue > 1e-3
    np.testing.assert_allclose(np.diff(drawn.time), drawn.duration[:, :-1])
    assert (drawn.time[:, 0] > 0).all()
    path = drawn[3]
    np.testing.assert_array_equal(path.time, drawn.time[3])
    assert repr(drawn) == "ScanpathSamples(2000 paths of 5 fixations)"
    assert len(path) == 5


def test_equal_seeds_give_equal_paths_whatever_the_count(saliency):
    maps = SaliencyMaps(saliency, SHAPE)
    few = saccade.sample_scanpaths(maps, CONFIG, count=5, fixations=4, seed=3)
    many = saccade.sample_scanpaths(maps, CONFIG, count=50, fixations=4, seed=3)
    for name in ("xy", "time", "duration", "saliency"):
        np.testing.assert_array_equal(getattr(few, name), getattr(many, name)[:5])
    other = saccade.sample_scanpaths(maps, CONFIG, count=5, fixations=4, seed=4)
    assert (few.xy != other.xy).any()


def test_an_empty_map_and_no_paths():
    flat = saccade.sample_scanpaths(SaliencyMaps(np.zeros((6, 8)), SHAPE), count=4, fixations=3)
    assert flat.xy.shape == (4, 3, 2)
    even = SaliencyMaps(np.ones((6, 8)), SHAPE)
    assert len(saccade.sample_scanpaths(even, count=0, fixations=3)) == 0
    assert saccade.sample_scanpaths(even, count=2, fixations=0).xy.shape == (2, 0, 2)
    lone = np.zeros((6, 8))
    lone[2, 3] = 1
    stuck = ScanpathModelConfig(exponent=20.0, floor=1e-9, inhibition=0.999)
    assert np.isfinite(
        saccade.sample_scanpaths(SaliencyMaps(lone, SHAPE), stuck, count=20).xy
    ).all()


def test_broken_arguments_are_named(saliency):
    with pytest.raises(ImageError, match="inside 80 x 60"):
        saccade.next_fixation_density(SaliencyMaps(saliency, SHAPE), [(90, 5)])
    with pytest.raises(ImageError, match="shape"):
        saccade.next_fixation_density(SaliencyMaps(saliency, SHAPE), np.zeros((0, 2)))
    with pytest.raises(ImageError, match="swapped"):
        saccade.sample_scanpaths(SaliencyMaps(saliency, SHAPE[::-1]))
    with pytest.raises(ConfigError, match="count"):
        saccade.sample_scanpaths(SaliencyMaps(saliency, SHAPE), count=-1)
    with pytest.raises(ConfigError, match="persistence"):
        ScanpathModelConfig(persistence=1.0)
    with pytest.raises(ConfigError, match="center_sigma"):
        ScanpathModelConfig(center_sigma=0.0)
