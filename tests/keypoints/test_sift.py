import dataclasses
import itertools
from importlib.resources import files

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from saccade.keypoints import Sift, SiftConfig, match
from saccade.keypoints.descriptor import assign_orientations
from saccade.keypoints.detection import by_strength, preferred
from saccade.keypoints.scale_space_points import Points
from saccade.scale.scale_space import gaussian_scale_space
from saccade.scale.scale_space_config import ScaleSpaceConfig
from support.sift_images import PRESETS, UNBIASED, features, texture

CENTERED = [name for name in PRESETS if PRESETS[name].grid == "centered"]
ROCKET = str(files("saccade") / "data" / "rocket.jpg")
SCENES = ("bark", "graf", "leuven", "wall")


def blob(shape, x, y, sigma):
    row, column = np.indices(shape)
    spot = np.exp(-((column - x) ** 2 + (row - y) ** 2) / (2 * sigma**2))
    return (0.2 + 0.6 * spot).astype(np.float32)


@pytest.mark.shared
@pytest.mark.parametrize("scene", SCENES)
def test_opencv_preset_is_opencv(shared, scene):
    gray = cv2.imread(str(shared / "data/pairs/oxford" / scene / "1.png"), cv2.IMREAD_GRAYSCALE)
    theirs, their_descriptors = cv2.SIFT_create().detectAndCompute(gray, None)
    ours = Sift(SiftConfig.opencv())(gray)
    tree = cKDTree(ours.xy)
    cosines = []
    for point, descriptor in zip(theirs, their_descriptors.astype(float), strict=True):
        near = np.array(tree.query_ball_point(point.pt, 0.5), int)
        turn = np.degrees(ours.angle[near]) - point.angle
        turn = np.abs((turn + 180) % 360 - 180)
        near = near[(np.abs(ours.size[near] / point.size - 1) <= 0.05) & (turn <= 5)]
        if len(near):
            found = ours.descriptors[near].astype(float)
            norms = np.linalg.norm(found, axis=1) * np.linalg.norm(descriptor)
            cosines.append((found @ descriptor / norms).max())
    found = len(cosines) / len(theirs)
    print(
        f"\n{scene}: OpenCV {len(theirs)}, ours {len(ours)}, found {found:.2%}, "
        f"median cosine {np.median(cosines):.5f}, 1st percentile {np.percentile(cosines, 1):.4f}"
    )
    assert found > 0.995
    assert np.median(cosines) > 0.999
    assert len(ours) < 1.01 * len(theirs)


@pytest.mark.parametrize("sigma", [1.5, 1.8, 2.5, 3.5, 5.0, 8.0])
@pytest.mark.parametrize("preset", ["lowe2004", "colmap"])
def test_a_blob_is_found_at_its_center(rng, preset, sigma):
    config = dataclasses.replace(PRESETS[preset], upright=True)
    for x, y in [(48, 48), (48.5, 48.5), (48.5, 49), *(48 + rng.random((6, 2)))]:
        found = Sift(config)(blob((97, 98), x, y, sigma), describe=False)
        assert len(found) == 1
        np.testing.assert_allclose(found.xy, [[x, y]], atol=0.004)


@pytest.mark.parametrize("sigma", 1.3 * 2 ** np.linspace(0, 3, 16))
def test_a_blob_of_any_size_is_found(rng, sigma):
    """Sparse samples leave a little more error, and a scale between two octaves is in both."""
    sift = Sift(dataclasses.replace(SiftConfig(), upright=True))
    for x, y in [(60, 60), (60.5, 60.5), (60.5, 61), *(60 + rng.random((6, 2)))]:
        found = sift(blob((121, 122), x, y, sigma), describe=False)
        assert 1 <= len(found) <= 2
        np.testing.assert_allclose(found.xy, np.tile([x, y], (len(found), 1)), atol=0.012)


@pytest.mark.parametrize("preset", UNBIASED)
@pytest.mark.parametrize("sigma", [3.5, 6.0])
def test_the_size_of_a_blob(preset, sigma):
    """Differences of blurs s and k s answer most to a Gaussian of variance k s^2."""
    config = dataclasses.replace(PRESETS[preset], upright=True, camera_sigma=0.0)
    found = Sift(config)(blob((128, 128), 63.2, 64.4, sigma), describe=False)
    expected = 2 * sigma / 2 ** (0.5 / config.intervals)
    np.testing.assert_allclose(found.size, np.full(len(found), expected), rtol=0.02)


@pytest.mark.parametrize("shape", [(160, 200), (161, 189), (130, 171)])
@pytest.mark.parametrize("preset", CENTERED)
@pytest.mark.parametrize("turned", [False, True])
def test_a_mirrored_or_turned_image_has_its_points_mirrored_or_turned(rng, shape, preset, turned):
    image = texture(rng, shape)
    last = shape[1] - 1
    sift = Sift(PRESETS[preset])
    here = sift(image)
    if turned:
        there = sift(np.rot90(image))
        xy = np.c_[here.xy[:, 1], last - here.xy[:, 0]]
        angle = here.angle - np.pi / 2
    else:
        there = sift(image[:, ::-1])
        xy = np.c_[last - here.xy[:, 0], here.xy[:, 1]]
        angle = np.pi - here.angle
    assert len(here) > 100
    assert abs(len(there) - len(here)) <= 0.01 * len(here)
    distance, index = cKDTree(features(there.xy, there.size, there.angle)).query(
        features(xy, here.size, angle)
    )
    assert (distance < 0.02).mean() > 0.99
    assert np.abs(there.xy[index] - xy).max(axis=1)[distance < 0.02].max() < 0.005
    if turned:
        difference = here.descriptors.astype(int) - there.descriptors[index]
        assert np.percentile(np.abs(difference).max(axis=1), 99) <= 6


