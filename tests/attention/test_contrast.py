from dataclasses import replace
from typing import get_args

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from saccade.attention import AttentionConfig, ContrastConfig, attention_saliency, contrast_saliency
from saccade.attention.channels import Color
from saccade.attention.normalize import Normalization, normalize, sharpen, smooth
from saccade.io.image import read_image
from saccade.scale.pyramid import resize
from support import oracles_attention as oracles
from support.pyramids import dyadic_pyramid
from support.saliency_images import noise, rank_of_the_odd_item

MAPS = ("saliency", "intensity", "color", "orientation")
DEFAULT = ContrastConfig()
PRESETS = {
    "default": DEFAULT,
    "itti1998": ContrastConfig.itti1998(),
    "kootstra2010": ContrastConfig.kootstra2010(),
    "saliencytoolbox2": ContrastConfig.saliencytoolbox2(),
}
MIRRORED = ["default", "itti1998"]
SOURCE = replace(ContrastConfig.itti1998(), normalization="local-maxima")
METHODS = get_args(Normalization)

seeds = st.integers(0, 2**32 - 1)
shapes = st.tuples(st.integers(17, 70), st.integers(17, 70))


@pytest.mark.parametrize("method", ["local-maxima", "local-maxima-1998", "none"])
def test_every_equation_in_a_plain_second_reading(method):
    image = noise(1, (64, 96)) / np.float32(255)
    maps = contrast_saliency(image, replace(SOURCE, normalization=method))
    for name, expected in zip(MAPS, oracles.contrast_saliency(image, method), strict=True):
        assert expected.max() > 0
        np.testing.assert_allclose(getattr(maps, name), expected, atol=2e-5, err_msg=name)


def test_saliency_is_the_weighted_mean_of_the_normalized_channels():
    image = noise(4, (96, 128))
    config = replace(SOURCE, color_weight=2, orientation_weight=0.5)
    maps = contrast_saliency(image, config)
    parts = [normalize(getattr(maps, name), "local-maxima", radius=0.05) for name in MAPS[1:]]
    expected = (parts[0] + 2 * parts[1] + 0.5 * parts[2]) / 3.5
    np.testing.assert_allclose(maps.saliency, expected, atol=1e-6)  # A.14


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("channel", MAPS[1:])
@pytest.mark.parametrize(("method", "color"), [*zip(METHODS, 2 * get_args(Color), strict=True)])
def test_each_channel_alone_with_each_normalization(preset, channel, method, color):
    weights = {f"{name}_weight": float(name == channel) for name in MAPS[1:]}
    image = noise(5, (96, 130))
    config = replace(PRESETS[preset], normalization=method, color=color, **weights)
    maps = contrast_saliency(image, config)
    assert maps.saliency.any()
    for name in MAPS[1:]:
        assert getattr(maps, name).any() == (name == channel)
    if preset in ("itti1998", "kootstra2010"):
        expected = normalize(getattr(maps, channel), method, radius=config.maxima_radius)
        np.testing.assert_allclose(maps.saliency, expected, atol=1e-6)


@settings(max_examples=20)
@given(seeds, shapes, st.sampled_from(METHODS), st.sampled_from(MIRRORED))
def test_a_mirrored_image_has_mirrored_maps(seed, shape, method, preset):
    """Of maps that are not smoothed N counts two neighbors as one maximum or two by rounding."""
    assume(preset == "default" or not method.startswith("local-maxima"))
    image = noise(seed, shape) / np.float32(255)
    config = replace(PRESETS[preset], normalization=method)
    maps = contrast_saliency(image, config)
    left_right = contrast_saliency(image[:, ::-1], config)
    upside_down = contrast_saliency(image[::-1], config)
    for name in MAPS:
        expected = getattr(maps, name)
        np.testing.assert_allclose(getattr(left_right, name)[:, ::-1], expected, atol=2e-4)
        np.testing.assert_allclose(getattr(upside_down, name)[::-1], expected, atol=2e-4)


@settings(max_examples=20)
@given(seeds, st.tuples(*2 * [st.integers(32, 90)]), st.sampled_from(list(PRESETS)))
def test_dtypes_agree_and_grey_has_no_color(seed, shape, preset):
    image = noise(seed, shape)
    config = PRESETS[preset]
    maps = contrast_saliency(image, config)
    same = [image / 255, image / np.float32(255), image.astype(np.uint16) * 257]
    if preset == "default":  # 8 bit is rounded once more, when it is halved
        same, maps = same[1:], contrast_saliency(same[0], config)
    for other in (contrast_saliency(pixels, config) for pixels in same):
        for name in MAPS:
            np.testing.assert_allclose(
                getattr(other, name), getattr(maps, name), rtol=1e-3, atol=1e-3
            )
    gray = contrast_saliency(image[:, :, 0], config)
    repeated = contrast_saliency(np.repeat(image[:, :, :1], 3, axis=2), config)
    np.testing.assert_array_equal(gray.saliency, repeated.saliency)
    assert gray.saliency.any()
    if preset != "saliencytoolbox2":  # whose flat maps are 5 everywhere
        assert not gray.color.any()


