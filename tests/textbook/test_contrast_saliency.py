"""Appendix A against numbers worked by hand, closed forms and invariants."""

import itertools
import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from saccade.errors import ImageError
from saccade.textbook.contrast_saliency import (
    across_scale_difference,
    across_scale_sum,
    blue_yellow,
    build_pyramid,
    contrast_saliency,
    every_second_sample,
    gabor_kernel,
    intensity,
    low_pass,
    normalize,
    oriented_pyramid,
    red_green,
)

ALWAYS_THE_SAME = settings(derandomize=True, max_examples=50)
DIRECTIONS = (0, 45, 90, 135)
ORIENTATIONS = tuple(f"orientation_{degrees}" for degrees in DIRECTIONS)
SCALES = ((2, 5), (2, 6), (3, 6), (3, 7), (4, 7), (4, 8))
CENTERED = 257
"""A side at which every second sample, from the first, is also every second from the last."""


def pixel(r, g, b):
    return np.array([[[r, g, b]]], float)


def bar(degrees, side=65, half_width=1.5, half_length=24):
    """A white bar through the middle; `degrees` from x towards y, which points down."""
    y, x = np.mgrid[:side, :side] - side // 2
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    along, across = c * x + s * y, -s * x + c * y
    return ((abs(across) <= half_width) & (abs(along) <= half_length)).astype(float)


def display(items, odd, seed, gap=48, count=5):
    """Items on a loose grid over black, one of them odd; and the middle of that one, (2,)."""
    rng = np.random.default_rng(seed)
    image = np.zeros((CENTERED, CENTERED, 3))
    odd_at = tuple(rng.integers(1, count - 1, 2))
    for place in np.ndindex(count, count):
        item = odd if place == odd_at else items
        middle = 32 + gap * np.array(place) + rng.integers(-6, 7, 2)
        top, left = middle - len(item) // 2
        image[top : top + len(item), left : left + len(item)] = item
        if place == odd_at:
            at = middle
    return image, at


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


# Channels


