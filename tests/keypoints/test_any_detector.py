"""What holds for every detector, whatever it looks for."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from saccade import Must, MustConfig, Sift, SiftConfig, SymRoid, SymRoidConfig
from saccade.errors import ImageError
from support.sift_images import PRESETS, assert_same
from support.symmetric_images import texture

DETECTORS = {
    **{name: (Sift, config) for name, config in PRESETS.items()},
    **{f"must {each}": (Must, MustConfig(max_keypoints=15, spread=each)) for each in (False, True)},
    "must of 2010": (Must, MustConfig.kootstra2010()),
    "symroid": (SymRoid, SymRoidConfig(max_keypoints=None)),
}
each_detector = pytest.mark.parametrize("name", DETECTORS)


def points_of(found):
    """Points alone, of regions too."""
    return getattr(found, "keypoints", found)


@each_detector
def test_threads_change_nothing_nor_does_what_was_seen_before(name):
    kind, config = DETECTORS[name]
    images = [texture(seed, (180, 200 + 20 * seed)) for seed in range(2)]
    before = cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        expected = [points_of(kind(config, threads=1)(image)) for image in images]
        cv2.setNumThreads(4)
        detect = kind(config, threads=3)
        with ThreadPoolExecutor(2) as pool:
            for found, alone in zip(pool.map(detect, images), expected, strict=True):
                assert_same(points_of(found), alone)
        assert_same(points_of(detect(images[0])), expected[0])
    finally:
        cv2.setNumThreads(before)


@each_detector
def test_the_strongest_are_first_and_the_image_is_left_alone(name):
    kind, config = DETECTORS[name]
    image = texture(7, (240, 320))
    before = image.copy()
    points = points_of(kind(config)(image))
    np.testing.assert_array_equal(image, before)
    assert 0 < len(points) <= (config.max_keypoints or 10**6)
    strength = points.response
    if getattr(config, "ranking", "") == "signal-to-noise":
        strength = strength / np.hypot(2 / points.size, 50 / (config.max_keypoints or np.inf))
    assert (np.diff(strength) <= 1e-6 * strength[1:]).all()


@pytest.mark.parametrize("shape", [(16, 400), (301, 17), (64, 64, 3), (64, 64, 4)])
def test_noise_of_any_shape_is_described_again_to_the_same_bytes(rng, shape):
    image = rng.integers(0, 256, shape).astype(np.uint8)
    found = Sift(SiftConfig(max_keypoints=300))(image)
    assert_same(Sift().describe(image, found), found)


@pytest.mark.parametrize("detect", [Sift(), Must()])
def test_a_mask_keeps_the_points_under_it(detect):
    image = texture(3, (120, 150))
    mask = np.zeros(image.shape, bool)
    mask[:, 30:90] = True
    every = detect(image)
    column = np.rint(every.xy[:, 0])
    assert_same(detect(image, mask), every[(column >= 30) & (column < 90)])
    with pytest.raises(ImageError, match=r"mask: expected.*\(120, 150\), found \(150, 120\)"):
        detect(image, mask.T)
    with pytest.raises(ImageError, match="image: expected finite values, found NaN"):
        detect(np.full((20, 20), np.nan))


@pytest.mark.parametrize("shape", [(80, 80), (1, 1), (5, 300)])
@each_detector
def test_a_flat_or_tiny_image_has_none(name, shape):
    kind, config = DETECTORS[name]
    for value in (0.0, 0.3, 1.0):
        assert points_of(kind(config)(np.full(shape, value))).descriptors.shape == (0, 128)
