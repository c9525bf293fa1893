import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade.attention import BooleanConfig, boolean_saliency
from saccade.attention.channels import whitened
from support import oracles_attention
from support.saliency_images import noise


def test_whitened_colors_are_principal_components_of_lab():
    image = (noise(1, (30, 40)) / np.float32(255)).astype(np.float32)
    image[..., 2] = image[..., 1]  # correlated
    found, expected = whitened(image), oracles_attention.whitened(image)
    similarity = np.abs(np.corrcoef(found.reshape(-1, 3).T, expected.reshape(-1, 3).T)[:3, 3:])
    np.testing.assert_allclose(similarity.max(0), 1, atol=1e-3)  # in any order, of any sign
    np.testing.assert_allclose(found.var((0, 1)), 1, atol=1e-3)


def test_the_noise_of_a_gray_image_is_no_color():
    gray = noise(2, (30, 40))[..., :1].repeat(3, 2) / np.float32(255)
    assert sorted(whitened(gray).std((0, 1)).round(3)) == pytest.approx([0, 0, 1], abs=0.05)


@given(st.integers(0, 10**6))
@settings(max_examples=10, deadline=None)
def test_the_sum_of_surrounded_regions_by_labels(seed):
    """By connected components, one threshold after the other, without dilation and blur."""
    image = np.random.default_rng(seed).random((24, 32, 3)).astype(np.float32)
    config = BooleanConfig(thresholds=5, dilation=1, smoothing=0.0)
    summed = np.zeros((24, 32))
    for plane in np.moveaxis(whitened(image), 2, 0):
        low, high = float(plane.min()), float(plane.max())
        for i in range(5):
            above = plane > low + (i + 0.5) / 5 * (high - low)
            for boolean_map in (above, ~above):
                figure = oracles_attention.surrounded(boolean_map)
                summed += figure / max(np.sqrt(figure.sum()), 1)
    expected = (summed - summed.min()) / np.ptp(summed)
    np.testing.assert_allclose(boolean_saliency(image, config).saliency, expected, atol=1e-5)
