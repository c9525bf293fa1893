"""Appendix A against numbers worked by hand, closed forms and invariants."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade.errors import ImageError
from saccade.textbook.contrast_saliency import (
    across_scale_difference,
    across_scale_sum,
    blue_yellow,
    build_pyramid,
    contrast_saliency,
    gabor_kernel,
    intensity,
    low_pass,
    normalize,
    oriented_pyramid,
    red_green,
)

DIRECTIONS = (0, 45, 90, 135)
ORIENTATIONS = tuple(f"orientation_{degrees}" for degrees in DIRECTIONS)
SCALES = ((2, 5), (2, 6), (3, 6), (3, 7), (4, 7), (4, 8))
CHANNELS = {"intensity": intensity, "red_green": red_green, "blue_yellow": blue_yellow}
close = np.testing.assert_allclose


@pytest.fixture(scope="module")
def picture():
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:200, :240] / 240
    waves = [np.sin(2 * np.pi * (3 * x * k + 5 * y / k)) for k in (1, 2, 3)]
    image = 0.5 + 0.3 * np.stack(waves, axis=2)
    image[60:90, 100:150] = (0.9, 0.2, 0.1)
    image[130:170, 30:40] = (0.1, 0.3, 0.8)
    return np.clip(image + 0.05 * rng.normal(size=image.shape), 0, 1)


@pytest.fixture(scope="module")
def result(picture):
    return contrast_saliency(picture)


@pytest.mark.parametrize(
    ("rgb", "expected"),
    [
        ((0.9, 0.3, 0.6), (0.6, 2 / 3, 1 / 3)),
        ((0.2, 0.8, 0.4), (1.4 / 3, -0.75, 0.25)),
        ((0.5, 0.4, 0.0), (0.3, 0.2, -0.8)),
        ((0.7, 0.7, 0.7), (0.7, 0.0, 0.0)),
        ((0.002, 0.001, 0.0), (0.001, 0.5, -0.5)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ],
)
def test_channels_of_one_pixel(rgb, expected):
    pixel = np.array([[rgb]], float)
    close([float(channel(pixel)[0, 0]) for channel in CHANNELS.values()], expected, atol=1e-12)


def test_low_pass_is_a_small_gaussian_that_removes_what_halving_would_fold():
    point = np.zeros((33, 33))
    point[16, 16] = 1
    kernel = low_pass(point)
    assert kernel.sum() == pytest.approx(1)
    profile = kernel[16] / kernel[16].sum()
    close(kernel, np.outer(profile, profile), atol=1e-12)
    variance = (profile * (np.arange(33) - 16) ** 2).sum()
    assert 0.5 < variance < 2
    gaussian = np.exp(-((np.arange(33) - 16.0) ** 2) / (2 * variance))
    close(profile, gaussian / gaussian.sum(), atol=0.03)
    close(low_pass(np.full((9, 7), 0.3)), 0.3)
    y, x = np.mgrid[:32, :32]
    for pattern in (x + y, x):
        assert abs(low_pass((-1.0) ** pattern)[8:-8, 8:-8]).max() < 0.05


def test_a_pyramid_has_nine_levels_and_each_is_every_second_sample_of_the_last():
    channel = np.random.default_rng(1).random((256, 300))
    pyramid = build_pyramid(channel)
    rows, columns = (256, 128, 64, 32, 16, 8, 4, 2, 1), (300, 150, 75, 38, 19, 10, 5, 3, 2)
    assert [level.shape for level in pyramid] == list(zip(rows, columns, strict=True))
    np.testing.assert_array_equal(pyramid[0], channel)
    for finer, coarser in itertools.pairwise(pyramid):
        close(coarser, low_pass(finer)[::2, ::2])


@pytest.mark.parametrize("degrees", DIRECTIONS)
def test_orientation(degrees):
    """One signed convolution, with a kernel that has no mean and prefers its own direction."""
    kernel = gabor_kernel(degrees)
    assert abs(kernel.sum()) < 1e-12 < abs(kernel).max()
    point = np.zeros((65, 65))
    point[32, 32] = 1
    found = oriented_pyramid((point, *(np.zeros((2, 2)) for _ in range(8))), degrees)[0]
    y, x = (side // 2 for side in kernel.shape)
    close(found[32 - y : 33 + y, 32 - x : 33 + x], kernel, atol=1e-12)
    assert abs(found).sum() == pytest.approx(abs(kernel).sum())

    y, x = np.mgrid[:65, :65] - 32  # a bar; y points down
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    bar = ((abs(c * y - s * x) <= 1.5) & (abs(c * x + s * y) <= 24)).astype(float)
    pyramid = build_pyramid(bar)
    answers = [
        sum((oriented_pyramid(pyramid, other)[level] ** 2).sum() for level in (1, 2))
        for other in DIRECTIONS
    ]
    assert DIRECTIONS[int(np.argmax(answers))] == degrees
    assert answers[DIRECTIONS.index((degrees + 90) % 180)] < 0.5 * max(answers)


def test_center_and_surround():
    """An absolute difference, interpolated where the pyramid took its samples."""
    center, surround = np.full((9, 12), 0.75), np.full((2, 2), 0.25)
    for sign in (1, -1):
        close(across_scale_difference(sign * center, sign * surround), np.full((9, 12), 0.5))
    surround = np.random.default_rng(3).uniform(1, 2, (4, 5))
    large = across_scale_difference(np.zeros((32, 38)), surround)
    assert surround.min() - 1e-12 <= large.min() < large.max() <= surround.max() + 1e-12
    assert len(np.unique(large)) > 100
    ramp = np.tile(np.arange(256.0), (256, 1))
    for c, s in SCALES[:4]:
        center, surround = ramp[:: 2**c, :: 2**c], ramp[:: 2**s, :: 2**s]
        inside = slice(2 ** (s - c), -(2 ** (s - c)))
        close(across_scale_difference(center, surround)[:, inside], 0, atol=1e-9)
        close(across_scale_difference(center.T, surround.T)[inside], 0, atol=1e-9)


def test_sums_over_scales():
    rng = np.random.default_rng(4)
    fine, same = rng.random((16, 20)), rng.random((4, 5))
    once = across_scale_sum([fine], (4, 5))
    close(across_scale_sum([fine, same, 2 * fine], (4, 5)), 3 * once + same)
    ramp = np.tile(np.arange(64.0), (64, 1))
    for step in (2, 4):
        found = across_scale_sum([ramp], (64 // step, 64 // step))
        close(found[2:-2, 2:-2], ramp[::step, ::step][2:-2, 2:-2], atol=1e-9)


def test_a_flat_top_is_one_maximum_and_a_flat_map_has_none():
    alone = np.zeros((7, 12))
    alone[2:4, 2:5] = 1
    assert normalize(alone).weight == 1
    alone[3, 9] = 0.5
    assert normalize(alone).mean_of_maxima == pytest.approx(0.75)
    for level in (0.0, 1 / 3, -7.0):
        found = normalize(np.full((4, 5), level))
        np.testing.assert_array_equal(found.map, np.zeros((4, 5)))
        assert (found.weight, found.mean_of_maxima, len(found.maxima)) == (0, 0, 0)


@settings(max_examples=50)
@given(st.permutations(range(42)), st.floats(0.01, 100), st.floats(-50, 50))
def test_normalization_is_its_definition(order, factor, offset):
    values = np.array(order, float).reshape(6, 7)
    scaled = values / 41
    maxima = [
        (row, column)
        for row, column in np.ndindex(6, 7)
        if scaled[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].max()
        == scaled[row, column]
        >= 0.1
    ]
    mean = sum(scaled[place] for place in maxima) / len(maxima)
    weight = 1.0 if len(maxima) == 1 else (1 - mean) ** 2
    found = normalize(factor * values + offset)
    assert sorted(map(tuple, found.maxima.tolist())) == maxima
    assert (found.mean_of_maxima, found.weight) == pytest.approx((mean, weight))
    close(found.map, weight * scaled, atol=1e-9)


def test_every_map_is_what_its_equation_says(picture, result):
    names = {*CHANNELS, *ORIENTATIONS}
    assert set(result.features) == {(name, c, s) for name in names for c, s in SCALES}
    assert set(result.pyramids) == names
    pyramids = {name: build_pyramid(channel(picture)) for name, channel in CHANNELS.items()}
    for degrees, name in zip(DIRECTIONS, ORIENTATIONS, strict=True):
        pyramids[name] = oriented_pyramid(pyramids["intensity"], degrees)
    for name, pyramid in pyramids.items():
        for found, expected in zip(result.pyramids[name], pyramid, strict=True):
            close(found, expected, atol=1e-6)
    for (name, c, s), feature in result.features.items():
        pyramid = result.pyramids[name]
        close(feature.contrast, across_scale_difference(pyramid[c], pyramid[s]), atol=1e-12)
        close(feature.normalized.map, normalize(feature.contrast).map, atol=1e-12)

    shape = (13, 15)
    total = {
        name: across_scale_sum(
            [result.features[name, c, s].normalized.map for c, s in SCALES], shape
        )
        for name in names
    }
    sums = {name: normalize(total[name]).map for name in names - {"intensity"}}
    assert set(result.sums) == set(sums)
    for name, found in result.sums.items():
        close(found.map, sums[name], atol=1e-12)
    close(result.intensity, total["intensity"], atol=1e-12)
    close(result.color, sums["red_green"] + sums["blue_yellow"], atol=1e-12)
    close(result.orientation, sum(sums[name] for name in ORIENTATIONS), atol=1e-12)
    assert set(result.conspicuity) == {"intensity", "color", "orientation"}
    for name, found in result.conspicuity.items():
        close(found.map, normalize(getattr(result, name)).map, atol=1e-12)
    close(3 * result.saliency, sum(found.map for found in result.conspicuity.values()), atol=1e-12)
    assert result.saliency.shape == shape
    assert result.saliency.max() > 0


def test_a_flat_picture_has_no_saliency_and_a_small_one_is_refused():
    found = contrast_saliency(np.full((150, 200, 3), (1 / 3, 1 / 6, 1 / 9)))
    for each in (found.saliency, found.intensity, found.color, found.orientation):
        np.testing.assert_array_equal(each, np.zeros_like(each))
    with pytest.raises(ImageError):
        contrast_saliency(np.zeros((8, 8, 3)))
