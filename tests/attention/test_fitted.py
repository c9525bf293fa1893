"""A fitted model is what its file says, and does not need its fixations."""

import numpy as np
import pytest

import saccade
from saccade.attention import AttentionConfig, FittedModel, attention_saliency
from saccade.attention.fitted import FLOOR, feature_maps, feature_names
from saccade.errors import ConfigError
from saccade.settings import as_toml

FEATURES = ("attention", "symmetry 1 around 3", "skin around 8", "center x", "border")


@pytest.fixture
def photo(rng):
    return rng.random((120, 160, 3)).astype(np.float32)


def test_the_density_is_a_product_of_powers(photo):
    attention = attention_saliency(photo).saliency.astype(float)
    relative = attention / attention.mean() + FLOOR
    for power in (1.0, 2.5):
        maps = FittedModel(weights=(power,)).maps(photo)
        expected = (relative / relative.max()) ** power
        np.testing.assert_allclose(maps.saliency, expected, rtol=1e-4)
        assert maps.image_shape == (120, 160)
        assert maps.layers["saliency"] is maps.saliency


def test_the_center_is_a_gaussian(photo):
    model = FittedModel(("center x", "center y"), (-8.0, -2.0))
    saliency = model.maps(photo).saliency
    rows, columns = saliency.shape
    y, x = (np.arange(rows) + 0.5) / rows - 0.5, (np.arange(columns) + 0.5) / columns - 0.5
    expected = np.outer(np.exp(-2 * y**2), np.exp(-8 * x**2))
    np.testing.assert_allclose(saliency, expected / expected.max(), rtol=1e-5)


def test_faces_count_where_they_are_found(photo):
    model = FittedModel(("faces",), (3.0,))
    box = np.array([[40.0, 20.0, 40.0, 40.0]])
    assert np.ptp(model.maps(photo).saliency) == 0
    found = model.maps(photo, lambda image: box).saliency
    assert found.min() == pytest.approx(np.exp(-3), rel=0.15)
    assert found[: found.shape[0] // 2].max() == 1


def test_every_feature_is_computed(photo):
    config = AttentionConfig()
    names = feature_names(config, faces=True)
    assert len(names) == len(set(names)) >= 81
    values = feature_maps(photo, names, config)
    assert values.shape[0] == len(names)
    assert np.isfinite(values).all()
    assert FittedModel(tuple(names), (0.0,) * len(names)).maps(photo).saliency.min() == 1


def test_the_file_holds_the_model(photo, tmp_path):
    config = AttentionConfig(boolean_weight=0.3)
    model = FittedModel(FEATURES, (1.0, 0.5, 0.1, -3.0, 1.0), "140 images", config)
    (tmp_path / "mine.toml").write_text(as_toml(model))
    read = saccade.load_model(tmp_path / "mine.toml")
    assert read == model
    np.testing.assert_array_equal(read.maps(photo).saliency, model.maps(photo).saliency)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("contrast_weight = 1.0", "no setting 'contrast_weight'"),
        ('features = ["soup"]', "features: expected names of features"),
        ('features = ["symmetry around 0"]', "features: expected names"),
        ('features = ["skin * color"]', "features: expected names"),
        ("scanpath_weights = [1.0]", "scanpath_weights: expected 55 finite numbers, or none"),
        ("features = [3]", "features: expected str"),
        ('features = ["color", "skin"]', "weights: expected a finite number for each of the 2"),
        ("weights = [inf]", "weights: expected finite"),
        ("weights = []", "weights: expected a finite number"),
        ("features = [", "expected TOML"),
    ],
)
def test_a_file_that_is_no_model_is_named(tmp_path, text, words):
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ConfigError, match=rf"mine.toml.*{words}"):
        saccade.load_model(tmp_path / "mine.toml")
