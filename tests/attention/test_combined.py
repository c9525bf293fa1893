import numpy as np

from saccade.attention import (
    AttentionConfig,
    attention_saliency,
    contrast_saliency,
    symmetry_saliency,
)
from saccade.scale.pyramid import resize
from support.saliency_images import noise


def test_each_model_is_as_it_is_alone():
    image = noise(1, (90, 130))
    maps = attention_saliency(image, keep_features=True)
    contrast, symmetry = contrast_saliency(image), symmetry_saliency(image)
    np.testing.assert_array_equal(maps.contrast.saliency, contrast.saliency)
    np.testing.assert_array_equal(maps.symmetry.saliency, symmetry.saliency)
    assert maps.contrast.features
    assert maps.saliency.shape == contrast.saliency.shape
    assert maps.saliency.dtype == np.float32
    assert repr(maps) == "AttentionMaps(17 x 12 cells of a 130 x 90 image)"


MODELS = {"contrast": "contrast_weight", "symmetry": "symmetry_weight"}
MODELS["boolean"] = "boolean_weight"


def test_the_sum_of_the_models_by_hand():
    """Without promotion it is the weighted sum, scaled to [0, 1], to a power."""
    image = noise(3, (120, 160))
    config = AttentionConfig(
        contrast_weight=0.5, symmetry_weight=2.0, boolean_weight=0.7, normalization="none"
    )
    maps = attention_saliency(image, config)
    boolean = resize(maps.boolean.saliency, maps.saliency.shape)
    boolean = (boolean - boolean.min()) / np.ptp(boolean)  # the others reach 0 and 1
    summed = 0.5 * maps.contrast.saliency + 2 * maps.symmetry.saliency + 0.7 * boolean
    scaled = (summed - summed.min()) / np.ptp(summed)
    np.testing.assert_allclose(maps.saliency, scaled**1.4, atol=1e-5)


def test_the_prior_is_a_gaussian_above_the_middle_and_falls_at_the_border():
    image = noise(4, (120, 160))
    plain = attention_saliency(image)
    h, w = plain.saliency.shape
    y, x = ((np.arange(n) + 0.5) / n - 0.5 for n in (h, w))
    gaussian = np.exp(-((y[:, None] + 0.1) ** 2 + x**2) / (2 * 0.4**2))
    distance = np.minimum(np.minimum(x + 0.5, 0.5 - x), np.minimum(y + 0.5, 0.5 - y)[:, None])
    falling = 1 - np.exp(-distance / 0.04)
    for config, factor in (
        (AttentionConfig.free_viewing(), gaussian * falling),
        (AttentionConfig(center_prior=0.4, center_height=0.1), gaussian),
        (AttentionConfig(border_prior=0.04), falling),
    ):
        prior = attention_saliency(image, config)
        np.testing.assert_allclose(prior.saliency, plain.saliency * factor, atol=1e-6)
