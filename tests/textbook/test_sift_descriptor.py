"""Appendix B, orientation and descriptor, against ramps, single gradients and invariants."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from saccade.textbook.sift import (
    descriptor,
    dominant_orientations,
    gradients,
    orientation_histogram,
    sample_grid,
)
from support.gray_scenes import TURN, angle_between, ramp, scene

ALWAYS_THE_SAME = settings(derandomize=True, max_examples=50)


# Gradients and orientation


@pytest.mark.parametrize(
    ("a", "b", "theta"),
    [
        (3, 4, 0.92729522),
        (-3, 4, 2.21429744),
        (-3, -4, -2.21429744),
        (3, -4, -0.92729522),
    ],
)
def test_gradients_of_ramps_in_four_quadrants(a, b, theta):
    m, found = gradients(ramp(a, b, side=9))
    assert m.shape == found.shape == (9, 9)
    np.testing.assert_allclose(m[1:-1, 1:-1], 10)
    np.testing.assert_allclose(found[1:-1, 1:-1], theta, atol=1e-8)


def one_gradient(theta, x, y, side=41):
    m, angles = np.zeros((side, side)), np.zeros((side, side))
    m[y, x], angles[y, x] = 1, theta
    return m, angles


@pytest.mark.parametrize("b", range(36))
def test_a_gradient_votes_for_the_bin_that_it_lies_in(b):
    for degrees in (10 * b - 4, 10 * b + 4):
        theta = math.remainder(math.radians(degrees), TURN)
        m, angles = one_gradient(theta, 20, 20)
        histogram = orientation_histogram(m, angles, 20.0, 20.0, 2.0)
        assert histogram.shape == (36,)
        assert np.flatnonzero(histogram).tolist() == [b]


def test_votes_fade_with_the_distance():
    def vote(x, y, magnitude=1.0):
        m, angles = one_gradient(0.1, x, y)
        return orientation_histogram(magnitude * m, angles, 20.0, 20.0, 2.0).sum()

    middle = vote(20, 20)
    assert vote(20, 20, 7.0) == pytest.approx(7 * middle)
    assert vote(23, 20) / middle == pytest.approx(math.exp(-0.5))
    assert vote(20, 17) / middle == pytest.approx(math.exp(-0.5))
    assert vote(22, 22) / middle == pytest.approx(math.exp(-8 / 18))


def test_votes_of_a_point_between_the_samples():
    m, angles = one_gradient(0.1, 22, 20)
    near = orientation_histogram(m, angles, 20.5, 20.0, 2.0).sum()
    far = orientation_histogram(m, angles, 19.5, 20.0, 2.0).sum()
    assert far / near == pytest.approx(math.exp((1.5**2 - 2.5**2) / 18))


def degrees_of(histogram):
    return sorted(math.degrees(angle) % 360 for angle in dominant_orientations(histogram))


def bins(**values):
    histogram = np.zeros(36)
    for name, value in values.items():
        histogram[int(name[1:])] = value
    return histogram


def test_every_bin_over_eighty_percent_is_dominant_even_beside_the_highest():
    first, second = degrees_of(bins(b5=10.0, b6=9.0))
    assert first == pytest.approx(54.0909091)
    assert 54.9 < second < 65
    assert len(degrees_of(bins(b5=10.0, b6=9.0, b7=8.5, b20=8.1))) == 4
    assert degrees_of(bins(b5=10.0, b20=8.1)) == pytest.approx([50, 200])
    assert degrees_of(bins(b5=10.0, b20=8.0)) == pytest.approx([50])


def test_the_parabola_by_hand():
    assert degrees_of(bins(b4=4.0, b5=10.0)) == pytest.approx([48.75])
    assert degrees_of(bins(b4=2.0, b5=10.0, b6=6.0)) == pytest.approx([50 + 5 / 3])
    assert degrees_of(bins(b0=6.0, b1=10.0, b2=6.0)) == pytest.approx([10])
    assert degrees_of(bins(b34=6.0, b35=10.0, b0=4.0)) == pytest.approx([349])


@ALWAYS_THE_SAME
@given(arrays.arrays(float, 36, elements=st.integers(0, 20).map(float)))
def test_refined_orientations_stay_by_their_bins(histogram):
    if histogram.max() == 0:
        return
    expected = np.flatnonzero(histogram > 0.8 * histogram.max())
    found = dominant_orientations(histogram)
    assert len(found) == len(expected)
    assert all(math.isfinite(angle) for angle in found)
    for b in expected:
        nearest = min(angle_between(angle, math.radians(10 * b)) for angle in found)
        assert nearest <= math.radians(10) + 1e-9


def test_the_dominant_orientation_of_a_ramp():
    for degrees in (17, 95, 203, 341):
        turn = math.radians(degrees)
        m, theta = gradients(ramp(math.cos(turn), math.sin(turn)))
        histogram = orientation_histogram(m, theta, 20.0, 20.0, 2.0)
        (angle,) = dominant_orientations(histogram)
        assert angle_between(angle, turn) < math.radians(5)


# Descriptor


def test_the_grid_is_turned_and_scaled_about_the_point():
    upright = sample_grid(30.0, 20.0, 2.0, 0.0)
    assert upright.shape == (16, 16, 2)
    np.testing.assert_allclose(upright.mean(axis=(0, 1)), (30, 20))
    spacing = upright[0, 1, 0] - upright[0, 0, 0]
    assert spacing > 0
    np.testing.assert_allclose(np.diff(upright, axis=1), np.full((16, 15, 2), (spacing, 0)))
    steps = np.full((15, 16, 2), (0, spacing))
    np.testing.assert_allclose(np.diff(upright, axis=0), steps, atol=1e-12)
    wider = sample_grid(30.0, 20.0, 4.0, 0.0)
    np.testing.assert_allclose(wider - (30, 20), 2 * (upright - (30, 20)))
    c, s = math.cos(0.7), math.sin(0.7)
    turned = sample_grid(30.0, 20.0, 2.0, 0.7)
    np.testing.assert_allclose(turned - (30, 20), (upright - (30, 20)) @ [[c, s], [-s, c]])


def described(L, x=20.0, y=20.0, sigma=1.2, angle=0.0):
    return descriptor(L, x, y, sigma, angle)


def planes(degrees, angle=0.0):
    turn = math.radians(degrees)
    return described(ramp(math.cos(turn), math.sin(turn)), angle=angle).subregions


def test_ramps_fill_one_bin_or_share_two_neighbors():
    counts = [np.count_nonzero(planes(degrees)[1, 1] > 1e-9) for degrees in range(0, 360, 15)]
    assert set(counts) <= {1, 2}
    for degrees in range(0, 360, 15):
        subregions = planes(degrees)
        share = subregions / subregions.sum(axis=2, keepdims=True)
        np.testing.assert_allclose(share, np.broadcast_to(share[0, 0], (4, 4, 8)), atol=1e-9)
        following = planes(degrees + 45)
        np.testing.assert_allclose(following, np.roll(subregions, 1, axis=2), atol=1e-9)


def test_bins_share_by_the_angular_distance():
    start = next(
        degrees for degrees in (0, 22.5) if np.count_nonzero(planes(degrees)[1, 1] > 1e-9) == 1
    )
    whole = planes(start)[1, 1]
    full = int(whole.argmax())
    for step in (9, 22.5, 36):
        shared = planes(start + step)[1, 1] / whole[full]
        assert shared[full] == pytest.approx(1 - step / 45)
        assert shared[(full + 1) % 8] == pytest.approx(step / 45)


def test_the_grid_and_its_gradients_turn_together():
    expected = planes(10)
    for angle in (0.5, 2.0, -1.3):
        np.testing.assert_allclose(planes(10 + math.degrees(angle), angle), expected, rtol=1e-6)


def test_the_window_is_one_and_a_half_times_the_neighborhood():
    found = described(ramp(1.0, 0.0))
    # at 7.5 and 0.5 samples from the middle, of a Gaussian of 1.5 times 16 samples
    assert found.weights[0, 0] / found.weights[7, 7] == pytest.approx(0.9073543, rel=1e-6)
    assert found.weights[0, 7] / found.weights[7, 7] == pytest.approx(0.9525515, rel=1e-6)
    np.testing.assert_allclose(found.weights, found.weights[::-1, ::-1])


def test_subregions_are_sums_over_samples_by_distance(found):
    start = 0 if np.count_nonzero(planes(0)[1, 1] > 1e-9) == 1 else 22.5
    first = int(planes(start)[1, 1].argmax())
    for each in found.descriptions[:4]:
        expected = np.zeros((4, 4, 8))
        votes = each.magnitudes * each.weights
        degrees = np.degrees(each.orientations)
        for row in range(16):
            for column in range(16):
                for R in range(4):
                    for C in range(4):
                        away = math.hypot(row - (1.5 + 4 * R), column - (1.5 + 4 * C)) / 4
                        near = max(0.0, 1 - away)
                        for b in range(8):
                            center = start + 45 * (b - first)
                            apart = abs((degrees[row, column] - center + 180) % 360 - 180) / 45
                            share = near * max(0.0, 1 - apart)
                            expected[R, C, b] += votes[row, column] * share
        np.testing.assert_allclose(each.subregions, expected, atol=1e-9)


def test_vectors_are_normalized_cut_and_normalized(found):
    cut = 0
    for each in found.descriptions:
        unit = each.subregions.ravel() / np.linalg.norm(each.subregions)
        cut += int((unit > 0.2).any())
        clipped = np.minimum(unit, 0.2)
        np.testing.assert_allclose(each.vector, clipped / np.linalg.norm(clipped), atol=1e-12)
        assert np.linalg.norm(each.vector) == pytest.approx(1)
    assert cut > 0


def test_samples_are_gradients_of_their_places():
    y, x = np.mgrid[:61, :61] / 10
    L = np.sin(x) * np.cos(0.7 * y)
    found = described(L, 30.0, 30.0, 1.0, 0.4)
    np.testing.assert_allclose(found.grid, sample_grid(30.0, 30.0, 1.0, 0.4))
    at_x, at_y = found.grid[..., 0] / 10, found.grid[..., 1] / 10
    along_x = 0.2 * np.cos(at_x) * np.cos(0.7 * at_y)
    along_y = -0.2 * 0.7 * np.sin(at_x) * np.sin(0.7 * at_y)
    expected = np.hypot(along_x, along_y)
    np.testing.assert_allclose(found.magnitudes, expected, atol=0.02)
    clear = expected > 0.05
    apart = found.orientations - (np.arctan2(along_y, along_x) - 0.4)
    assert abs(np.angle(np.exp(1j * apart)))[clear].max() < 0.25


def test_a_quarter_turn_permutes_the_descriptor():
    L = scene(41, seed=5)
    upright = described(L).subregions
    # row, column -> 40 - column, row: counter-clockwise on the screen, from y towards x
    turned = described(np.rot90(L)).subregions
    expected = np.roll(np.rot90(upright), -2, axis=2)
    np.testing.assert_allclose(turned, expected, atol=1e-6 * upright.max())
    with_it = described(np.rot90(L), angle=-math.pi / 2).subregions
    np.testing.assert_allclose(with_it, upright, atol=1e-6 * upright.max())


def test_light_does_not_change_the_descriptor():
    L = scene(41, seed=6)
    np.testing.assert_allclose(described(0.4 * L + 0.3).vector, described(L).vector, atol=1e-12)
