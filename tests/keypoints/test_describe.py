"""Description of points that are given: our own, OpenCV's, and from anywhere."""

import dataclasses
from importlib.resources import files

import cv2
import numpy as np
import pytest

from saccade import Keypoints, Sift, SiftConfig, exchange
from saccade.errors import ImageError, KeypointsError
from saccade.keypoints.scale_space_points import locate
from saccade.scale.scale_space import gaussian_scale_space
from support.sift_images import PRESETS, assert_same, texture

ROCKET = str(files("saccade") / "data" / "rocket.jpg")


def cosines(a, b):
    a, b = a.astype(float), b.astype(float)
    return (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)


@pytest.fixture(scope="module")
def photo():
    return cv2.imread(ROCKET, cv2.IMREAD_GRAYSCALE)


@pytest.mark.parametrize("preset", PRESETS)
def test_our_own_points_are_described_to_the_same_bytes(rng, photo, preset):
    sift = Sift(PRESETS[preset])
    for image in (photo, texture(rng, (301, 222))):
        found = sift(image)
        assert len(np.unique(found.octave)) > 2
        assert_same(sift.describe(image, found), found)
        some = found[rng.permutation(len(found))[: len(found) // 2]]
        assert_same(sift.describe(image, some), some)


def test_opencvs_points_are_described_as_opencv_does(photo):
    theirs, descriptors = cv2.SIFT_create().detectAndCompute(photo, None)
    given = exchange.from_opencv(theirs, descriptors)
    again = Sift(SiftConfig.opencv()).describe(photo, given)
    cosine = cosines(again.descriptors, descriptors)
    print(f"\nmedian {np.median(cosine):.5f}, 1st percentile {np.percentile(cosine, 1):.4f}")
    assert np.median(cosine) > 0.9998
    assert np.percentile(cosine, 1) > 0.998


def test_orientations_are_those_that_opencv_finds(photo):
    theirs, _ = cv2.SIFT_create().detectAndCompute(photo, None)
    given = exchange.from_opencv(theirs)
    places, index = np.unique(given.xy, axis=0, return_index=True)
    bare = dataclasses.replace(given[index], angle=np.zeros(len(places), np.float32))
    oriented = Sift(SiftConfig.opencv()).describe(photo, bare, orient=True)
    found = 0
    for xy, angle in zip(given.xy, given.angle, strict=True):
        here = (oriented.xy == xy).all(axis=1)
        turn = np.abs(np.angle(np.exp(1j * (oriented.angle[here] - angle))))
        found += len(turn) > 0 and turn.min() < np.radians(2)
    assert found > 0.98 * len(given)
    assert abs(len(oriented) - len(given)) < 0.02 * len(given)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("size", [1e-3, 0.5, 5, 300, 1e6])
def test_any_size_at_any_edge_is_described(rng, preset, size):
    image = texture(rng, (40, 50))
    corners = [[-0.5, -0.5], [49.5, -0.5], [-0.5, 39.5], [49.5, 39.5], [0, 20], [24, 18]]
    for orient in (False, True):
        found = Sift(PRESETS[preset]).describe(image, Keypoints.at(corners, size), orient=orient)
        assert found.descriptors.shape == (len(found), 128)
        assert np.isfinite(found.angle).all()
        if not orient:
            assert len(found) == 6
            # Of a wide point the print's 16 x 16 samples all lie outside.
            beside = size < 1 or (preset == "kootstra2010" and size >= 300)
            assert found.descriptors[5].any() or beside


def test_a_black_image_has_empty_descriptors_and_no_orientation():
    image, point = np.zeros((30, 30)), Keypoints.at([[15, 15]], 6)
    assert not Sift().describe(image, point).descriptors.any()
    assert Sift().describe(image, point, orient=True).descriptors.shape == (0, 128)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            {"xy": [[3, 3], [-1, 5]]},
            r"position in the image of 30 x 20 px, found \[-1.0, 5.0\] at poi",
        ),
        ({"xy": [[3, 3], [5, 19.6]]}, r"found \[5.0, 19.6.*\] at point 1"),
        ({"xy": [[29.6, 3], [5, 5]]}, r"found \[29.6.*\] at point 0"),
        ({"xy": [[3, -0.6], [5, 5]]}, r"found \[3.0, -0.6.*\] at point 0"),
        ({"xy": [[3, 3], [np.nan, 5]]}, r"found \[nan, 5.0\] at point 1"),
        ({"size": [4, 0]}, "a size over 0 px, found 0.0 at point 1"),
        ({"size": [np.inf, 4]}, "a size over 0 px, found inf at point 0"),
        ({"size": [4]}, r"size: expected shape \(2,\), found \(1,\)"),
        ({"angle": [0, np.nan]}, "a finite angle, found nan at point 1"),
    ],
)
def test_points_that_cannot_be_described_are_named(fields, words):
    given = dataclasses.replace(
        Keypoints.at([[3, 3], [4, 4]], 5), **{name: np.array(each) for name, each in fields.items()}
    )
    with pytest.raises(KeypointsError, match=f"^keypoints: .*{words}"):
        Sift().describe(np.zeros((20, 30)), given)


def test_an_image_too_small_to_describe_is_named():
    point = Keypoints.at([[4, 3]], 3)
    for first_octave, side in ((-1, 5), (0, 8)):
        sift = Sift(SiftConfig(first_octave=first_octave, density=1.0))
        assert len(sift.describe(np.zeros((side, 30)), point)) == 1
        with pytest.raises(ImageError, match=f"8 samples a side.*image of 30 x {side - 1} px"):
            sift.describe(np.zeros((side - 1, 30)), point)


@pytest.mark.parametrize("first_octave", [-1, 0])
def test_a_point_lies_in_the_octave_of_its_size(first_octave):
    """The plane's blur is the point's scale, to half an interval."""
    config = SiftConfig(first_octave=first_octave)
    space = gaussian_scale_space(
        np.zeros((200, 200), np.float32),
        config,
    )
    sizes = np.geomspace(4.4, 60, 50)
    points = dataclasses.replace(
        Keypoints.at(np.full((50, 2), 90.0), sizes), octave=np.full(50, 99, np.int32)
    )
    octave, plane, xy, sigma, *_ = locate(points, space, config)
    np.testing.assert_allclose(sigma * space.spacing[octave], sizes / 2, rtol=1e-6)
    np.testing.assert_allclose(
        space.origin[octave] + xy * space.spacing[octave, None], 90, rtol=1e-6
    )
    extra = config.extra_intervals
    level = plane + np.where(octave > 0, extra, 0)
    blur = config.density * config.base_sigma * 2 ** (level / config.intervals)
    assert (np.abs(np.log2(blur / sigma)) * config.intervals <= 0.5 + 1e-9).all()
    assert ((plane >= 1) & (plane <= config.intervals + np.where(octave > 0, 0, extra))).all()


@pytest.mark.parametrize("own", [0, 1])
def test_a_point_stays_in_its_own_octave_while_that_has_a_plane_of_its_size(own):
    """The first octave has two intervals more."""
    config = SiftConfig()
    space = gaussian_scale_space(np.zeros((200, 200), np.float32), config)
    level = np.arange(7 if own == 0 else 5) + (0 if own == 0 else 5)  # of its planes
    level = np.append(level, level[-1] + 1)
    sizes = 2 * config.base_sigma * 2 ** (level / 3 + config.first_octave)
    points = Keypoints.at(np.full((len(sizes), 2), 90.0), sizes)
    points.octave[:] = own + config.first_octave
    octave = locate(points, space, config).octave
    assert (octave[:-1] == own).all()
    assert octave[-1] == own + 1
