from dataclasses import replace
from itertools import cycle
from typing import get_args

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from saccade.attention import AttentionConfig, ContrastConfig, attention_saliency, contrast_saliency
from saccade.attention.channels import Color
from saccade.attention.normalize import (
    NORMALIZATIONS,
    Parameters,
    names_supported,
    normalize,
    sharpen,
    smooth,
)
from saccade.errors import ConfigError
from saccade.io.image import read_image
from support import oracles_attention as oracles
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
METHODS = list(NORMALIZATIONS)

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
    parts = [normalize(getattr(maps, name), "local-maxima") for name in MAPS[1:]]
    expected = (parts[0] + 2 * parts[1] + 0.5 * parts[2]) / 3.5
    np.testing.assert_allclose(maps.saliency, expected, atol=1e-6)  # A.14


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("channel", MAPS[1:])
@pytest.mark.parametrize(("method", "color"), [*zip(METHODS, cycle(get_args(Color)))])
def test_each_channel_alone_with_each_normalization(preset, channel, method, color):
    if method not in names_supported(PRESETS[preset].variant):
        with pytest.raises(ConfigError, match=f"normalization: expected .*{method!r}"):
            replace(PRESETS[preset], normalization=method)
        return
    weights = {f"{name}_weight": float(name == channel) for name in MAPS[1:]}
    image = noise(5, (96, 130))
    config = replace(PRESETS[preset], normalization=method, color=color, **weights)
    maps = contrast_saliency(image, config)
    assert maps.saliency.any()
    for name in MAPS[1:]:
        assert getattr(maps, name).any() == (name == channel)
    if preset in ("itti1998", "kootstra2010"):
        radius = Parameters(radius=config.maxima_radius)
        expected = normalize(getattr(maps, channel), method, radius)
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


@pytest.fixture(scope="module")
def scene():
    """(150, 203, 3) uint8: color patches, a bright disc and some noise."""
    rng = np.random.default_rng(3)
    patches = cv2.resize(rng.random((5, 6, 3)), (203, 150), interpolation=cv2.INTER_NEAREST)
    cv2.circle(patches, (60, 90), 14, (1.0, 0.9, 0.1), -1)
    return (200 * patches + 55 * rng.random((150, 203, 3))).astype(np.uint8)


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
