"""Appendix B, detector and results, against closed forms of blobs and known quadratics."""

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
    S,
    build_scale_space,
    descriptor,
    dominant_orientations,
    find_extrema,
    gaussian_kernel,
    gradient_and_hessian,
    gradients,
    orientation_histogram,
    refine,
    sift,
    smooth,
    value_at,
)
from support.gray_scenes import TURN, angle_between, blob, lines

NUMBERS = st.floats(-5, 5)
close = np.testing.assert_allclose


@pytest.mark.parametrize("sigma", [0.5, 1.0, 1.6, 3.7])
def test_kernels_are_gaussians_cut_to_six_sigma_along_rows_and_columns(sigma):
    kernel = gaussian_kernel(sigma)
    reach = len(kernel) // 2
    assert math.floor(3 * sigma) <= reach <= math.ceil(3 * sigma)
    assert kernel.sum() == pytest.approx(1)
    x = np.arange(-reach, reach + 1)
    close(kernel / kernel[reach], np.exp(-(x**2) / (2 * sigma**2)))
    point, expected = np.zeros((41, 37)), np.zeros((41, 37))
    point[20, 18] = 1
    expected[20 - reach : 21 + reach, 18 - reach : 19 + reach] = np.outer(kernel, kernel)
    close(smooth(point, sigma), expected, atol=1e-15)
    close(smooth(np.full((9, 12), 0.3), sigma), 0.3)


def test_octaves_have_six_images_each_filtered_from_the_one_before():
    image = np.random.default_rng(1).random((70, 91))
    space = build_scale_space(image)
    assert (S, OCTAVES) == (3, 3)
    assert pytest.approx(1.25992105) == K
    assert [len(octave) for octave in space] == [6, 6, 6]
    for octave, size in zip(space, [(70, 91), (35, 46), (18, 23)], strict=True):
        assert {level.shape for level in octave} == {size}
    close(space[0][0], smooth(image, BASE_SIGMA))
    for octave, following in itertools.pairwise(space):
        np.testing.assert_array_equal(following[0], octave[3][::2, ::2])
    for octave in space:
        for i in range(1, 6):
            before, after = BASE_SIGMA * 2 ** ((i - 1) / 3), BASE_SIGMA * 2 ** (i / 3)
            close(octave[i], smooth(octave[i - 1], math.sqrt(after**2 - before**2)))


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


def test_fates_follow_from_the_differences(found):
    statuses, saddles = set(), 0
    for result in (found, sift(lines())):
        listed = sorted((each.octave, each.i, each.row, each.column) for each in result.candidates)
        every = enumerate(result.differences)
        assert listed == sorted((o, *place) for o, D in every for place in find_extrema(D))
        for each in result.candidates:
            D = result.differences[each.octave]
            level, y, x = D[each.i], each.row, each.column
            Dxx = level[y, x - 1] + level[y, x + 1] - 2 * level[y, x]
            Dyy = level[y - 1, x] + level[y + 1, x] - 2 * level[y, x]
            across = level[y - 1, x - 1] + level[y + 1, x + 1]
            Dxy = (across - level[y + 1, x - 1] - level[y - 1, x + 1]) / 4
            det = Dxx * Dyy - Dxy**2
            there = np.add(each.offset, (x, y, each.i))
            last = np.subtract((*level.shape[::-1], len(D)), 1)
            if not ((there >= 0) & (there <= last)).all():
                expected = "unstable"
            elif abs(each.value) < 0.02:
                expected = "low contrast"
            else:
                saddles += det <= 0
                expected = "edge" if det <= 0 or (Dxx + Dyy) ** 2 / det >= 12.1 else "kept"
            assert each.status == expected
            if expected != "unstable" and det > 0:
                assert each.curvature_ratio == pytest.approx((Dxx + Dyy) ** 2 / det)
            statuses.add(expected)
    assert statuses == {"kept", "low contrast", "edge", "unstable"}
    assert saddles > 0


def test_keypoints_and_descriptions_are_the_same_points(found):
    points = found.keypoints
    assert len(points) == len(found.descriptions) > 10
    assert points.descriptors.shape == (len(points), 128)
    assert points.descriptors.dtype == np.float32
    kept = {index for index, each in enumerate(found.candidates) if each.status == "kept"}
    assert {each.candidate for each in found.descriptions} == kept
    for row, each in enumerate(found.descriptions):
        origin = found.candidates[each.candidate]
        octave = 2**origin.octave
        assert points.octave[row] == origin.octave
        assert points.response[row] == pytest.approx(abs(origin.value), rel=1e-5)
        sigma = BASE_SIGMA * 2 ** ((origin.i + origin.offset[2]) / 3)
        expected = origin.column + origin.offset[0], origin.row + origin.offset[1], sigma
        assert (each.x, each.y, each.sigma) == pytest.approx(expected)
        close(points.xy[row], (octave * each.x, octave * each.y), rtol=1e-5)
        assert points.size[row] == pytest.approx(2 * octave * each.sigma, rel=1e-5)
        assert angle_between(points.angle[row], each.angle) < 1e-5
        turned = points.descriptors[row].reshape(16, 8)[:, -np.arange(8)]  # from y towards x
        close(turned.ravel(), each.vector, atol=1e-6)


def test_descriptions_are_those_of_the_closest_image(found):
    sigmas = BASE_SIGMA * 2 ** (np.arange(6) / 3)
    for each in found.descriptions[:6]:
        origin = found.candidates[each.candidate]
        L = found.scale_space[origin.octave][int(abs(np.log(sigmas / each.sigma)).argmin())]
        histogram = orientation_histogram(*gradients(L), each.x, each.y, each.sigma)
        close(each.histogram, histogram)
        same = [other for other in found.descriptions if other.candidate == each.candidate]
        angles = sorted(other.angle % TURN for other in same)
        close(angles, sorted(angle % TURN for angle in dominant_orientations(histogram)))
        close(each.vector, descriptor(L, each.x, each.y, each.sigma, each.angle).vector)


def test_a_flat_picture_has_no_points_and_a_small_one_fewer_octaves():
    result = sift(np.full((64, 80), 0.3))
    assert result.keypoints.descriptors.shape == (0, 128)
    assert result.descriptions == ()
    small = np.random.default_rng(8).random((8, 8))
    space = build_scale_space(small)
    assert 1 <= len(space) < OCTAVES
    assert min(space[-1][0].shape) >= 3
    sift(small)
