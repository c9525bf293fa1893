"""Appendix B, detector and results, against closed forms of blobs and known quadratics."""

import itertools
import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from saccade.errors import ImageError
from saccade.textbook.sift import (
    BASE_SIGMA,
    OCTAVES,
    K,
    S,
    build_scale_space,
    curvature_ratio,
    descriptor,
    differences,
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
from support.gray_scenes import TURN, angle_between, blob, lines, scene

ALWAYS_THE_SAME = settings(derandomize=True, max_examples=50)
FATES = {"kept", "low contrast", "edge", "unstable"}


def blurred(t, v):
    """Height of a blob of variance t and height 1 after a blur of variance v."""
    return t / (t + v)


# Gaussians


def test_the_kernel_of_sigma_one():
    expected = [0.00443305, 0.05400558, 0.24203623, 0.39905028]
    expected += expected[2::-1]
    np.testing.assert_allclose(gaussian_kernel(1.0), expected, atol=1e-8)


@pytest.mark.parametrize("sigma", [0.5, 1.0, 1.6, 2.0, 3.7])
def test_kernels_are_gaussians_cut_to_six_sigma(sigma):
    kernel = gaussian_kernel(sigma)
    reach = len(kernel) // 2
    assert len(kernel) % 2 == 1
    assert math.floor(3 * sigma) <= reach <= math.ceil(3 * sigma)
    assert kernel.sum() == pytest.approx(1)
    x = np.arange(-reach, reach + 1)
    np.testing.assert_allclose(kernel / kernel[reach], np.exp(-(x**2) / (2 * sigma**2)))


def test_smoothing_runs_the_kernel_along_rows_and_columns():
    point = np.zeros((41, 37))
    point[20, 18] = 1
    kernel = gaussian_kernel(2.0)
    found = smooth(point, 2.0)
    expected = np.zeros((41, 37))
    expected[14:27, 12:25] = np.outer(kernel, kernel)
    np.testing.assert_allclose(found, expected, atol=1e-15)
    y, x = np.mgrid[-6:7, -6:7]
    in_two = np.exp(-(x**2 + y**2) / 8) / (8 * math.pi)
    np.testing.assert_allclose(found[14:27, 12:25], in_two / in_two.sum(), atol=1e-15)
    np.testing.assert_allclose(smooth(np.full((9, 12), 0.3), 1.6), 0.3)


@pytest.mark.parametrize(("wide", "sigma"), [(2.0, 1.6), (3.0, 3.2), (4.0, 2.0)])
def test_a_blurred_blob_is_a_wider_and_lower_blob(wide, sigma):
    found = smooth(blob(81, 40, 40, wide), sigma)
    after = math.hypot(wide, sigma)
    expected = blurred(wide**2, sigma**2) * blob(81, 40, 40, after)
    np.testing.assert_allclose(found, expected, atol=0.015)


# Scale space


def test_octaves_have_six_images_and_halve():
    image = np.random.default_rng(1).random((70, 91))
    space = build_scale_space(image)
    assert (S, OCTAVES) == (3, 3)
    assert pytest.approx(1.25992105) == K
    assert [len(octave) for octave in space] == [6, 6, 6]
    sizes = [(70, 91), (35, 46), (18, 23)]
    for octave, size in zip(space, sizes, strict=True):
        assert {level.shape for level in octave} == {size}
    for octave, following in itertools.pairwise(space):
        np.testing.assert_array_equal(following[0], octave[3][::2, ::2])


def test_each_image_is_filtered_from_the_one_before():
    image = np.random.default_rng(2).random((64, 64))
    space = build_scale_space(image)
    np.testing.assert_allclose(space[0][0], smooth(image, BASE_SIGMA))
    for octave in space:
        for i in range(1, 6):
            before, after = BASE_SIGMA * 2 ** ((i - 1) / 3), BASE_SIGMA * 2 ** (i / 3)
            missing = math.sqrt(after**2 - before**2)
            np.testing.assert_allclose(octave[i], smooth(octave[i - 1], missing))


def test_every_image_has_the_blur_that_its_place_says():
    wide = 8.0
    space = build_scale_space(blob(161, 80, 80, wide))
    for o, octave in enumerate(space):
        for i, level in enumerate(octave):
            sigma = BASE_SIGMA * 2 ** (o + i / 3)
            middle = level[80 >> o, 80 >> o]
            assert middle == pytest.approx(blurred(wide**2, sigma**2), rel=0.03)


def test_differences_are_of_neighbors_finer_from_coarser():
    octave = tuple(np.full((4, 4), value) for value in (1.0, 3.0, 4.0, 9.0, 9.0, 2.0))
    found = differences(octave)
    assert [float(each[0, 0]) for each in found] == [2, 1, 5, 0, -7]


# Extrema


def test_extrema_of_planted_values():
    D = np.zeros((5, 9, 9))
    D[1, 4, 4], D[2, 2, 6], D[3, 6, 2] = 1, -1, 0.5
    assert sorted(find_extrema(tuple(D))) == [(1, 4, 4), (2, 2, 6), (3, 6, 2)]


@pytest.mark.parametrize(
    "place", [(0, 4, 4), (4, 4, 4), (2, 0, 4), (2, 8, 4), (2, 4, 0), (2, 4, 8)]
)
def test_extrema_need_all_26_neighbors(place):
    D = np.zeros((5, 9, 9))
    D[place] = 1
    assert find_extrema(tuple(D)) == []


@pytest.mark.parametrize("neighbor", [(2, 4, 5), (2, 5, 5), (1, 4, 4), (3, 3, 5), (1, 5, 3)])
@pytest.mark.parametrize("sign", [1, -1])
def test_extrema_are_strict(neighbor, sign):
    D = np.zeros((5, 9, 9))
    D[2, 4, 4] = D[neighbor] = sign
    assert find_extrema(tuple(D)) == []


def test_extrema_are_those_of_a_search():
    D = np.random.default_rng(3).integers(0, 60, (5, 14, 12)).astype(float)
    expected = []
    for i in range(1, 4):
        for row in range(1, 13):
            for column in range(1, 11):
                block = D[i - 1 : i + 2, row - 1 : row + 2, column - 1 : column + 2]
                others = np.delete(block.ravel(), 13)
                middle = D[i, row, column]
                if middle > others.max() or middle < others.min():
                    expected.append((i, row, column))
    assert len(expected) > 5
    assert sorted(find_extrema(tuple(D))) == expected


# Localization


def quadratic(constant, g, H, size=7):
    """D of a quadratic in (x, y, sigma) about the middle sample."""
    middle = size // 2
    sigma, y, x = np.mgrid[-1:2, -middle : middle + 1, -middle : middle + 1]
    at = np.stack([x, y, sigma], axis=-1).astype(float)
    return tuple(constant + at @ g + 0.5 * np.einsum("...i,ij,...j", at, H, at))


NUMBERS = st.floats(-5, 5)


@ALWAYS_THE_SAME
@given(
    NUMBERS,
    arrays.arrays(float, 3, elements=NUMBERS),
    arrays.arrays(float, (3, 3), elements=NUMBERS),
)
def test_derivatives_of_a_quadratic_are_exact(constant, g, root):
    H = root + root.T
    gradient, hessian = gradient_and_hessian(quadratic(constant, g, H), 1, 3, 3)
    np.testing.assert_allclose(gradient, g, atol=1e-11)
    np.testing.assert_allclose(hessian, H, atol=1e-11)


def test_second_derivatives_of_x_squared_and_xy():
    y, x = np.mgrid[:7, :7].astype(float)
    flat = np.zeros((7, 7))
    for level, expected in (
        (x**2, [[2, 0], [0, 0]]),
        (y**2, [[0, 0], [0, 2]]),
        (x * y, [[0, 1], [1, 0]]),
        (x + 3 * y, [[0, 0], [0, 0]]),
    ):
        _, hessian = gradient_and_hessian((flat, level, flat), 1, 2, 4)
        np.testing.assert_allclose(hessian[:2, :2], expected, atol=1e-12)


@ALWAYS_THE_SAME
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
    np.testing.assert_allclose(offset, xhat, atol=1e-8)
    assert value_at(D[1][3, 3], gradient, offset) == pytest.approx(top, abs=1e-8)


def test_refinement_by_hand():
    gradient, hessian = np.array([1.0, -2.0, 0.5]), np.diag([-4.0, -5.0, -2.0])
    np.testing.assert_allclose(refine(gradient, hessian), [0.25, -0.4, 0.25])
    value = value_at(0.1, gradient, np.array([0.25, -0.4, 0.25]))
    assert value == pytest.approx(0.1 + 0.125 + 0.4 + 0.0625)


@pytest.mark.parametrize(
    ("hessian", "ratio"),
    [
        ([[1, 0], [0, 1]], 4.0),
        ([[-1, 0], [0, -1]], 4.0),
        ([[10, 0], [0, 1]], 12.1),
        ([[-9, 0], [0, -1]], 100 / 9),
        ([[2, 1], [1, 2]], 16 / 3),
    ],
)
def test_the_ratio_of_curvatures(hessian, ratio):
    whole = np.eye(3)
    whole[:2, :2] = hessian
    assert curvature_ratio(whole) == pytest.approx(ratio)


# Blobs, whose D is known


@pytest.mark.parametrize("bright", [True, False])
@pytest.mark.parametrize(("o", "i"), [(0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (2, 1)])
def test_a_blob_is_found_at_its_place_and_scale(o, i, bright):
    # D of a blob of variance t is extreme at sigma^2 = t / k, where it is (K - 1) / (K + 1)
    sigma = BASE_SIGMA * 2 ** (o + i / 3)
    wide = sigma * math.sqrt(K)
    side, x, y = (81, 40.3, 38.8) if o < 2 else (129, 64.6, 61.0)
    image = blob(side, x, y, wide)
    result = sift(image if bright else 1 - image)
    kept = [each for each in result.candidates if each.status == "kept"]
    best = max(kept, key=lambda each: abs(each.value))
    assert (best.octave, best.i) == (o, i)
    peak = (K - 1) / (K + 1)
    assert best.value == pytest.approx(-peak if bright else peak, rel=0.03)
    strongest = int(np.argmax(result.keypoints.response))
    assert result.keypoints.octave[strongest] == o
    np.testing.assert_allclose(result.keypoints.xy[strongest], (x, y), atol=0.1 * 2**o)
    assert result.keypoints.size[strongest] == pytest.approx(2 * sigma, rel=0.04)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_scales_between_the_images_are_found(share):
    sigma = BASE_SIGMA * 2 ** ((1 + share) / 3)
    result = sift(blob(81, 40, 40, sigma * math.sqrt(K)))
    strongest = int(np.argmax(result.keypoints.response))
    assert result.keypoints.size[strongest] == pytest.approx(2 * sigma, rel=0.05)


@pytest.mark.parametrize(("contrast", "status"), [(0.019, "low contrast"), (0.021, "kept")])
def test_contrast_on_either_side_of_two_hundredths(contrast, status):
    wide = BASE_SIGMA * 2 ** (2 / 3) * math.sqrt(K)
    amplitude = contrast * (K + 1) / (K - 1)
    result = sift(blob(65, 32, 32, wide, background=0.4, amplitude=amplitude))
    middle = [each for each in result.candidates if each.octave == 0]
    best = max(middle, key=lambda each: abs(each.value))
    assert abs(best.value) == pytest.approx(contrast, rel=0.03)
    assert best.status == status


@pytest.mark.parametrize(("stretch", "status"), [(1.0, "kept"), (3.5, "kept"), (3.6, "edge")])
def test_long_blobs_are_edges(stretch, status):
    result = sift(blob(97, 48, 48, 2.6 * stretch, 2.6))
    near = [
        each
        for each in result.candidates
        if each.octave == 0 and abs(each.row - 48) <= 1 and abs(each.column - 48) <= 1
    ]
    assert [each.status for each in near] == [status]
    assert (near[0].curvature_ratio < 12.1) == (status == "kept")
    # a blurred blob bends along each axis by its height over its variance there
    v, a, b = (BASE_SIGMA * 2 ** (near[0].i / 3)) ** 2, (2.6 * stretch) ** 2, 2.6**2
    fine, coarse = math.sqrt((a + v) * (b + v)), math.sqrt((a + K**2 * v) * (b + K**2 * v))
    Dxx, Dyy = (1 / fine / (t + v) - 1 / coarse / (t + K**2 * v) for t in (a, b))
    assert near[0].curvature_ratio == pytest.approx((Dxx + Dyy) ** 2 / (Dxx * Dyy), rel=0.05)


def test_fates_follow_from_the_differences(found):
    statuses, saddles = set(), 0
    for result in (found, sift(lines())):
        for each in result.candidates:
            D = result.differences[each.octave]
            assert (each.i, each.row, each.column) in find_extrema(D)
            level, y, x = D[each.i], each.row, each.column
            Dxx = level[y, x - 1] + level[y, x + 1] - 2 * level[y, x]
            Dyy = level[y - 1, x] + level[y + 1, x] - 2 * level[y, x]
            across = level[y - 1, x - 1] + level[y + 1, x + 1]
            Dxy = (across - level[y + 1, x - 1] - level[y - 1, x + 1]) / 4
            det = Dxx * Dyy - Dxy**2
            statuses.add(each.status)
            last = np.subtract((*level.shape[::-1], len(D)), 1)
            there = np.add(each.offset, (x, y, each.i))
            inside = bool(((there >= 0) & (there <= last)).all())
            assert (each.status == "unstable") == (not inside)
            if not inside:
                continue
            saddles += det <= 0 and abs(each.value) >= 0.02
            if abs(each.value) < 0.02:
                assert each.status == "low contrast"
            elif det <= 0 or (Dxx + Dyy) ** 2 / det >= 12.1:
                assert each.status == "edge"
            else:
                assert each.status == "kept"
            if det > 0:
                assert each.curvature_ratio == pytest.approx((Dxx + Dyy) ** 2 / det)
    assert statuses == FATES
    assert saddles > 0


def test_every_extremum_is_a_candidate(found):
    expected = [
        (octave, *place) for octave, D in enumerate(found.differences) for place in find_extrema(D)
    ]
    listed = [(each.octave, each.i, each.row, each.column) for each in found.candidates]
    assert sorted(listed) == sorted(expected)


# The whole


def test_keypoints_and_descriptions_are_the_same_points(found):
    points = found.keypoints
    assert len(points) == len(found.descriptions) > 10
    assert points.descriptors.shape == (len(points), 128)
    assert points.descriptors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(points.descriptors, axis=1), 1, atol=1e-6)
    kept = {index for index, each in enumerate(found.candidates) if each.status == "kept"}
    assert {each.candidate for each in found.descriptions} == kept
    for row, each in enumerate(found.descriptions):
        origin = found.candidates[each.candidate]
        octave = 2**origin.octave
        assert points.octave[row] == origin.octave
        assert points.response[row] == pytest.approx(abs(origin.value), rel=1e-5)
        assert each.x == pytest.approx(origin.column + origin.offset[0])
        assert each.y == pytest.approx(origin.row + origin.offset[1])
        sigma = BASE_SIGMA * 2 ** ((origin.i + origin.offset[2]) / 3)
        assert each.sigma == pytest.approx(sigma)
        np.testing.assert_allclose(points.xy[row], (octave * each.x, octave * each.y), rtol=1e-5)
        assert points.size[row] == pytest.approx(2 * octave * each.sigma, rel=1e-5)
        assert angle_between(points.angle[row], each.angle) < 1e-5
        turned = points.descriptors[row].reshape(16, 8)[:, -np.arange(8)]  # from y towards x
        np.testing.assert_allclose(turned.ravel(), each.vector, atol=1e-6)


def test_orientations_come_from_the_histograms(found):
    for index in {each.candidate for each in found.descriptions}:
        points = [each for each in found.descriptions if each.candidate == index]
        expected = sorted(angle % TURN for angle in dominant_orientations(points[0].histogram))
        angles = sorted(each.angle % TURN for each in points)
        np.testing.assert_allclose(angles, expected, atol=1e-9)


def test_descriptions_are_those_of_the_closest_image(found):
    for each in found.descriptions[:6]:
        origin = found.candidates[each.candidate]
        sigmas = BASE_SIGMA * 2 ** (np.arange(6) / 3)
        closest = int(abs(np.log(sigmas / each.sigma)).argmin())
        L = found.scale_space[origin.octave][closest]
        m, theta = gradients(L)
        histogram = orientation_histogram(m, theta, each.x, each.y, each.sigma)
        np.testing.assert_allclose(each.histogram, histogram)
        again = descriptor(L, each.x, each.y, each.sigma, each.angle)
        np.testing.assert_allclose(each.vector, again.vector)


def test_points_turn_with_the_picture(found):
    turned = sift(np.rot90(scene()))
    assert len(turned.keypoints) == len(found.keypoints)
    x, y = found.keypoints.xy.T
    for row, place in enumerate(np.stack([y, 64 - x], axis=1)):
        apart = np.linalg.norm(turned.keypoints.xy - place, axis=1)
        alike = turned.keypoints.descriptors @ found.keypoints.descriptors[row]
        angle = found.keypoints.angle[row] - math.pi / 2
        match = [
            other
            for other in np.flatnonzero(apart < 1e-3)
            if angle_between(turned.keypoints.angle[other], angle) < 1e-3
        ]
        assert len(match) == 1
        assert alike[match[0]] > 0.999


@pytest.mark.parametrize("level", [0.0, 0.3, 1.0])
def test_a_flat_picture_has_no_points(level):
    result = sift(np.full((64, 80), level))
    assert len(result.keypoints) == 0
    assert result.keypoints.descriptors.shape == (0, 128)
    assert result.descriptions == ()


@pytest.mark.parametrize("rows", [64, 16])
def test_small_pictures_have_fewer_octaves(rows):
    space = build_scale_space(np.random.default_rng(8).random((rows, rows)))
    assert 1 <= len(space) <= OCTAVES
    assert min(space[-1][0].shape) >= 3
    sift(np.random.default_rng(8).random((rows, rows)))


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((0, 5)),
        np.full((64, 64), np.nan),
        np.zeros((1, 1)),
        np.zeros((64, 64, 2)),
        np.full((64, 64), 300.0),
    ],
)
def test_what_cannot_be_used_is_refused(image):
    with pytest.raises(ImageError):
        sift(image)


def test_bytes_are_divided_and_results_frozen(found):
    coded = np.round(scene() * 255).astype(np.uint8)
    kept = coded.copy()
    one, two = sift(coded), sift(coded / 255)
    np.testing.assert_array_equal(coded, kept)
    np.testing.assert_allclose(one.keypoints.xy, two.keypoints.xy, atol=1e-3)
    with pytest.raises(FrozenInstanceError):
        found.candidates = ()
