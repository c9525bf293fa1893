"""Images of any size, flat ones and those that are too small, through all models."""

from dataclasses import replace
from importlib.resources import files

import cv2
import numpy as np
import pytest

from saccade.attention import (
    ContrastConfig,
    SymmetryConfig,
    attention_saliency,
    boolean_saliency,
    contrast_saliency,
    symmetry_saliency,
)
from saccade.attention.normalize import NORMALIZATIONS, names_supported
from saccade.errors import ImageError
from support.saliency_images import noise

SHAPES = ((32, 32), (32, 900), (700, 33), (250, 61))
TOOLBOX = ContrastConfig.saliencytoolbox2()
CONTRAST = (ContrastConfig(), ContrastConfig.itti1998(), ContrastConfig.kootstra2010(), TOOLBOX)
SYMMETRY = (SymmetryConfig(), SymmetryConfig(kind="isotropic"))


def check_maps(maps, shape, cells, dtype, *others):
    """Values are finite, at least 0, of a type and of an image's cells."""
    for values in (maps.saliency, *others):
        assert values.dtype == dtype
        assert np.isfinite(values).all()
        assert values.min() >= 0
    assert maps.saliency.shape == cells
    assert maps.image_shape == shape
    size = f"{cells[1]} x {cells[0]} cells of a {shape[1]} x {shape[0]} image"
    assert repr(maps) == f"{type(maps).__name__}({size})"


@pytest.mark.parametrize(("number", "method"), [*enumerate(NORMALIZATIONS)])
@pytest.mark.parametrize("config", CONTRAST)
def test_contrast_of_any_size(number, method, config):
    shape, supported = SHAPES[number % len(SHAPES)], names_supported(config.variant)
    config = replace(config, normalization=method if method in supported else supported[0])
    maps = contrast_saliency(noise(6, shape), config)
    cell = 2 ** config.at_size(shape).map_level
    down = config.variant == "saliencytoolbox2"
    cells = tuple(side // cell if down else -(-side // cell) for side in shape)
    dtype = np.float32 if config.variant == "mirrored" else np.float64
    check_maps(maps, shape, cells, dtype, maps.intensity, maps.color, maps.orientation)
    assert maps.saliency.any() or (min(cells) <= 4 and method == "iterative")


@pytest.mark.parametrize("shape", [(9, 9), (40, 900), (700, 33), (33, 47), (250, 61), (3, 64)])
@pytest.mark.parametrize("config", SYMMETRY)
def test_symmetry_of_any_size(shape, config):
    maps = symmetry_saliency(noise(6, shape), config)
    cell = 2 ** config.at_size(shape).map_level
    cells = tuple(-(-side // cell) for side in shape)
    check_maps(maps, shape, cells, np.float32, *maps.levels.values())
    assert maps.saliency.max() == 1


def test_boolean_maps_of_a_large_image_are_of_the_reduced_size():
    check_maps(boolean_saliency(noise(3, (300, 400))), (300, 400), (150, 200), np.float32)


@pytest.mark.parametrize("value", [0, 1, 77, 255])
@pytest.mark.parametrize("shape", [(160, 155), (160, 155, 3)])
def test_a_flat_image_has_nothing_salient(value, shape):
    flat = np.full(shape, value, np.uint8)
    for config in CONTRAST[:2]:
        for method in NORMALIZATIONS:
            maps = contrast_saliency(flat, replace(config, normalization=method))
            for values in (maps.saliency, maps.intensity, maps.color, maps.orientation):
                assert not values.any()
    for config in (*SYMMETRY, SymmetryConfig.kootstra2010()):
        assert not symmetry_saliency(flat, config).saliency.any()
    assert not boolean_saliency(flat).saliency.any()
    assert not attention_saliency(flat).saliency.any()


@pytest.mark.parametrize(
    ("model", "config", "shape", "least"),
    [
        (contrast_saliency, ContrastConfig(), (8, 8), (2, 9)),
        (contrast_saliency, ContrastConfig(), (500, 1, 3), (2, 9)),
        (contrast_saliency, ContrastConfig(), (2, 800), (3, 17)),
        (contrast_saliency, ContrastConfig.kootstra2010(), (16, 300), (17, 17)),
        (contrast_saliency, TOOLBOX, (31, 300), (32, 32)),
        (symmetry_saliency, SymmetryConfig(), (8, 8), (9, 9)),
        (symmetry_saliency, SymmetryConfig(), (4, 800), (17, 17)),
        (symmetry_saliency, SymmetryConfig.kootstra2010(), (60, 70), (72, 72)),
    ],
)
def test_too_small_an_image_is_refused_by_its_size(model, config, shape, least):
    with pytest.raises(ImageError, match=f"level.* found {shape[1]} x {shape[0]} px"):
        model(np.zeros(shape), config)
    model(np.zeros(least), config)


@pytest.mark.parametrize("model", [contrast_saliency, symmetry_saliency])
@pytest.mark.parametrize("enlarged", [2, 4])
def test_the_size_at_which_an_image_was_saved_does_not_matter(model, enlarged):
    image = cv2.GaussianBlur(noise(7, (300, 400)), (0, 0), 3)
    large = cv2.resize(image, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_CUBIC)
    here, there = model(image).saliency, model(large).saliency
    assert here.shape == there.shape
    assert np.corrcoef(here.ravel(), there.ravel())[0, 1] > 0.99


@pytest.mark.parametrize("model", [attention_saliency, contrast_saliency, symmetry_saliency])
def test_types_of_one_photograph_differ_by_what_is_documented(model):
    pixels = cv2.imread(str(files("saccade") / "data" / "coffee.jpg"))
    maps = {
        kind: model(values).saliency
        for kind, values in {
            "uint8": pixels,
            "uint16": pixels.astype(np.uint16) * 257,
            "float64": pixels / 255,
            "float32": (pixels / 255).astype(np.float32),
        }.items()
    }
    for kind, bound in (("uint8", 2e-3), ("uint16", 2e-3), ("float64", 5e-4)):
        np.testing.assert_allclose(maps[kind], maps["float32"], atol=bound)