@pytest.mark.parametrize(
    ("rgb", "expected"),
    [
        ((0.9, 0.3, 0.6), (0.6, 2 / 3, 1 / 3)),
        ((0.2, 0.8, 0.4), (1.4 / 3, -0.75, 0.25)),
        ((0.5, 0.4, 0.0), (0.3, 0.2, -0.8)),
        ((0.0, 0.0, 1.0), (1 / 3, 0.0, 1.0)),
        ((1.0, 1.0, 0.0), (2 / 3, 0.0, -1.0)),
        ((1.0, 0.0, 0.0), (1 / 3, 1.0, 0.0)),
        ((0.0, 0.5, 0.0), (1 / 6, -1.0, 0.0)),
        ((0.7, 0.7, 0.7), (0.7, 0.0, 0.0)),
        ((0.002, 0.001, 0.0), (0.001, 0.5, -0.5)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ],
)
def test_channels_of_one_pixel(rgb, expected):
    found = [float(channel(pixel(*rgb))[0, 0]) for channel in (intensity, red_green, blue_yellow)]
    np.testing.assert_allclose(found, expected, atol=1e-12)


@ALWAYS_THE_SAME
@given(arrays.arrays(float, (3, 4, 3), elements=st.floats(0.01, 1)), st.floats(0.01, 1))
def test_opponency_does_not_depend_on_how_light_it_is(rgb, dimmed):
    for channel in (red_green, blue_yellow):
        assert channel(rgb).shape == (3, 4)
        assert abs(channel(rgb)).max() <= 1
        np.testing.assert_allclose(channel(dimmed * rgb), channel(rgb), atol=1e-9)
    np.testing.assert_allclose(intensity(dimmed * rgb), dimmed * intensity(rgb))
    np.testing.assert_allclose(red_green(rgb[:, :, [1, 0, 2]]), -red_green(rgb))
    np.testing.assert_allclose(blue_yellow(rgb[:, :, [1, 0, 2]]), blue_yellow(rgb))


# Pyramids


def test_every_second_sample_begins_with_the_first():
    counted = np.arange(20.0).reshape(4, 5)
    np.testing.assert_array_equal(every_second_sample(counted), [[0, 2, 4], [10, 12, 14]])
    np.testing.assert_array_equal(every_second_sample(counted[:1, :1]), [[0]])


def test_low_pass_is_a_small_gaussian():
    point = np.zeros((33, 33))
    point[16, 16] = 1
    kernel = low_pass(point)
    assert kernel.sum() == pytest.approx(1)
    assert kernel.min() >= 0
    assert np.unravel_index(kernel.argmax(), kernel.shape) == (16, 16)
    for turned in (kernel[::-1], kernel[:, ::-1], kernel.T):
        np.testing.assert_allclose(kernel, turned, atol=1e-15)
    profile = kernel[16] / kernel[16].sum()
    np.testing.assert_allclose(kernel, np.outer(profile, profile), atol=1e-12)
    variance = (profile * (np.arange(33) - 16) ** 2).sum()
    assert 0.5 < variance < 2
    gaussian = np.exp(-((np.arange(33) - 16.0) ** 2) / (2 * variance))
    np.testing.assert_allclose(profile, gaussian / gaussian.sum(), atol=0.03)


def test_low_pass_keeps_what_is_flat_and_removes_what_halving_would_fold():
    np.testing.assert_allclose(low_pass(np.full((9, 7), 0.3)), 0.3)
    y, x = np.mgrid[:32, :32]
    assert abs(low_pass((-1.0) ** (x + y))[8:-8, 8:-8]).max() < 0.05
    assert abs(low_pass((-1.0) ** x)[8:-8, 8:-8]).max() < 0.05


def test_a_pyramid_has_nine_levels_and_each_is_half_of_the_last():
    channel = np.random.default_rng(1).random((256, 300))
    pyramid = build_pyramid(channel)
    assert [level.shape for level in pyramid] == [
        (256, 300),
        (128, 150),
        (64, 75),
        (32, 38),
        (16, 19),
        (8, 10),
        (4, 5),
        (2, 3),
        (1, 2),
    ]
    np.testing.assert_array_equal(pyramid[0], channel)
    for finer, coarser in itertools.pairwise(pyramid):
        np.testing.assert_allclose(coarser, low_pass(finer)[::2, ::2])


def test_a_point_stays_where_it_is_at_every_level():
    channel = np.zeros((256, 256))
    channel[64, 192] = 1
    for level, blurred in enumerate(build_pyramid(channel)[:6]):
        row, column = np.unravel_index(blurred.argmax(), blurred.shape)
        assert (row << level, column << level) == (64, 192)


# Orientation


@pytest.mark.parametrize("degrees", DIRECTIONS)
def test_gabor_kernels_have_no_mean_and_a_middle(degrees):
    kernel = gabor_kernel(degrees)
    assert kernel.shape[0] % 2 == kernel.shape[1] % 2 == 1
    assert abs(kernel.sum()) < 1e-12 < abs(kernel).max()


def test_gabor_kernels_are_turned_copies():
    np.testing.assert_allclose(gabor_kernel(90), np.rot90(gabor_kernel(0)), atol=1e-12)
    np.testing.assert_allclose(gabor_kernel(135), gabor_kernel(45)[:, ::-1], atol=1e-12)


@pytest.mark.parametrize("degrees", DIRECTIONS)
def test_a_bar_answers_in_the_channel_of_its_direction(degrees):
    pyramid = build_pyramid(bar(degrees))
    answers = [
        sum((oriented_pyramid(pyramid, other)[level] ** 2).sum() for level in (1, 2))
        for other in DIRECTIONS
    ]
    assert DIRECTIONS[int(np.argmax(answers))] == degrees
    across = answers[DIRECTIONS.index((degrees + 90) % 180)]
    assert across < 0.5 * max(answers)


def test_the_oriented_pyramid_is_one_signed_convolution():
    rng = np.random.default_rng(2)
    one, two = (build_pyramid(rng.random((64, 80))) for _ in range(2))
    together = tuple(2 * a - 3 * b for a, b in zip(one, two, strict=True))
    for level in range(9):
        a, b, both = (oriented_pyramid(each, 45)[level] for each in (one, two, together))
        assert both.shape == together[level].shape
        np.testing.assert_allclose(both, 2 * a - 3 * b, atol=1e-9)
    assert oriented_pyramid(one, 45)[0].min() < 0 < oriented_pyramid(one, 45)[0].max()


def test_the_oriented_pyramid_is_that_of_its_kernel():
    point = np.zeros((65, 65))
    point[32, 32] = 1
    pyramid = (point, *(np.zeros((2, 2)) for _ in range(8)))
    for degrees in DIRECTIONS:
        kernel, found = gabor_kernel(degrees), oriented_pyramid(pyramid, degrees)[0]
        reach_y, reach_x = kernel.shape[0] // 2, kernel.shape[1] // 2
        around = found[32 - reach_y : 33 + reach_y, 32 - reach_x : 33 + reach_x]
        np.testing.assert_allclose(around, kernel, atol=1e-12)
        assert abs(found).sum() == pytest.approx(abs(kernel).sum())


# Center and surround


def test_difference_of_constants():
    center, surround = np.full((9, 12), 0.75), np.full((2, 2), 0.25)
    np.testing.assert_allclose(across_scale_difference(center, surround), np.full((9, 12), 0.5))
    np.testing.assert_allclose(across_scale_difference(-center, -surround), np.full((9, 12), 0.5))
    assert abs(across_scale_difference(center, np.full((2, 2), 0.75))).max() < 1e-15


def test_the_surround_is_interpolated_not_repeated_and_never_overshoots():
    rng = np.random.default_rng(3)
    surround = rng.uniform(1, 2, (4, 5))
    large = across_scale_difference(np.zeros((32, 38)), surround)
    assert large.min() >= surround.min() - 1e-12
    assert large.max() <= surround.max() + 1e-12
    assert len(np.unique(large)) > 100


def test_center_and_surround_meet_where_the_pyramid_took_its_samples():
    x = np.arange(256.0)
    ramp = np.tile(x, (256, 1))
    for c, s in SCALES[:4]:
        center, surround = ramp[:: 2**c, :: 2**c], ramp[:: 2**s, :: 2**s]
        inside = slice(2 ** (s - c), -(2 ** (s - c)))
        found = across_scale_difference(center, surround)
        np.testing.assert_allclose(found[:, inside], 0, atol=1e-9)
        found = across_scale_difference(center.T, surround.T)
        np.testing.assert_allclose(found[inside], 0, atol=1e-9)


# Sums over scales


def test_sums_over_scales():
    flat = [np.full((16, 20), 0.5), np.full((8, 10), 0.25), np.full((4, 5), 2.0)]
    np.testing.assert_allclose(across_scale_sum(flat, (4, 5)), np.full((4, 5), 2.75))
    same = np.random.default_rng(4).random((4, 5))
    np.testing.assert_allclose(across_scale_sum([same, 2 * same], (4, 5)), 3 * same)
    fine = np.random.default_rng(5).random((16, 20))
    once = across_scale_sum([fine], (4, 5))
    np.testing.assert_allclose(across_scale_sum([fine, same, 2 * fine], (4, 5)), 3 * once + same)


def test_sums_over_scales_meet_where_the_pyramid_took_its_samples():
    ramp = np.tile(np.arange(64.0), (64, 1))
    for step in (2, 4):
        found = across_scale_sum([ramp], (64 // step, 64 // step))
        expected = ramp[::step, ::step]
        np.testing.assert_allclose(found[2:-2, 2:-2], expected[2:-2, 2:-2], atol=1e-9)


# The whole


def test_there_are_forty_two_feature_maps(result):
    channels = ("intensity", "red_green", "blue_yellow", *ORIENTATIONS)
    assert set(result.features) == {(name, c, s) for name in channels for c, s in SCALES}
    assert set(result.pyramids) == set(channels)
    assert set(result.channels) == {"intensity", "red_green", "blue_yellow"}
    assert set(result.sums) == {"red_green", "blue_yellow", *ORIENTATIONS}
    assert set(result.conspicuity) == {"intensity", "color", "orientation"}


def test_channels_and_pyramids_are_those_of_the_picture(picture, result):
    for name, function in (
        ("intensity", intensity),
        ("red_green", red_green),
        ("blue_yellow", blue_yellow),
    ):
        channel = function(picture)
        np.testing.assert_allclose(result.channels[name], channel, atol=1e-6)
        for found, expected in zip(result.pyramids[name], build_pyramid(channel), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-6)
    for degrees, name in zip(DIRECTIONS, ORIENTATIONS, strict=True):
        expected = oriented_pyramid(result.pyramids["intensity"], degrees)
        assert len(result.pyramids[name]) == 9
        for found, level in zip(result.pyramids[name], expected, strict=True):
            np.testing.assert_allclose(found, level, atol=1e-12)


def test_features_are_center_minus_surround_and_normalized(result):
    for (name, c, s), feature in result.features.items():
        pyramid = result.pyramids[name]
        assert feature.contrast.shape == pyramid[c].shape
        assert feature.contrast.min() >= 0
        expected = across_scale_difference(pyramid[c], pyramid[s])
        np.testing.assert_allclose(feature.contrast, expected, atol=1e-12)
        expected = normalize(feature.contrast)
        np.testing.assert_allclose(feature.normalized.map, expected.map, atol=1e-12)
        assert feature.normalized.weight == expected.weight


def test_maps_add_up_as_the_equations_say(picture, result):
    shape = result.pyramids["intensity"][4].shape
    assert shape == (13, 15)

    def total(name):
        maps = [result.features[name, c, s].normalized.map for c, s in SCALES]
        return across_scale_sum(maps, shape)

    def close(found, expected):
        assert found.shape == shape
        np.testing.assert_allclose(found, expected, atol=1e-12)

    close(result.intensity, total("intensity"))
    for name, found in result.sums.items():
        close(found.map, normalize(total(name)).map)
    close(result.color, result.sums["red_green"].map + result.sums["blue_yellow"].map)
    close(result.orientation, sum(result.sums[name].map for name in ORIENTATIONS))
    for name, found in result.conspicuity.items():
        close(found.map, normalize(getattr(result, name)).map)
    close(3 * result.saliency, sum(found.map for found in result.conspicuity.values()))
    assert result.saliency.max() > 0
    assert all(array.dtype == np.float64 for array in (result.saliency, result.color))


@pytest.mark.parametrize("level", [0.0, 0.3, 1 / 3, 1.0])
def test_a_flat_picture_has_no_saliency(level):
    for image in (
        np.full((150, 200, 3), level),
        np.full((150, 200, 3), (level, level / 2, level / 3)),
    ):
        found = contrast_saliency(image)
        for each in (found.saliency, found.intensity, found.color, found.orientation):
            np.testing.assert_array_equal(each, np.zeros_like(each))


def test_a_gray_picture_has_no_color(picture):
    gray = picture[:, :, 0]
    found = contrast_saliency(gray)
    np.testing.assert_array_equal(found.color, np.zeros_like(found.color))
    colored = contrast_saliency(np.repeat(gray[:, :, None], 3, axis=2))
    np.testing.assert_array_equal(found.saliency, colored.saliency)


def test_saliency_turns_and_flips_with_the_picture():
    rng = np.random.default_rng(6)
    image = rng.random((CENTERED, CENTERED, 3))
    image[150:190, 40:60] = (0.9, 0.1, 0.1)
    upright = contrast_saliency(image)
    transposed = contrast_saliency(image.transpose(1, 0, 2))
    flipped = contrast_saliency(image[:, ::-1])
    for name in ("intensity", "color", "orientation", "saliency"):
        expected = getattr(upright, name)
        np.testing.assert_allclose(getattr(transposed, name).T, expected, atol=1e-6)
        np.testing.assert_allclose(getattr(flipped, name)[:, ::-1], expected, atol=1e-6)
    for name, turned in zip(ORIENTATIONS, (90, 45, 0, 135), strict=True):
        other = transposed.sums[f"orientation_{turned}"].map.T
        np.testing.assert_allclose(other, upright.sums[name].map, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["color", "intensity", "orientation"])
def test_the_odd_one_pops_out(kind, seed):
    block, white = np.ones((16, 16, 1)), np.full(3, 0.8)
    upright, lying = (bar(degrees, 25, 2.5, 11)[:, :, None] * white for degrees in (90, 0))
    items, odd = {
        "color": (block * (0.2, 0.8, 0.2), block * (0.8, 0.2, 0.2)),
        "intensity": (block * (0.3, 0.3, 0.3), block * (1, 1, 1)),
        "orientation": (upright, lying),
    }[kind]
    image, middle = display(items, odd, seed)
    if kind == "color":
        image[image.max(axis=2) == 0] = 0.4  # as light as the items: their outlines say nothing
    saliency = contrast_saliency(image).saliency
    place = 16 * np.array(np.unravel_index(saliency.argmax(), saliency.shape))
    assert np.linalg.norm(place - middle) < 24  # half way to the next


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((0, 5, 3)),
        np.full((64, 64, 3), np.nan),
        np.zeros((8, 8, 3)),
        np.zeros((64, 64, 2)),
        np.full((64, 64, 3), 300.0),
    ],
)
def test_what_cannot_be_used_is_refused(image):
    with pytest.raises(ImageError):
        contrast_saliency(image)


def test_bytes_are_divided_and_pictures_left_alone(picture):
    coded = (picture * 255).astype(np.uint8)
    kept = coded.copy()
    found = contrast_saliency(coded)
    np.testing.assert_array_equal(coded, kept)
    expected = contrast_saliency(coded / 255)
    np.testing.assert_allclose(found.saliency, expected.saliency, atol=1e-6)
    with pytest.raises(FrozenInstanceError):
        found.saliency = kept
