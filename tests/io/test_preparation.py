"""Transparent pixels, narrow ranges of values, and masks in a folder."""

import warnings

import cv2
import numpy as np
import pytest

from saccade import ConfigError, ImageError, ImageWarning, Sift, read_image, stretch_contrast
from saccade.io.masks import read_mask
from saccade.io.preparation import opaque_part

PARQUET = "needs the extra `parquet`"
CENTER, RADIUS = np.array([150, 125]), 80


@pytest.fixture(scope="module")
def scene():
    noise = cv2.GaussianBlur(np.random.default_rng(0).random((250, 300)), (0, 0), 3)
    return ((noise - noise.min()) / np.ptp(noise)).astype(np.float32)


def disc(shape):
    return cv2.circle(np.zeros(shape, np.uint8), CENTER.tolist(), RADIUS, 255, -1)


@pytest.mark.parametrize("hidden", [0, 1, None])
def test_the_alpha_channel_is_a_mask(scene, tmp_path, hidden):
    """Whatever the colors of the transparent pixels; of arrays and of files."""
    alpha = disc(scene.shape)
    gray = np.rint(scene * 255).astype(np.uint8)
    if hidden is not None:
        gray[alpha == 0] = 255 * hidden
    pixels = np.dstack([gray, gray, gray, alpha])
    cv2.imwrite(str(tmp_path / "a.png"), pixels)
    with_mask = Sift()(scene, alpha)
    for image in (pixels, read_image(tmp_path / "a.png", keep_alpha=True)):
        points = Sift()(image)
        distance = np.hypot(*(points.xy - CENTER).T)
        assert (distance < RADIUS + 1).all()
        assert abs(len(points) - len(with_mask)) < 0.15 * len(with_mask)
    assert read_image(tmp_path / "a.png").shape == (250, 300, 3)


def test_images_that_are_transparent_all_over_have_no_points(scene):
    assert len(Sift()(np.dstack([scene, scene, scene, 0 * scene]))) == 0
    colors, opaque = opaque_part(np.dstack([scene, scene, scene, 0 * scene + 1]))
    assert opaque is None
    np.testing.assert_array_equal(colors[:, :, 0], scene)


@pytest.mark.parametrize(("low", "span"), [(51241, 940), (7000, 800), (29300, 1500)])
def test_a_narrow_range_of_values_is_reported_and_stretched(scene, low, span):
    """The stretched image has the percentiles of NumPy at 0 and 1, and as many points."""
    thermal = (low + scene * span).astype(np.uint16)
    with pytest.warns(ImageWarning, match="--stretch"):
        assert len(Sift()(thermal)) < 15
    stretched = stretch_contrast(thermal)
    values = np.percentile(thermal, (0.5, 99.5))
    expected = ((thermal - values[0]) / (values[1] - values[0])).clip(0, 1)
    np.testing.assert_allclose(stretched, expected, atol=1e-6)
    assert len(Sift()(stretched)) > 0.8 * len(Sift()(scene))


def test_other_images_with_few_points_are_not_reported(scene):
    dots = np.zeros((200, 200), np.float32)
    dots[100, 100] = dots[50, 30] = 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Sift()(dots)
        Sift()(np.full((200, 200), 0.5, np.float32))
        Sift()(scene)


@pytest.mark.parametrize("percentiles", [(99, 1), (-1, 50), (50, 101), (3, 3)])
def test_percentiles_ascend(scene, percentiles):
    with pytest.raises(ConfigError, match="percentiles"):
        stretch_contrast(scene, percentiles)


@pytest.mark.parametrize("name", ["left/a.jpg", "b.png"])
def test_masks_have_the_names_of_colmap(scene, tmp_path, name):
    """NAME.png, or for PNG images NAME; black where no keypoint is wanted."""
    pytest.importorskip("pyarrow", reason=PARQUET)
    from saccade.batch import Job, extract, open_source, read_points

    images, masks = tmp_path / "images", tmp_path / "masks"
    for each in (images, masks):
        (each / name).parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(images / name), np.rint(scene * 255))
    cv2.imwrite(str(images / "whole.png"), np.rint(scene * 255))
    cv2.imwrite(str(masks / (name if name == "b.png" else f"{name}.png")), disc(scene.shape))
    source = open_source(f"{images}/**/*")
    with pytest.warns(ImageWarning, match=r"whole\.png: found no mask"):
        extract(source, Job("sift", masks=str(masks)), str(tmp_path / "out"))
    found = {each.image: each.points for each in read_points(str(tmp_path / "out"))}
    assert (np.hypot(*(found[name].xy - CENTER).T) < RADIUS + 1).all()
    assert 0 < len(found[name]) < len(found["whole.png"])


def test_masks_are_turned_as_their_images_are(tmp_path):
    """COLMAP's masks are of stored pixels; orientation 6 turns clockwise to be upright."""
    stored = np.zeros((20, 30), np.uint8)
    stored[:5] = 255
    cv2.imwrite(str(tmp_path / "a.jpg.png"), stored)
    upright = read_mask(tmp_path, "a.jpg", 6)
    np.testing.assert_array_equal(upright, cv2.rotate(stored, cv2.ROTATE_90_CLOCKWISE) > 0)


def test_broken_masks_are_named(tmp_path):
    (tmp_path / "a.jpg.png").write_bytes(b"no image")
    with pytest.raises(ImageError, match=r"a\.jpg\.png: expected a mask"):
        read_mask(tmp_path, "a.jpg")
    with pytest.warns(ImageWarning, match=r"image: found no mask .*b\.jpg\.png; the whole image"):
        assert read_mask(tmp_path, "b.jpg") is None
    pytest.importorskip("pyarrow", reason=PARQUET)
    from saccade.batch import Job

    with pytest.raises(ConfigError, match=r"NAME\.png"):
        Job("sift", masks=str(tmp_path / "none"))
    with pytest.raises(ConfigError, match="masks"):
        Job("saliency", masks=str(tmp_path))
