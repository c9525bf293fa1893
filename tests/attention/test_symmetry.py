import dataclasses

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade.attention import SymmetryConfig, symmetry_saliency
from saccade.attention.channels import whitened
from saccade.io.image import read_image
from saccade.scale.pair_sums import (
    fraction_inside,
    gradients_of,
    isotropic_sums,
    pair_kernel,
    radial_sums,
)
from support import oracles_attention
from support import oracles_symmetry as oracles
from support.reference_images import REFERENCE_IMAGES
from support.saliency_images import noise

SOURCE = SymmetryConfig.kootstra2010()
FINE = dataclasses.replace(SOURCE, levels=(0, 1, 2), map_level=0)
PRESETS = {
    "default": SymmetryConfig(),
    "isotropic": SymmetryConfig(kind="isotropic"),
    "kootstra2010": SOURCE,
}
SUMS = {"isotropic": isotropic_sums, "radial": radial_sums}
REFLECT = {"reflect": cv2.BORDER_REFLECT, "mirror": cv2.BORDER_REFLECT_101}

seeds = st.integers(0, 2**32 - 1)


@pytest.mark.kernel
@settings(max_examples=12)
@given(
    seeds,
    st.tuples(st.integers(1, 14), st.integers(1, 14)),
    st.sampled_from(list(SUMS)),
    st.sampled_from([(1, 4, 4.0, 60.0), (3, 5, 16.0, 1.0), (2, 2, 1.0, 10.0)]),
    st.sampled_from(list(REFLECT)),
)
def test_the_sums_of_the_papers(seed, shape, kind, numbers, reflect):
    inner, outer, sigma, gain = numbers
    channels = np.random.default_rng(seed).random((*shape, 2)).astype(np.float32)
    gradients = [gradients_of(c, gain, REFLECT[reflect]) for c in np.moveaxis(channels, 2, 0)]
    pairs = pair_kernel(inner, outer, sigma)
    sums = SUMS[kind](gradients, pairs)
    expected = oracles.symmetry(channels, kind, inner, outer, sigma, gain, reflect)
    assert sums.dtype == np.float32
    np.testing.assert_allclose(sums, expected, rtol=1e-4, atol=1e-4 * max(expected.max(), 0.05))
    share = fraction_inside(shape, pairs)
    expected = oracles.share_inside(shape, inner, outer, sigma)
    np.testing.assert_allclose(share, expected, atol=1e-6)


@pytest.mark.parametrize("kind", ["isotropic", "radial"])
def test_the_source_in_a_plain_second_reading(kind):
    gray = cv2.GaussianBlur(noise(1, (37, 51)), (0, 0), 1)[:, :, 0]
    config = dataclasses.replace(FINE, kind=kind)
    expected = oracles.kootstra2010(gray, kind, config.levels)
    np.testing.assert_allclose(symmetry_saliency(gray, config).saliency, expected, atol=1e-4)


def test_the_default_in_a_plain_second_reading():
    image = noise(2, (40, 56)) / np.float32(255)
    config = SymmetryConfig(levels=(1, 2), level_weights=(2.0, 1.0), map_level=2, viewing_size=None)
    maps = symmetry_saliency(image, config)
    rgb = np.stack([oracles_attention.halve(plane) for plane in np.moveaxis(image, 2, 0)], 2)
    planes = list(np.moveaxis(whitened(rgb.astype(np.float32)), 2, 0))  # has a test of its own
    summed = 0
    for level, weight in zip((1, 2), (2, 1), strict=True):
        if level == 2:
            planes = [oracles_attention.halve(plane) for plane in planes]
        sums = oracles.symmetry(np.stack(planes, axis=2), "radial", 1, 4, 4, 18)
        share = oracles.share_inside(sums.shape, 1, 4, 4) ** 1.4
        expected = sums + (1 - share) * sums.sum() / share.sum()
        np.testing.assert_allclose(maps.levels[level], expected, rtol=1e-3)
        summed = summed + weight * oracles_attention.block_mean(expected, (10, 14))
    smooth = oracles_attention.gaussian(summed, 0.75)
    scaled = (smooth - smooth.min()) / np.ptp(smooth)
    np.testing.assert_allclose(maps.saliency, scaled**2, atol=1e-3)


@pytest.mark.shared
@pytest.mark.parametrize("kind", ["iso", "radial"])
@pytest.mark.parametrize("name", REFERENCE_IMAGES)
def test_the_reference_outputs(shared, name, kind):
    folder = shared / "reference" / "saliency"
    image = read_image(folder / "images" / f"{name}.png")
    config = dataclasses.replace(SOURCE, kind="radial" if kind == "radial" else "isotropic")
    finer = dataclasses.replace(config, levels=(0, 1, 2), map_level=0)
    for settings_, levels in ((config, "s345"), (finer, "s012")):
        file = folder / f"{name}.symmetry_{kind}_{levels}.npz"
        if levels == "s012" and not file.exists():  # made for four of the images
            continue
        expected = np.load(file)["salmap"]
        saliency = symmetry_saliency(image, settings_).saliency
        assert saliency.shape == expected.shape
        assert np.corrcoef(saliency.ravel(), expected.ravel())[0, 1] > 0.9995


@settings(max_examples=15)
@given(seeds, st.tuples(st.integers(17, 70), st.integers(17, 70)), st.sampled_from(list(PRESETS)))
def test_a_mirrored_or_turned_image_has_mirrored_or_turned_maps(seed, shape, preset):
    config = FINE if preset == "kootstra2010" else PRESETS[preset]
    image = noise(seed, shape) / np.float32(255)
    saliency = symmetry_saliency(image, config).saliency
    for turn in (lambda m: m[:, ::-1], lambda m: m[::-1], lambda m: np.swapaxes(m, 0, 1)):
        turned = symmetry_saliency(np.ascontiguousarray(turn(image)), config).saliency
        np.testing.assert_allclose(turned, turn(saliency), atol=2e-3)


def test_colors_that_are_equally_bright_are_symmetric_too():
    y, x = np.mgrid[:80, :80]
    disc = np.hypot(x - 40, y - 40) < 10
    image = np.where(disc[:, :, None], (0.6, 0.2, 0.4), (0.2, 0.6, 0.4)).astype(np.float32)
    assert symmetry_saliency(image).saliency.max() == 1
    assert not symmetry_saliency(image, SymmetryConfig(channels="gray")).saliency.any()
