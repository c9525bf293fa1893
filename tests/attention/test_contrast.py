import dataclasses
from typing import get_args

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from saccade.attention import ContrastConfig, contrast_pyramids, contrast_saliency
from saccade.attention.channels import Color
from saccade.attention.normalize import Normalization, normalize
from saccade.errors import ImageError
from saccade.io.image import read_image
from saccade.scale.pyramid import resize
from support import oracles_attention as oracles
from support.pyramids import dyadic_pyramid
from support.saliency_images import noise, rank_of_the_odd_item

MAPS = ("saliency", "intensity", "color", "orientation")
PRESETS = {
    "default": ContrastConfig(),
    "itti1998": ContrastConfig.itti1998(),
    "kootstra2010": ContrastConfig.kootstra2010(),
    "saliencytoolbox2": ContrastConfig.saliencytoolbox2(),
}
MIRRORED = ["default", "itti1998"]
SOURCE = dataclasses.replace(ContrastConfig.itti1998(), normalization="local-maxima")
METHODS = get_args(Normalization)
PHOTOS = ("astronaut", "chelsea", "coffee", "motorcycle", "rocket")

seeds = st.integers(0, 2**32 - 1)
shapes = st.tuples(st.integers(17, 70), st.integers(17, 70))


@pytest.mark.parametrize("method", ["local-maxima", "local-maxima-1998", "none"])
def test_every_equation_in_a_plain_second_reading(method):
    image = noise(1, (64, 96)) / np.float32(255)
    maps = contrast_saliency(image, dataclasses.replace(SOURCE, normalization=method))
    for name, expected in zip(MAPS, oracles.contrast_saliency(image, method), strict=True):
        assert expected.max() > 0
        np.testing.assert_allclose(getattr(maps, name), expected, atol=2e-5, err_msg=name)


def test_features_are_differences_between_levels():
    image = noise(2, (80, 64))
    maps = contrast_saliency(image, SOURCE, keep_features=True)
    levels = dyadic_pyramid((image / np.float32(255)).mean(axis=2), 6)
    channels = [(name, None) for name in ("intensity", "red-green", "blue-yellow")]
    channels += [("orientation", angle) for angle in (0, 45, 90, 135)]
    # The shorter side ends with level 6: of the six pairs three exist (A.7-A.10).
    pairs = [(2, 5), (2, 6), (3, 6)]
    assert [f[:3] for f in maps.features] == [(c, *pair) for c in channels for pair in pairs]
    for _, center, surround, values, normalized in maps.features[:3]:
        expected = abs(levels[center] - resize(levels[surround], levels[center].shape))
        np.testing.assert_allclose(values, expected, atol=1e-6)
        np.testing.assert_array_equal(
            normalized, normalize(values, "local-maxima", radius=SOURCE.maxima_radius)
        )
    assert contrast_saliency(image, SOURCE).features == ()


def test_saliency_is_the_weighted_mean_of_the_normalized_channels():
    image = noise(4, (96, 128))
    config = dataclasses.replace(SOURCE, color_weight=2, orientation_weight=0.5)
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
    config = dataclasses.replace(PRESETS[preset], normalization=method, color=color, **weights)
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
    config = dataclasses.replace(PRESETS[preset], normalization=method)
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


