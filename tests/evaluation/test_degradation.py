"""What is done to images, and points that are counted by places."""

import cv2
import numpy as np
import pytest

from saccade.errors import ConfigError
from saccade.evaluation.features import Degradation

GRAY = np.full((120, 160, 3), 0.5, np.float32)


def test_noise_has_its_deviation_and_its_seed():
    noise = Degradation.parse("noise:20")
    noisy = noise.apply(GRAY, seed=1)
    assert noisy.dtype == np.float32
    assert (255 * noisy).std() == pytest.approx(20, rel=0.02)
    np.testing.assert_array_equal(noisy[:, :, 0], noisy[:, :, 2])  # a grey image stays grey
    np.testing.assert_array_equal(noisy, noise.apply(GRAY, seed=1))
    assert (noisy != noise.apply(GRAY, seed=2)).any()


def test_contrast_is_scaled_about_middle_gray_in_whole_levels():
    ramp = np.arange(256, dtype=np.float32)[None] / 255
    scaled = 255 * Degradation("contrast", 0.25).apply(ramp, 0)
    np.testing.assert_allclose(scaled, np.rint(scaled), atol=1e-4)
    np.testing.assert_allclose(scaled, 127.5 + (255 * ramp - 127.5) / 4, atol=0.51)


def test_blur_is_gaussian():
    spot = np.zeros((41, 41), np.float32)
    spot[20, 20] = 1
    blurred = Degradation("blur", 3.0).apply(spot, 0)
    expected = cv2.getGaussianKernel(25, 3)[12, 0] ** 2
    assert blurred[20, 20] == pytest.approx(expected, abs=1 / 255)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("fog:1", "'fog'"),
        ("noise", "noise:20"),
        ("noise:much", "'noise:much'"),
        ("noise:nan", "noise: expected above 0"),
        ("contrast:2", "contrast: expected above 0, at most 1"),
    ],
)
def test_nonsense_is_refused(text, words):
    with pytest.raises(ConfigError, match=words):
        Degradation.parse(text)