@pytest.mark.parametrize("degrees", [17, 45, 101])
def test_matches_survive_a_rotation(rng, degrees):
    image = texture(rng, (200, 200))
    turn = cv2.getRotationMatrix2D((99.5, 99.5), degrees, 1.0)
    rotated = cv2.warpAffine(image, turn, (200, 200), flags=cv2.INTER_LANCZOS4).clip(0, 1)
    sift = Sift()
    here, there = sift(image), sift(rotated)
    pairs = match(here, there)
    expected = here.xy[pairs[:, 0]] @ turn[:, :2].T + turn[:, 2]
    error = np.hypot(*(there.xy[pairs[:, 1]] - expected).T)
    assert len(pairs) > 100
    assert (error < 1).mean() > 0.95
    assert np.median(error) < 0.06


def test_equal_points_are_ordered_by_row_column_size_and_angle(rng):
    space = gaussian_scale_space(np.zeros((20, 20), np.float32), ScaleSpaceConfig())
    n = 81
    row, column, sigma, angle = np.array(list(itertools.product(range(3), repeat=4)), np.float32).T
    points = Points(
        np.zeros(n, np.int64),
        np.ones(n, np.int64),
        np.stack([column, row], axis=1),
        1 + sigma,
        angle,
        np.ones(n, np.float32),
    )
    shuffled = points.take(rng.permutation(n))
    ordered = shuffled.take(by_strength(shuffled, space, SiftConfig(ranking="response")))
    for field, expected in zip(ordered, points, strict=True):
        np.testing.assert_array_equal(field, expected)
    assert len(preferred(points, space, SiftConfig(max_keypoints=7))) == 7


def test_a_point_beside_the_last_pixel_is_under_it():
    space = gaussian_scale_space(np.zeros((20, 30), np.float32), ScaleSpaceConfig(first_octave=0))
    mask = np.zeros((20, 30), bool)
    mask[:, 29] = mask[19] = True
    places = np.array([[29.4, 9], [29.6, 9], [28.4, 9], [7, 19.6], [-0.6, 19.6], [7, 18.4]])
    places = ((places - space.origin[0]) / space.spacing[0]).astype(np.float32)
    number, real = np.zeros(6, np.int64), np.ones(6, np.float32)
    points = Points(number, number, places, real, real, np.arange(6, dtype=np.float32))
    assert points.inside(mask, space).response.tolist() == [0, 1, 3, 4]


def test_upright(rng):
    image = texture(rng, (100, 100))
    upright = Sift(SiftConfig(upright=True))(image)
    turned = Sift()(image)
    assert not upright.angle.any()
    assert len(np.unique(upright.xy, axis=0)) == len(upright)
    assert {tuple(p) for p in turned.xy} <= {tuple(p) for p in upright.xy}


def test_of_two_orientations_the_stronger_is_kept():
    column = np.tile(np.arange(41.0, dtype=np.float32), (41, 1))[None]
    number, real = np.zeros(1, int), np.ones(1, np.float32)
    point = Points(number, number, np.array([[20, 20]], np.float32), real, 0 * real, real)
    for left, right, expected in ((0.9, 1.0, [0, np.pi]), (1.0, 0.9, [np.pi, 0])):
        slope = np.where(column < 20, np.float32(left), np.float32(right))
        roof = slope * np.abs(column - 20)
        _, both = assign_orientations([roof], point, SiftConfig())
        _, one = assign_orientations([roof], point, SiftConfig(), max_orientations=1)
        np.testing.assert_allclose(np.abs(both), [0, np.pi], atol=1e-3)
        np.testing.assert_allclose(np.abs(one), expected[:1], atol=1e-3)


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
@pytest.mark.parametrize("preset", ["default", "opencv"])
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


@pytest.mark.parametrize("degrees", [10, 30])
def test_positions_for_mapping_are_more_exact(degrees):
    """By the known rotation of an image, of more points."""
    image = cv2.imread(ROCKET, cv2.IMREAD_GRAYSCALE)
    height, width = image.shape
    turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, 1)
    rolled = cv2.warpAffine(image, turn, (width, height), flags=cv2.INTER_LANCZOS4)
    found = {}
    for preset in ("default", "mapping"):
        here, there = (Sift(PRESETS[preset])(each) for each in (image, rolled))
        pairs = match(here, there)
        expected = here.xy[pairs[:, 0]] @ turn[:, :2].T + turn[:, 2]
        errors = np.hypot(*(expected - there.xy[pairs[:, 1]]).T)
        right = errors < 2
        found[preset] = right.sum(), np.sqrt(np.mean(errors[right] ** 2))
    assert found["mapping"][0] > found["default"][0]
    assert found["mapping"][1] < 0.8 * found["default"][1]
