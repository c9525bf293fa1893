"""Guided matching finds the right partners of repeated structures, which the ratio test refuses."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from saccade import Keypoints, match, match_guided, verify
from saccade.errors import ConfigError, KeypointsError

K = np.array([[800.0, 0, 640], [0, 800, 360], [0, 0, 1]])
LENS = (-0.2, 0.05, 1e-3, -5e-4)
R = cv2.Rodrigues(np.array([0.02, -0.1, 0.01]))[0]
T = np.array([0.9, 0.2, 0.3])
COUNT = 300
DISTINCT = 60
COPIES = 4
"""Number of points that look alike, of those that are not distinct."""


def looks(rng):
    """(n, 128) descriptors of both images: distinct ones, and those of repeated structures."""
    alike = np.repeat(rng.integers(0, 200, ((COUNT - DISTINCT) // COPIES, 128)), COPIES, axis=0)
    every = np.concatenate([rng.integers(0, 200, (DISTINCT, 128)), alike])
    return [(every + rng.integers(0, 8, every.shape)).astype(np.uint8) for _ in range(2)]


def scene(rng, model, lens=(0.0, 0, 0, 0)):
    """Keypoints of both images, in which keypoint i of one is that of the other."""
    xyz = np.c_[rng.uniform(-3, 3, (COUNT, 2)) * [1, 0.6], rng.uniform(5, 10, COUNT)]
    turn, move = R, T
    if model == "planar":
        xyz[:, 2] = 7 + 0.3 * xyz[:, 0]
    elif model == "panoramic":
        move = np.zeros(3)
    xy = [
        cv2.projectPoints(xyz, turned, moved, K, np.array(lens, float))[0][:, 0]
        + rng.normal(0, 0.3, (COUNT, 2))
        for turned, moved in ((np.zeros(3), np.zeros(3)), (cv2.Rodrigues(turn)[0], move))
    ]
    return [
        replace(Keypoints.at(each, 3), descriptors=rows)
        for each, rows in zip(xy, looks(rng), strict=True)
    ]


def is_right(pairs):
    return pairs[:, 0] == pairs[:, 1]


@pytest.mark.parametrize(
    ("model", "geometry"),
    [("general", "fundamental"), ("general", "essential"), ("planar", "homography"),
     ("planar", "essential"), ("panoramic", "fundamental")],
)  # fmt: skip
def test_repeated_structures_are_matched_along_the_geometry(rng, model, geometry):
    names = {"intrinsics": K, "distortion": LENS} if geometry == "essential" else {}
    first, second = scene(rng, model, LENS if names else (0.0, 0, 0, 0))
    pairs = match(first, second)
    assert is_right(pairs).all()
    assert len(pairs) < 1.2 * DISTINCT
    view = verify(first, second, pairs, geometry, **names)
    guided = match_guided(first, second, pairs, view)
    assert len(np.unique(guided[:, 0])) == len(np.unique(guided[:, 1])) == len(guided)
    assert is_right(guided).mean() > 0.95
    assert is_right(guided).sum() > 4.0 * DISTINCT
    again = verify(first, second, guided, geometry, **names)
    assert again.inliers.sum() > 4.0 * DISTINCT
    verified = {*map(tuple, pairs[view.inliers].tolist())}
    assert verified <= {*map(tuple, guided.tolist())}


def test_nothing_is_guided_without_a_geometry(rng):
    first, second = scene(rng, "general")
    pairs = match(first, second)[:10]
    view = verify(first, second, pairs)
    assert view.matrix is None
    np.testing.assert_array_equal(match_guided(first, second, pairs, view), pairs)
    with pytest.raises(KeypointsError, match="pairs: expected those that were verified"):
        match_guided(first, second, pairs[1:], view)
    with pytest.raises(KeypointsError, match=r"pairs: expected an array \(m, 2\), found a list"):
        match_guided(first, second, pairs.tolist(), view)
    for names in ({"ratio": 1.5}, {"tolerance": 0.0}):
        with pytest.raises(ConfigError, match=next(iter(names))):
            match_guided(first, second, pairs, view, **names)
