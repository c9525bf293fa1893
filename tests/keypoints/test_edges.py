"""Images at the edge of what is one: found, described and matched, or refused in one line."""

import cv2
import numpy as np
import pytest

from saccade import Keypoints, Sift, SiftConfig, match, verify
from saccade.errors import ImageError
from support.sift_images import PRESETS, assert_same, texture


def through_all(image, **settings):
    """Detect, describe again with and without new angles, match with itself, verify."""
    sift = Sift(SiftConfig(**settings))
    found = sift(image)
    assert_same(sift.describe(image, found), found)
    oriented = sift.describe(image, found, orient=True)
    pairs = match(found, found)
    assert (pairs[:, 0] == pairs[:, 1]).all()
    verify(found, found, pairs)
    assert oriented.descriptors.dtype == np.uint8
    return found


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (16, 16), (16, 500), (479, 641)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64, np.bool_])
def test_a_black_image_has_no_points(shape, dtype):
    assert len(through_all(np.zeros(shape, dtype))) == 0
    assert len(through_all(np.zeros((*shape, 3), dtype))) == 0


def test_one_spot_in_16_by_16():
    image = np.zeros((16, 16), np.uint8)
    cv2.circle(image, (8, 8), 2, 255, -1)
    found = through_all(image, upright=True)
    assert len(found) >= 1
    np.testing.assert_allclose(found.xy[0], [8, 8], atol=0.05)


def test_noise_of_any_shape(rng):
    for shape in ((16, 16), (16, 400), (301, 17), (64, 64, 3), (64, 64, 4)):
        through_all(rng.integers(0, 256, shape).astype(np.uint8), max_keypoints=300)


KINDS = {
    "float32": lambda gray: gray.astype(np.float32) / 255,
    "float64": lambda gray: gray.astype(np.float64) / 255,
    "16 bit": lambda gray: gray.astype(np.uint16) * 257,
    "big-endian": lambda gray: (gray.astype(np.float32) / 255).astype(">f4"),
    "read-only": lambda gray: np.frombuffer(gray.tobytes(), np.uint8).reshape(gray.shape),
    "Fortran": np.asfortranarray,
    "strided": lambda gray: np.repeat(np.repeat(gray, 2, axis=0), 3, axis=1)[::2, ::3],
    "flipped": lambda gray: gray[::-1, ::-1].copy()[::-1, ::-1],
    "a list": lambda gray: (gray / 255).tolist(),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("preset", ["recommended", "opencv"])
def test_an_image_of_any_kind_has_the_same_points(rng, kind, preset):
    gray = np.rint(texture(rng, (90, 110)) * 255).astype(np.uint8)
    sift = Sift(PRESETS[preset])
    expected, image = sift(gray), KINDS[kind](gray)
    found = sift(image)
    assert len(found) == len(expected) > 20
    np.testing.assert_allclose(found.xy, expected.xy, atol=1e-3)
    again = sift.describe(image, expected)
    assert np.abs(again.descriptors.astype(int) - expected.descriptors).max() <= 1


def test_16_bits_are_all_looked_at(rng):
    """What 8 bits would round away still has its points."""
    dim = texture(rng, (100, 100)) * (60 / 65535)
    config = SiftConfig(contrast_threshold=0.0155 * 60 / 65535)
    assert len(Sift(config)(np.rint(dim * 65535).astype(np.uint16))) > 50
    assert len(Sift(config)(np.rint(dim * 255).astype(np.uint8))) == 0


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.full((20, 20), np.nan), "finite values, found NaN"),
        (np.where(np.eye(20) > 0, np.nan, 0.5), "finite values, found NaN"),
        (np.full((20, 20), np.inf), "finite values, found NaN or infinity"),
        (np.full((20, 20), -1.0), r"float values in \[0, 1\]"),
        (np.full((20, 20), 255.0), r"float values in \[0, 1\], found 255 to 255; scale it"),
        (np.zeros((20, 20), np.int32), "uint8, uint16, bool or float, found int32"),
        (np.zeros((20, 20), complex), "uint8, uint16, bool or float, found complex"),
        (np.zeros((0, 20)), "at least one pixel"),
        (np.zeros(20), r"shape \(H, W\)"),
        (np.zeros((2, 3, 20, 20)), r"shape \(H, W\)"),
        ("photo.jpg", r"shape \(H, W\)"),
        (None, r"shape \(H, W\)"),
    ],
)
def test_what_is_no_image_is_named_by_both(image, words):
    for call in (Sift(), lambda each: Sift().describe(each, Keypoints.at([], 1))):
        with pytest.raises(ImageError, match=f"image: expected.*{words}") as caught:
            call(image)
        assert "\n" not in str(caught.value)
