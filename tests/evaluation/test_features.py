"""Repeatability and matching, against cases that can be counted by hand and against peers."""

import json
import sys
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from saccade.datasets.homography_pairs import homography_pairs
from saccade.errors import ImageError
from saccade.evaluation.detectors import find_detector
from saccade.evaluation.features import (
    Features,
    FeatureScores,
    PairScores,
    inside,
    score_pair,
)
from saccade.exchange.colmap import import_pycolmap
from saccade.io.image import as_gray
from support.shift import SHIFT


def found(xy, codes=None, shape=(100, 100)):
    """Points whose descriptors are alike where their codes are."""
    xy = np.array(xy, float).reshape(-1, 2)
    codes = np.arange(len(xy)) if codes is None else np.array(codes)
    descriptors = 100 * np.eye(16, dtype=np.uint8)[codes]
    return Features(xy, descriptors, shape, np.ones(len(xy)))


def test_a_perfect_detector_has_full_marks(rng):
    xy = rng.uniform(20, 80, (12, 2))
    scores = score_pair(found(xy), found(xy + np.array([10, 0])), SHIFT)
    assert scores.keypoints == 12
    for name in ("repeatability", "mma_1", "mma_5", "ratio_1", "score"):
        assert getattr(scores, name) == 1, name
    assert scores.localization < 1e-9
    assert scores.auc_1 > 1 - 1e-3


def test_what_is_counted_can_be_counted_by_hand():
    here = [(10, 10), (10, 10), (30, 30), (50, 50), (95, 50)]  # one twice, one outside the other
    there = [(20, 12), (40, 34), (60, 50), (5, 50), (90, 90)]  # one outside; one nobody has
    first, second = found(here, [0, 5, 1, 2, 3]), found(there, [0, 1, 2, 3, 6])
    scores = score_pair(first, second, SHIFT)
    assert scores.repeatability == pytest.approx(4 / 7)  # places at 2, 4, 0 px of 3 and of 4
    assert scores.localization == pytest.approx(1.0)
    assert scores.mma_1 == pytest.approx(1 / 4)  # of 0, 2, 4 and 100 px
    assert scores.mma_3 == pytest.approx(2 / 4)
    assert scores.mma_5 == pytest.approx(3 / 4)
    assert scores.ratio_3 == pytest.approx(2 / 4)
    assert scores.score == pytest.approx(2 / 3)


@pytest.mark.parametrize("xy", [np.zeros((0, 2)), np.array([[5.0, 5.0]])])
def test_few_points_score_without_complaint(xy):
    for first, second in ((found(xy), found([])), (found([]), found(xy))):
        scores = score_pair(first, second, SHIFT)
        assert scores.repeatability == scores.mma_3 == scores.score == scores.auc_10 == 0
        assert scores.localization == 3


def test_points_on_the_edge_are_inside():
    edges = np.array([[0, 0], [9, 4], [9.01, 4], [9, 4.01], [-0.01, 0]])
    np.testing.assert_array_equal(inside(edges, (5, 10)), [True, True, False, False, False])


def test_means_and_intervals():
    def scores(value):
        return PairScores(*[value] * 14)

    result = FeatureScores([("a", "2"), ("a", "3"), ("b", "2")], [scores(v) for v in (1, 2, 6)])
    mean, low, high = result.estimate()
    assert mean == result.mean() == scores(3)
    assert 1 <= low.score < 3 < high.score <= 6
    assert result.of("a").mean() == scores(1.5)


def test_pairs_are_read(scene):
    (pair,) = homography_pairs(scene.parent)
    assert (pair.sequence, pair.first.name, pair.second.name) == ("noise", "1.png", "2.png")
    np.testing.assert_array_equal(pair.homography, SHIFT)
    (scene / "H_1_3.txt").write_text("1 0 0 0 1 0 0 0 1")
    with pytest.raises(ImageError, match=r"noise: expected an image 3\.png"):
        homography_pairs(scene)
    for text in ("1 0 0 0 1", "1 0 0 0 1 0 0 0 x", "0 0 0 0 0 0 0 0 0", "nan 0 0 0 1 0 0 0 1"):
        (scene / "H_1_2.txt").write_text(text)
        with pytest.raises(ImageError, match=r"H_1_2\.txt: expected"):
            homography_pairs(scene)
    with pytest.raises(ImageError, match="nowhere: expected sequences"):
        homography_pairs(scene / "nowhere")


