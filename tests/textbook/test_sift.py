"""Appendix B against closed forms of blobs and ramps, known quadratics and single gradients."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from saccade.textbook.sift import (
    BASE_SIGMA,
    OCTAVES,
    K,
    build_scale_space,
    descriptor,
    dominant_orientations,
    find_extrema,
    gradient_and_hessian,
    orientation_histogram,
    refine,
    sift,
    value_at,
)
from support.gray_scenes import blob, scene

close = np.testing.assert_allclose


def test_extrema_are_those_of_a_search():
    D = np.random.default_rng(3).integers(0, 60, (5, 14, 12)).astype(float)
    expected = []
    for i, row, column in itertools.product(range(1, 4), range(1, 13), range(1, 11)):
        block = D[i - 1 : i + 2, row - 1 : row + 2, column - 1 : column + 2]
        others = np.delete(block.ravel(), 13)
        if D[i, row, column] > others.max() or D[i, row, column] < others.min():
            expected.append((i, row, column))
    assert len(expected) > 5
    assert sorted(find_extrema(tuple(D))) == expected


def quadratic(constant, g, H):
    """D of a quadratic in (x, y, sigma) about the middle sample of 7 by 7."""
    sigma, y, x = np.mgrid[-1:2, -3:4, -3:4]
    at = np.stack([x, y, sigma], axis=-1).astype(float)
    return tuple(constant + at @ g + 0.5 * np.einsum("...i,ij,...j", at, H, at))


@settings(max_examples=50)
@given(
    arrays.arrays(float, 3, elements=st.floats(-1, 1)),
    arrays.arrays(float, (3, 3), elements=st.floats(-2, 2)),
    st.floats(-3, 3),
    st.sampled_from([1, -1]),
)
def test_the_extremum_of_a_quadratic_is_found_with_its_value(xhat, root, top, sign):
    H = sign * (root @ root.T + 0.5 * np.eye(3))
    D = quadratic(top + 0.5 * xhat @ H @ xhat, -H @ xhat, H)
    gradient, hessian = gradient_and_hessian(D, 1, 3, 3)
    offset = refine(gradient, hessian)
    close(offset, xhat, atol=1e-8)
    assert value_at(D[1][3, 3], gradient, offset) == pytest.approx(top, abs=1e-8)


@pytest.mark.parametrize(
    ("o", "i", "bright"), [(0, 1, True), (0, 2, False), (0, 2.4, True), (1, 1, False), (2, 1, True)]
)
def test_a_blob_is_found_at_its_place_and_scale(o, i, bright):
    # D of a blob of variance t is extreme at sigma^2 = t / k, where it is (K - 1) / (K + 1)
    sigma = BASE_SIGMA * 2 ** (o + i / 3)
    side, x, y = (81, 40.3, 38.8) if o < 2 else (129, 64.6, 61.0)
    image = blob(side, x, y, sigma * math.sqrt(K))
    result = sift(image if bright else 1 - image)
    kept = [each for each in result.candidates if each.status == "kept"]
    best = max(kept, key=lambda each: abs(each.value))
    assert (best.octave, best.i) == (o, round(i))
    peak = (K - 1) / (K + 1)
    assert best.value == pytest.approx(-peak if bright else peak, rel=0.03)
    strongest = int(np.argmax(result.keypoints.response))
    assert result.keypoints.octave[strongest] == o
    close(result.keypoints.xy[strongest], (x, y), atol=0.1 * 2**o)
    assert result.keypoints.size[strongest] == pytest.approx(2 * sigma, rel=0.05)


def test_a_flat_picture_has_no_points_and_a_small_one_fewer_octaves():
    result = sift(np.full((64, 80), 0.3))
    assert result.keypoints.descriptors.shape == (0, 128)
    assert result.descriptions == ()
    small = np.random.default_rng(8).random((8, 8))
    space = build_scale_space(small)
    assert 1 <= len(space) < OCTAVES
    assert min(space[-1][0].shape) >= 3
    sift(small)


def histogram_of(theta, x, y, at=(20.0, 20.0), magnitude=1.0):
    """The orientation histogram of one gradient, about a point of sigma 2."""
    m, angles = np.zeros((41, 41)), np.zeros((41, 41))
    m[y, x], angles[y, x] = magnitude, theta
    return orientation_histogram(m, angles, *at, 2.0)


@pytest.mark.parametrize("b", range(0, 36, 5))
def test_a_gradient_votes_for_the_bin_that_it_lies_in(b):
    for degrees in (10 * b - 4, 10 * b + 4):
        theta = math.remainder(math.radians(degrees), math.tau)
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


def described(L, angle=0.0):
    return descriptor(L, 20.0, 20.0, 1.2, angle)


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


def test_samples_of_the_descriptor_fade_and_its_vector_is_clipped():
    found = described(scene(41, seed=5))
    y, x = np.mgrid[:16, :16] - 7.5
    close(found.weights, np.exp(-(x**2 + y**2) / (2 * 24**2)))
    whole = found.subregions.ravel() / np.linalg.norm(found.subregions)
    assert whole.max() > 0.25
    clipped = whole.clip(max=0.2)
    close(found.vector, clipped / np.linalg.norm(clipped))
