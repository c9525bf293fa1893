"""Appendix B, orientation and descriptor, against ramps, single gradients and invariants."""

import math

import numpy as np
import pytest

from saccade.textbook.sift import (
    descriptor,
    dominant_orientations,
    gradients,
    orientation_histogram,
    sample_grid,
)
from support.gray_scenes import TURN, ramp, scene

close = np.testing.assert_allclose


@pytest.mark.parametrize(("a", "b"), [(3, 4), (-3, 4), (-3, -4), (3, -4)])
def test_gradients_of_ramps_in_four_quadrants(a, b):
    m, found = gradients(ramp(a, b, side=9))
    assert m.shape == found.shape == (9, 9)
    close(m[1:-1, 1:-1], 10)
    close(found[1:-1, 1:-1], math.atan2(b, a), atol=1e-8)


def histogram_of(theta, x, y, at=(20.0, 20.0), magnitude=1.0):
    """The orientation histogram of one gradient, about a point of sigma 2."""
    m, angles = np.zeros((41, 41)), np.zeros((41, 41))
    m[y, x], angles[y, x] = magnitude, theta
    return orientation_histogram(m, angles, *at, 2.0)


@pytest.mark.parametrize("b", range(0, 36, 5))
def test_a_gradient_votes_for_the_bin_that_it_lies_in(b):
    for degrees in (10 * b - 4, 10 * b + 4):
        theta = math.remainder(math.radians(degrees), TURN)
        histogram = histogram_of(theta, 20, 20)
        assert histogram.shape == (36,)
        assert np.flatnonzero(histogram).tolist() == [b]


@pytest.mark.parametrize(
    ("x", "y", "at", "magnitude", "share"),
    [
        (20, 20, (20.0, 20.0), 7.0, 7.0),
        (23, 20, (20.0, 20.0), 1.0, math.exp(-9 / 18)),
        (20, 17, (20.0, 20.0), 1.0, math.exp(-9 / 18)),
        (22, 22, (20.0, 20.0), 1.0, math.exp(-8 / 18)),
        (22, 20, (20.5, 20.0), 1.0, math.exp(-2.25 / 18)),
    ],
)
def test_votes_fade_with_the_distance(x, y, at, magnitude, share):
    middle = histogram_of(0.1, 20, 20).sum()
    assert histogram_of(0.1, x, y, at, magnitude).sum() / middle == pytest.approx(share)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({5: 10.0, 20: 8.1}, [50, 200]),
        ({5: 10.0, 20: 8.0}, [50]),  # of eighty percent and no more
        ({4: 4.0, 5: 10.0}, [48.75]),
        ({4: 2.0, 5: 10.0, 6: 6.0}, [50 + 5 / 3]),
        ({0: 6.0, 1: 10.0, 2: 6.0}, [10]),
        ({34: 6.0, 35: 10.0, 0: 4.0}, [349]),
    ],
)
def test_every_bin_over_eighty_percent_is_dominant_where_its_parabola_is_highest(values, expected):
    histogram = np.zeros(36)
    histogram[list(values)] = list(values.values())
    found = sorted(math.degrees(angle) % 360 for angle in dominant_orientations(histogram))
    assert found == pytest.approx(expected)


def test_the_grid_is_turned_and_scaled_about_the_point():
    upright = sample_grid(30.0, 20.0, 2.0, 0.0)
    assert upright.shape == (16, 16, 2)
    close(upright.mean(axis=(0, 1)), (30, 20))
    spacing = upright[0, 1, 0] - upright[0, 0, 0]
    assert spacing > 0
    close(np.diff(upright, axis=1), np.full((16, 15, 2), (spacing, 0)))
    close(np.diff(upright, axis=0), np.full((15, 16, 2), (0, spacing)), atol=1e-12)
    close(sample_grid(30.0, 20.0, 4.0, 0.0) - (30, 20), 2 * (upright - (30, 20)))
    c, s = math.cos(0.7), math.sin(0.7)
    turned = sample_grid(30.0, 20.0, 2.0, 0.7)
    close(turned - (30, 20), (upright - (30, 20)) @ [[c, s], [-s, c]])