@pytest.mark.parametrize(
    ("shape", "method"),
    [*zip([(32, 32), (32, 900), (700, 33), (250, 61)], METHODS, strict=True)],
)
@pytest.mark.parametrize("preset", PRESETS)
def test_any_size_gives_finite_maps_that_are_not_negative(shape, method, preset):
    image = noise(6, shape)
    config = dataclasses.replace(PRESETS[preset], normalization=method)
    maps = contrast_saliency(image, config)
    cell = 2 ** config.at_size(shape).map_level
    down = preset == "saliencytoolbox2"
    h, w = (side // cell if down else -(-side // cell) for side in shape)
    for name in MAPS:
        values = getattr(maps, name)
        assert values.shape == (h, w)
        assert values.dtype == (np.float32 if preset in MIRRORED else np.float64)
        assert np.isfinite(values).all()
        assert values.min() >= 0
    assert maps.saliency.any() or (min(h, w) <= 4 and method == "iterative")
    assert maps.image_shape == shape
    assert repr(maps) == f"ContrastMaps({w} x {h} cells of a {shape[1]} x {shape[0]} image)"


@pytest.mark.parametrize("value", [0, 77, 255])
@pytest.mark.parametrize("method", METHODS)
def test_a_flat_image_has_nothing_salient(value, method):
    flat = np.full((40, 55, 3), value, np.uint8)
    for preset in MIRRORED:
        config = dataclasses.replace(PRESETS[preset], normalization=method)
        maps = contrast_saliency(flat, config)
        assert not any(getattr(maps, name).any() for name in MAPS)


@pytest.mark.parametrize(
    ("preset", "shape", "shorter", "longer"),
    [
        ("default", (8, 8), 2, 9),
        ("default", (1, 500), 2, 9),
        ("default", (500, 1, 3), 2, 9),
        ("default", (2, 800), 3, 17),
        ("kootstra2010", (16, 300), 17, 17),
        ("kootstra2010", (16, 16, 3), 17, 17),
        ("saliencytoolbox2", (31, 300), 32, 32),
    ],
)
def test_too_small_an_image_is_refused_by_its_size(preset, shape, shorter, longer):
    words = (
        f"at least {shorter} px .* {longer} px on the longer .* found {shape[1]} x {shape[0]} px"
    )
    with pytest.raises(ImageError, match=words):
        contrast_saliency(np.zeros(shape), PRESETS[preset])


@pytest.mark.parametrize("enlarged", [2, 4])
def test_the_size_at_which_an_image_was_saved_does_not_matter(enlarged):
    image = cv2.GaussianBlur(noise(7, (300, 400)), (0, 0), 3)
    large = cv2.resize(image, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_CUBIC)
    here, there = contrast_saliency(image).saliency, contrast_saliency(large).saliency
    assert here.shape == there.shape
    assert np.corrcoef(here.ravel(), there.ravel())[0, 1] > 0.99
    fixed = contrast_saliency(large, ContrastConfig(viewing_size=None)).saliency
    assert fixed.shape == (-(-300 * enlarged // 16), -(-400 * enlarged // 16))


@pytest.mark.parametrize("shape", [(9, 9), (12, 16), (16, 16), (17, 31), (3, 200), (32, 32)])
def test_a_spot_in_a_small_image_is_found(shape):
    image = np.full((*shape, 3), 90, np.uint8)
    y, x = shape[0] // 2, shape[1] // 4
    image[max(0, y - 2) : y + 2, max(0, x - 2) : x + 2] = (250, 60, 40)
    saliency = contrast_saliency(image).saliency
    column = int(np.argmax(saliency.max(axis=0)))
    assert saliency.max() == 1
    assert column < saliency.shape[1] / 2


@pytest.mark.shared
@pytest.mark.parametrize(
    ("preset", "map_level"),
    [("default", 4), *(("itti1998", level) for level in (2, 3, 4))],
)
def test_pop_out(shared, preset, map_level):
    config = dataclasses.replace(PRESETS[preset], map_level=map_level)
    rank = {}
    for display in ("orientation", "intensity", "color", "color_gray", "conjunction"):
        file = shared / "reference" / "saliency" / "images" / f"popout_{display}.png"
        image = read_image(file)
        rank[display] = rank_of_the_odd_item(contrast_saliency(image, config).saliency, image)
    print(f"\n{preset}, map level {map_level}: {rank}")
    assert rank.pop("conjunction") > 1
    assert set(rank.values()) == {1}, rank


@pytest.mark.shared
@pytest.mark.parametrize("photo", PHOTOS)
def test_conspicuity_resembles_the_reference(shared, photo):
    """Another brightness, pyramid shape and interpolation, but the same model."""
    folder = shared / "reference" / "saliency"
    reference = np.load(folder / f"photo_{photo}.none.npz")
    maps = contrast_saliency(
        read_image(folder / "images" / f"photo_{photo}.png"),
        dataclasses.replace(SOURCE, normalization="none"),
    )
    for ours, theirs in ((maps.intensity, "Intensities"), (maps.color, "Color")):
        expected = reference[f"CM_{theirs}"]
        ours = resize(ours, expected.shape)[3:-3, 3:-3].ravel()
        assert np.corrcoef(ours, expected[3:-3, 3:-3].ravel())[0, 1] > 0.7


def test_pyramids_are_those_of_the_channels():
    rgb = noise(2, (80, 64)) / np.float32(255)
    config = dataclasses.replace(SOURCE, color="linear")
    pyramids = contrast_pyramids(rgb, config)
    features = contrast_saliency(rgb, config, keep_features=True).features
    assert list(pyramids) == list(dict.fromkeys(each.channel for each in features))
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
    assert "red-green" not in {
        channel.name
        for channel in contrast_pyramids(rgb, dataclasses.replace(config, color_weight=0))
    }
