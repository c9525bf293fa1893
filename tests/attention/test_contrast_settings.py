"""What the default adds to the source's model, and what any input becomes."""

from dataclasses import replace
from typing import get_args

import cv2
import numpy as np
import pytest

from saccade.attention import ContrastConfig, contrast_saliency
from saccade.attention.contrast import sharpen, smooth
from saccade.attention.models import bare_saliency
from saccade.attention.normalize import Normalization, normalize, position_prior
from saccade.scale.pyramid import resize
from support.pyramids import dyadic_pyramid

DEFAULT = ContrastConfig()
PRESETS = {
    "default": DEFAULT,
    "kootstra2010": ContrastConfig.kootstra2010(),
    "itti1998": ContrastConfig.itti1998(),
    "saliencytoolbox2": ContrastConfig.saliencytoolbox2(),
}
MAPS = ("saliency", "intensity", "color", "orientation")


@pytest.fixture(scope="module")
def scene():
    """(150, 203, 3) uint8: color patches, a bright disc and some noise."""
    rng = np.random.default_rng(3)
    patches = cv2.resize(rng.random((5, 6, 3)), (203, 150), interpolation=cv2.INTER_NEAREST)
    cv2.circle(patches, (60, 90), 14, (1.0, 0.9, 0.1), -1)
    return (200 * patches + 55 * rng.random((150, 203, 3))).astype(np.uint8)


def test_levels_of_linear_channels_are_channels_of_the_levels(scene):
    config = replace(
        DEFAULT,
        scales=((2, 3), (2, 5)),
        scale_weights=(1.0, 1.0),
        normalize_at="center",
        smoothing=0.0,
        orientation_weight=0.0,
    )
    rgb = scene / np.float64(255)
    r, g, b = np.moveaxis(rgb, 2, 0)
    channels = {
        "intensity": (r + g + b) / 3,
        "red-green": r - g,
        "blue-yellow": b - (r + g) / 2,
    }
    features = contrast_saliency(rgb, config, keep_features=True).features
    assert len(features) == 6
    for channel, center, surround, values, _ in features:
        levels = dyadic_pyramid(channels[channel.name], 5)
        expected = abs(levels[center] - resize(levels[surround], levels[center].shape))
        np.testing.assert_allclose(values, expected, atol=1e-6)
    eight_bit = contrast_saliency(scene, config, keep_features=True).features
    for exact, rounded in zip(features, eight_bit, strict=True):
        assert np.abs(exact.values - rounded.values).max() < 3 / 255


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


def test_smoothing_is_a_gaussian_of_its_cells():
    impulse = np.zeros((61, 65), np.float32)
    impulse[30, 32] = 1
    smoothed = smooth(impulse, 3.5)
    y, x = np.mgrid[:61, :65]
    assert smoothed.sum() == pytest.approx(1, abs=1e-5)
    assert (smoothed * (y - 30) ** 2).sum() == pytest.approx(3.5**2, rel=0.02)
    assert (smoothed * (x - 32) ** 2).sum() == pytest.approx(3.5**2, rel=0.02)
    np.testing.assert_array_equal(smooth(impulse, 0), impulse)


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


def test_a_center_prior_is_a_fixed_gaussian_and_off_by_default(scene):
    assert DEFAULT.center_prior is None
    np.testing.assert_allclose(
        position_prior((1, 4), 0.25)[0], np.exp([-1.125, -0.125, -0.125, -1.125])
    )
    free = contrast_saliency(scene)
    held = contrast_saliency(scene, replace(DEFAULT, center_prior=0.3))
    np.testing.assert_allclose(
        held.saliency, free.saliency * position_prior(held.saliency.shape, 0.3), atol=1e-6
    )
    np.testing.assert_array_equal(held.bare, free.saliency)
    assert bare_saliency(held) is held.bare


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