def corners(image):
    """A detector as a user brings it."""
    gray = np.rint(image.mean(axis=2) * 255).astype(np.uint8)
    points, descriptors = cv2.ORB.create().detectAndCompute(gray, None)
    return SimpleNamespace(xy=[point.pt for point in points], descriptors=descriptors)


def nonsense(image):
    return image


def test_evaluate_features(run, scene):
    words = ["evaluate", "features", "--pairs", scene.parent]
    detectors = ["--detector", "sift", "--detector", "opencv", "--detector", f"{__name__}:corners"]
    code, out, _ = run(*words, *detectors, "--json")
    assert code == 0
    result = json.loads(out)
    assert result["pairs"] == 1
    assert list(result["detectors"]) == ["sift", "opencv", f"{__name__}:corners"]
    assert list(result["differences"]) == ["opencv", f"{__name__}:corners"]
    gain = result["differences"]["opencv"]["mean"]["mma_3"]
    means = [result["detectors"][name]["mean"]["mma_3"] for name in ("sift", "opencv")]
    assert gain == pytest.approx(means[1] - means[0])
    for name, scores in result["detectors"].items():
        assert scores["mean"]["mma_3"] > 0.8, name
        assert scores["sequences"]["noise"] == scores["mean"]


def test_evaluate_features_names_what_is_wrong(run, monkeypatch, scene):
    words = ["evaluate", "features", "--pairs", scene, "--detector"]
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    for name, expected in (
        ("colmap", "needs pycolmap"),
        ("surf", "found 'surf'"),
        ("nowhere:detect", "No module named 'nowhere'"),
        (f"{__name__}:SHIFT", "expected a function"),
        (f"{__name__}:nonsense", "expected an object with xy and descriptors"),
    ):
        code, _, err = run(*words, name)
        assert code == 2, name
        assert expected in err
        assert err.strip().count("\n") == 0


@pytest.fixture
def texture(rng):
    """(160, 200, 3) noise in [0, 1] in which there are some hundred points."""
    gray = cv2.GaussianBlur(rng.random((160, 200)), (0, 0), 2)
    gray = np.rint(255 * (gray - gray.min()) / np.ptp(gray)) / 255
    return np.repeat(gray[:, :, None], 3, axis=2)


def test_of_opencvs_points_the_strongest_are_kept(texture):
    points = cv2.SIFT.create().detect(np.rint(255 * texture[:, :, 0]).astype(np.uint8))
    count = 10
    assert len(points) > 2 * count
    kept = find_detector("opencv", None, count)(texture)
    strength = sorted((point.response for point in points), reverse=True)[:count]
    np.testing.assert_array_equal(kept.response, np.float32(strength))


def test_rootsift_of_opencv_is_rootsift(texture):
    """Its points are the same, and squared descriptors sum to 1 in OpenCV's proportions."""
    plain, root = (find_detector(name)(texture) for name in ("opencv", "opencv-root"))
    np.testing.assert_array_equal(root.xy, plain.xy)
    expected = cv2.normalize(plain.descriptors[0].astype(np.float64), None, norm_type=cv2.NORM_L1)
    np.testing.assert_allclose(root.descriptors[0] ** 2, expected.ravel(), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(root.descriptors, axis=1), 1, atol=1e-5)


@pytest.mark.peer
def test_of_colmaps_points_those_are_kept_that_colmap_would_keep(texture):
    """Whole planes of its scale space, from the largest scale on, until there are enough."""
    pytest.importorskip("pycolmap")
    pycolmap = import_pycolmap()
    options = pycolmap.FeatureExtractionOptions()
    options.sift.max_num_features = 20
    gray = np.ascontiguousarray(as_gray(texture), np.float32)
    points, _ = pycolmap.FeatureExtractor.create(options).extract_from_float32_array(gray)
    theirs = {(point.x - 0.5, point.y - 0.5) for point in points}
    kept = find_detector("colmap", None, 20)(texture)
    assert len(kept) == 20
    places = set(map(tuple, kept.xy.tolist()))
    assert len(places - theirs) <= 1  # a point between two planes may count to either
