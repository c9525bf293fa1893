"""Every row of the tables of models, channels and normalizations works, and differs from others."""

from dataclasses import replace
from itertools import combinations
from typing import get_args, get_type_hints

import numpy as np
import pytest

import saccade
from saccade.attention import AttentionConfig, ContrastConfig, attention_saliency, saliencytoolbox2
from saccade.attention.combined import CHANNELS
from saccade.attention.contrast_config import Variant
from saccade.attention.models import MODELS, AttentionModel
from saccade.attention.normalize import NORMALIZATIONS, names_supported, weight_by_maxima
from saccade.errors import ConfigError, ImageError
from saccade.serving.controls import controls
from saccade.settings import as_toml, kinds
from support.saliency_images import noise

IMAGE = noise(1, (90, 130))
VARIANTS = {
    "mirrored": ContrastConfig(),
    "kootstra2010": ContrastConfig.kootstra2010(),
    "saliencytoolbox2": ContrastConfig.saliencytoolbox2(),
}


def squared(scaled, parameters):
    assert scaled.max() <= 1 <= parameters.iterations
    return scaled**2


def left_to_right(image):
    return np.tile(np.arange(13.0), (9, 1)) - 6


def test_every_variant_is_compared():
    assert [*VARIANTS] == [*get_args(Variant)]
    assert [*saliencytoolbox2.NORMALIZATIONS] == names_supported("saliencytoolbox2")


@pytest.mark.parametrize("variant", VARIANTS)
def test_no_normalization_is_another_by_another_name(variant):
    maps = {
        name: saccade.contrast_saliency(IMAGE, replace(VARIANTS[variant], normalization=name))
        for name in names_supported(variant)
    }
    for one, other in combinations(maps.values(), 2):
        assert np.abs(one.saliency - other.saliency).max() > 1e-6
    for name in NORMALIZATIONS.keys() - maps.keys():
        with pytest.raises(ConfigError, match=f"for the variant {variant}, found '{name}'"):
            replace(VARIANTS[variant], normalization=name)


def test_a_function_is_a_normalization():
    own = ContrastConfig(normalization=squared)
    named = replace(own, normalization=f"{__name__}:squared")
    plain = saccade.contrast_saliency(IMAGE, ContrastConfig(normalization="none"))
    for config in (own, named):
        maps = saccade.contrast_saliency(IMAGE, config)
        assert np.abs(maps.saliency - plain.saliency).max() > 0.01
        assert f'normalization = "{__name__}:squared"' in as_toml(config)
    same = AttentionConfig(normalization=weight_by_maxima)
    expected = attention_saliency(IMAGE).saliency
    np.testing.assert_array_equal(attention_saliency(IMAGE, same).saliency, expected)
    for wrong in ("soup", "absent:f", 3):
        with pytest.raises(ConfigError, match="normalization: "):
            ContrastConfig(normalization=wrong)
    with pytest.raises(ConfigError, match="variant saliencytoolbox2, found 'squared'"):
        replace(VARIANTS["saliencytoolbox2"], normalization=squared)


@pytest.mark.parametrize("name", CHANNELS)
def test_a_channel_has_a_layer_and_counts_by_its_weight(name):
    weight = CHANNELS[name].weight
    assert get_type_hints(AttentionConfig)[weight] is float
    default = getattr(AttentionConfig(), weight)
    maps = attention_saliency(IMAGE, replace(AttentionConfig(), **{weight: default or 0.2}))
    heavy = attention_saliency(IMAGE, replace(AttentionConfig(), **{weight: 100.0}))
    layer = maps.layers[name]
    assert layer is maps.channels[name].saliency
    assert layer.any()
    at_map = saccade.SaliencyMaps(layer, maps.image_shape).upsampled["saliency"]

    def likeness(found):
        return np.corrcoef(at_map.ravel(), found.upsampled["saliency"].ravel())[0, 1]

    assert likeness(heavy) > likeness(maps)
    if weight not in ("contrast_weight", "symmetry_weight"):
        without = attention_saliency(IMAGE, replace(AttentionConfig(), **{weight: 0.0}))
        assert not without.layers[name].any()


def test_every_model_has_settings_and_a_place_on_the_page():
    page = controls()
    groups = {group["kind"]: group for group in page["groups"]}
    assert [*page["models"]] == [*MODELS]
    for name, row in MODELS.items():
        assert name in kinds()
        assert name in groups
        maps = AttentionModel(row.settings()).maps(IMAGE)
        assert maps.image_shape == IMAGE.shape[:2]
        assert next(iter(maps.layers)) == "saliency"
    fields = {each["name"]: each for each in groups["contrast"]["fields"]}
    assert fields["normalization"]["choices"] == [*NORMALIZATIONS]
    assert {row.weight for row in CHANNELS.values()} <= {
        each["name"] for each in groups["attention"]["fields"]
    }


def test_a_function_is_a_model():
    maps = AttentionModel(left_to_right).maps(IMAGE)
    assert maps.saliency.min() == 0
    assert maps.saliency.shape == (9, 13)
    assert maps.image_shape == IMAGE.shape[:2]
    with pytest.raises(ConfigError, match="model: <lambda>: failed: no"):
        AttentionModel(lambda image: (_ for _ in ()).throw(ValueError("no"))).maps(IMAGE)
    with pytest.raises(ImageError, match="expected a map of one channel, found a picture"):
        AttentionModel(lambda image: image).maps(IMAGE)
    with pytest.raises(ConfigError, match=r"expected AttentionConfig, .* found ScanpathConfig"):
        AttentionModel(saccade.ScanpathConfig()).maps(IMAGE)
