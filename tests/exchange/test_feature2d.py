"""`Feature2D` in the place of `cv2.SIFT_create()`."""

import inspect
from importlib.resources import files

import cv2
import numpy as np
import pytest

import saccade
from saccade.errors import ImageError
from saccade.exchange import Feature2D, from_opencv

HALLWAY = [str(files("saccade") / "data" / f"hallway_{n}.jpg") for n in (1, 2)]
INHERITED = {"create", "read", "write", "save"}
"""Of `cv2.SIFT`: its factory and its settings, which ours has in `SiftConfig`."""


@pytest.fixture(scope="module")
def images():
    return [cv2.imread(path) for path in HALLWAY]


@pytest.fixture(scope="module")
def ours():
    return Feature2D(saccade.Sift())


def test_it_has_what_cv2_sift_has(ours):
    theirs = cv2.SIFT_create()
    for name in dir(theirs):
        if not name.startswith(("_", "get", "set")) and name not in INHERITED:
            assert callable(getattr(ours, name)), name
    for name in ("defaultNorm", "descriptorSize", "descriptorType"):
        assert getattr(ours, name)() == getattr(theirs, name)()
    assert ours.getDefaultName() == "Feature2D.Sift"
    for name in ("detectAndCompute", "detect", "compute"):  # OpenCV's are built in
        told = getattr(theirs, name).__doc__.split(")")[0].split("(")[1]
        words = told.replace("[", "").replace("]", "").replace(" ", "").split(",")
        assert list(inspect.signature(getattr(ours, name)).parameters) == words


def found_by(feature, images):
    """The code of a user: features, matches by both of OpenCV's matchers, and a homography."""
    (kp1, d1), (kp2, d2) = (feature.detectAndCompute(image, None) for image in images)
    flann = cv2.FlannBasedMatcher({"algorithm": 1, "trees": 4}, {"checks": 64})
    counts = []
    for matcher in (cv2.BFMatcher(feature.defaultNorm()), flann):
        pairs = matcher.knnMatch(d1, d2, k=2)
        good = [a for a, b in pairs if a.distance < 0.8 * b.distance]
        src = np.float32([kp1[m.queryIdx].pt for m in good])
        dst = np.float32([kp2[m.trainIdx].pt for m in good])
        _, inlier = cv2.findFundamentalMat(src, dst, cv2.USAC_MAGSAC, 2.0)
        counts.append(int(inlier.sum()))
    crossed = cv2.BFMatcher(feature.defaultNorm(), crossCheck=True).match(d1, d2)
    drawn = cv2.drawMatches(images[0], kp1, images[1], kp2, crossed[:9], None)
    assert drawn.shape[1] == sum(image.shape[1] for image in images)
    return counts


def test_code_written_for_opencv_finds_more_than_with_opencv(ours, images):
    exact, approximate = found_by(ours, images)
    assert exact > found_by(cv2.SIFT_create(), images)[0] > 20
    assert approximate > 0.8 * exact


def test_keypoints_are_those_of_the_detector(ours, images):
    rgb = saccade.read_image(HALLWAY[0])
    expected = saccade.Sift()(rgb)
    keypoints, descriptors = ours.detectAndCompute(images[0], None)
    assert isinstance(keypoints, tuple)
    assert isinstance(keypoints[0], cv2.KeyPoint)
    assert descriptors.dtype == np.float32
    np.testing.assert_array_equal(descriptors, expected.descriptors)
    np.testing.assert_array_equal(from_opencv(keypoints).xy, expected.xy)
    flipped = Feature2D(saccade.Sift(), bgr=False).detectAndCompute(images[0][:, :, ::-1], None)
    np.testing.assert_array_equal(flipped[1], descriptors)
    as_umat = ours.detectAndCompute(cv2.UMat(images[0]), None)[1]
    np.testing.assert_array_equal(as_umat, descriptors)


def test_a_mask_keeps_what_cv2_sift_keeps(ours, images):
    mask = np.zeros(images[0].shape[:2], np.uint8)
    mask[100:220, 130:300] = 255
    for feature in (ours, cv2.SIFT_create()):
        inside = feature.detect(images[0], mask)
        assert 10 < len(inside) < len(feature.detect(images[0]))
        for point in inside:
            assert mask[round(point.pt[1]), round(point.pt[0])] == 255
    with pytest.raises(ImageError, match="mask: expected the image's shape"):
        ours.detect(images[0], mask[:50])


def test_points_of_another_detector_are_described(ours, images):
    corners = cv2.FastFeatureDetector_create(60).detect(images[0])
    outside = cv2.KeyPoint(1e4, 10, 7, 0)
    kept, rows = ours.compute(images[0], [outside, *corners])
    assert [point.pt for point in kept] == [point.pt for point in corners]
    assert rows.shape == (len(corners), 128)
    assert rows.any(axis=1).all()
    keypoints, descriptors = ours.detectAndCompute(images[0], None)
    again = ours.compute(images[0], keypoints)[1]
    assert (np.abs(again - descriptors) <= 1).mean() > 0.999  # angles in float32 degrees


def test_a_flat_image_has_what_opencv_says_of_it(ours):
    flat = np.full((60, 80), 7, np.uint8)
    theirs = cv2.SIFT_create()
    for feature in (ours, theirs):
        assert feature.detectAndCompute(flat, None) == ((), None)
        assert feature.detect(flat) == ()
        assert feature.compute(flat, []) == ((), None)


@pytest.mark.parametrize("name", ["attention", "contrast", "symmetry", "boolean"])
@pytest.mark.parametrize("alpha", [False, True])
def test_images_of_opencv_are_seen_as_they_are(images, name, alpha):
    saliency = getattr(saccade, f"{name}_saliency")
    bgr = images[0][::3, ::3].copy()
    bgr[40:60, 50:80] = (200, 90, 20)
    if alpha:
        bgr = cv2.cvtColor(bgr, cv2.COLOR_BGR2BGRA)
        bgr[:20, :, 3] = 100
    rgb = cv2.cvtColor(bgr, cv2.COLOR_BGRA2RGBA if alpha else cv2.COLOR_BGR2RGB)
    told = saliency(bgr, bgr=True).saliency
    np.testing.assert_array_equal(told, saliency(rgb).saliency)
    assert (told != saliency(bgr).saliency).any()
    gray = bgr[:, :, 0].copy()
    np.testing.assert_array_equal(saliency(gray, bgr=True).saliency, saliency(gray).saliency)