def described(L, x=20.0, y=20.0, sigma=1.2, angle=0.0):
    return descriptor(L, x, y, sigma, angle)


def planes(degrees, angle=0.0):
    turn = math.radians(degrees)
    return described(ramp(math.cos(turn), math.sin(turn)), angle=angle).subregions


def full_bin():
    """The first bin that a ramp fills alone, and the direction of the ramp in degrees."""
    start = 0 if np.count_nonzero(planes(0)[1, 1] > 1e-9) == 1 else 22.5
    return int(planes(start)[1, 1].argmax()), start


def test_the_window_is_one_and_a_half_times_the_neighborhood():
    found = described(ramp(1.0, 0.0))
    # at 7.5 and 0.5 samples from the middle, of a Gaussian of 1.5 times 16 samples
    assert found.weights[0, 0] / found.weights[7, 7] == pytest.approx(0.9073543, rel=1e-6)
    assert found.weights[0, 7] / found.weights[7, 7] == pytest.approx(0.9525515, rel=1e-6)
    close(found.weights, found.weights[::-1, ::-1])


def test_subregions_are_sums_over_samples_by_distance(found):
    first, start = full_bin()
    places, bins = 1.5 + 4 * np.arange(4), start + 45 * (np.arange(8) - first)
    rows, columns = np.mgrid[:16, :16]
    for each in found.descriptions[:4]:
        votes = each.magnitudes * each.weights
        expected = np.zeros((4, 4, 8))
        for R, C, b in np.ndindex(4, 4, 8):
            away = np.hypot(rows - places[R], columns - places[C]) / 4
            apart = abs((np.degrees(each.orientations) - bins[b] + 180) % 360 - 180) / 45
            share = np.maximum(0, 1 - away) * np.maximum(0, 1 - apart)
            expected[R, C, b] = (votes * share).sum()
        close(each.subregions, expected, atol=1e-9)


def test_vectors_are_normalized_cut_and_normalized(found):
    cut = 0
    for each in found.descriptions:
        unit = each.subregions.ravel() / np.linalg.norm(each.subregions)
        cut += int((unit > 0.2).any())
        clipped = np.minimum(unit, 0.2)
        close(each.vector, clipped / np.linalg.norm(clipped), atol=1e-12)
    assert cut > 0


def test_samples_are_gradients_of_their_places():
    y, x = np.mgrid[:61, :61] / 10
    found = described(np.sin(x) * np.cos(0.7 * y), 30.0, 30.0, 1.0, 0.4)
    close(found.grid, sample_grid(30.0, 30.0, 1.0, 0.4))
    at_x, at_y = found.grid[..., 0] / 10, found.grid[..., 1] / 10
    along_x = 0.2 * np.cos(at_x) * np.cos(0.7 * at_y)
    along_y = -0.2 * 0.7 * np.sin(at_x) * np.sin(0.7 * at_y)
    expected = np.hypot(along_x, along_y)
    close(found.magnitudes, expected, atol=0.02)
    apart = found.orientations - (np.arctan2(along_y, along_x) - 0.4)
    assert abs(np.angle(np.exp(1j * apart)))[expected > 0.05].max() < 0.25


def test_a_quarter_turn_permutes_the_descriptor_and_light_does_not_change_it():
    L = scene(41, seed=5)
    upright = described(L)
    # row, column -> 40 - column, row: counter-clockwise on the screen, from y towards x
    turned = described(np.rot90(L)).subregions
    atol = 1e-6 * upright.subregions.max()
    close(turned, np.roll(np.rot90(upright.subregions), -2, axis=2), atol=atol)
    with_it = described(np.rot90(L), angle=-math.pi / 2).subregions
    close(with_it, upright.subregions, atol=atol)
    close(described(0.4 * L + 0.3).vector, upright.vector, atol=1e-12)