@pytest.mark.shared
@pytest.mark.parametrize(
    ("model", "config"),
    [
        (contrast_saliency, DEFAULT),
        *((contrast_saliency, replace(PRESETS["itti1998"], map_level=n)) for n in (2, 3, 4)),
        *(
            (attention_saliency, AttentionConfig(contrast=ContrastConfig(map_level=n)))
            for n in (3, 4)
        ),
    ],
)
def test_pop_out(shared, model, config):
    """Symmetry alone misses the odd orientation, for its items are all as symmetric."""
    rank = {}
    for display in ("orientation", "intensity", "color", "color_gray", "conjunction"):
        file = shared / "reference" / "saliency" / "images" / f"popout_{display}.png"
        image = read_image(file)
        rank[display] = rank_of_the_odd_item(model(image, config).saliency, image)
    assert rank.pop("conjunction") > 1
    assert set(rank.values()) == {1}, rank


def test_pyramids_are_those_of_the_channels():
    rgb = noise(2, (80, 64)) / np.float32(255)
    config = replace(SOURCE, color="linear")
    maps = contrast_saliency(rgb, config, keep_features=True)
    pyramids = maps.pyramids
    assert list(pyramids) == list(dict.fromkeys(each.channel for each in maps.features))
    red, green, blue = (rgb[..., i] for i in range(3))
    for (name, _), plane in {
        ("intensity", None): rgb.mean(axis=2),
        ("red-green", None): red - green,
        ("blue-yellow", None): blue - (red + green) / 2,
    }.items():
        levels = dyadic_pyramid(plane, 6)
        found = pyramids[(name, None)]
        assert sorted(found) == [2, 3, 5, 6]
        for number, level in found.items():
            np.testing.assert_allclose(level, levels[number], atol=1e-6)
    colorless = contrast_saliency(rgb, replace(config, color_weight=0), keep_features=True)
    assert "red-green" not in {channel.name for channel in colorless.pyramids}


@pytest.fixture(scope="module")
def scene():
    """(150, 203, 3) uint8: color patches, a bright disc and some noise."""
    rng = np.random.default_rng(3)
    patches = cv2.resize(rng.random((5, 6, 3)), (203, 150), interpolation=cv2.INTER_NEAREST)
    cv2.circle(patches, (60, 90), 14, (1.0, 0.9, 0.1), -1)
    return (200 * patches + 55 * rng.random((150, 203, 3))).astype(np.uint8)


@pytest.mark.parametrize("preset", ["default", "itti1998"])
def test_conspicuity_is_summed_from_the_normalized_features(scene, preset):
    config = replace(
        PRESETS[preset],
        scale_weights=(1.0, 0.5, 0.25, 2.0, 1.0, 1.0)[: len(PRESETS[preset].scales)],
    )
    maps = contrast_saliency(scene, config, keep_features=True)
    scales = config.at_size(scene.shape[:2]).scales
    weight = dict(zip(scales, config.scale_weights, strict=True))
    sums = {}
    for channel, center, surround, _, normalized in maps.features:
        share = 1.0 if channel.name == "orientation" else weight[center, surround]
        at_map = share * resize(normalized, maps.saliency.shape)
        sums[channel] = sums.get(channel, 0) + at_map

    def promoted(name, angle=None):
        return normalize(sums[name, angle], config.normalization, radius=config.maxima_radius)

    np.testing.assert_allclose(maps.intensity, sums["intensity", None], atol=1e-6)  # A.11
    color = promoted("red-green") + promoted("blue-yellow")
    np.testing.assert_allclose(maps.color, color, atol=1e-6)  # A.12
    orientation = sum(promoted("orientation", angle) for angle in (0, 45, 90, 135))
    np.testing.assert_allclose(maps.orientation, orientation, atol=1e-6)  # A.13


def test_a_small_map_is_smoothed_by_an_eighth_of_its_sides_at_most():
    impulse = np.zeros((16, 80), np.float32)
    impulse[8, 40] = 1
    smoothed = smooth(impulse, 5.0)
    y, x = np.mgrid[:16, :80]
    assert (smoothed * (y - 8) ** 2).sum() == pytest.approx(2**2, rel=0.05)
    assert (smoothed * (x - 40) ** 2).sum() == pytest.approx(5**2, rel=0.05)


def test_sharpening_is_a_power_of_the_scaled_map(scene):
    np.testing.assert_allclose(sharpen(np.array([[1.0, 3.0, 5.0]]), 2), [[0, 0.25, 1]])
    plain = contrast_saliency(scene, replace(DEFAULT, sharpening=1.0)).saliency
    sharp = contrast_saliency(scene).saliency
    np.testing.assert_allclose(sharp, ((plain - plain.min()) / np.ptp(plain)) ** 1.5, atol=1e-5)


@pytest.mark.parametrize(
    ("preset", "method"), [*zip(PRESETS, get_args(Normalization), strict=True)]
)
def test_the_number_of_threads_changes_no_byte(preset, method):
    rng = np.random.default_rng(5)
    image = cv2.resize(rng.integers(0, 256, (60, 80, 3), np.uint8), (640, 480))
    config = replace(PRESETS[preset], normalization=method)
    threads = cv2.getNumThreads()
    try:
        results = []
        for number in (1, 2, 4):
            cv2.setNumThreads(number)
            maps = contrast_saliency(image, config)
            results.append(b"".join(getattr(maps, name).tobytes() for name in MAPS))
    finally:
        cv2.setNumThreads(threads)
    assert results[0] == results[1] == results[2]
