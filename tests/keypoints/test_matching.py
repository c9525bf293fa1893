from unittest import mock

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.distance import cdist

from saccade.errors import ConfigError
from saccade.keypoints import match, matching
from saccade.types import Keypoints


def points(descriptors):
    n = 7 if descriptors is None else len(descriptors)
    zeros = np.zeros(n, np.float32)
    return Keypoints(
        np.zeros((n, 2), np.float32), zeros, zeros, zeros, np.zeros(n, np.int32), descriptors
    )


def noisy_pair(rng, n=300, k=400):
    a = rng.integers(0, 200, (n, 128))
    b = rng.integers(0, 200, (k, 128))
    shared = rng.permutation(k)[: n // 2]
    b[shared] = a[: n // 2] + rng.integers(-25, 26, (n // 2, 128)) * rng.integers(1, 4, (n // 2, 1))
    return a.astype(np.uint8), b.clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("block", [(7, 1), (64, 100), (512, 2048)])
def test_mutual_pairs_are_opencvs(rng, monkeypatch, block):
    monkeypatch.setattr(matching, "ROWS", block[0])
    monkeypatch.setattr(matching, "COLUMNS", block[1])
    a, b = noisy_pair(rng)
    theirs = cv2.BFMatcher(cv2.NORM_L2, crossCheck=True).match(
        a.astype(np.float32), b.astype(np.float32)
    )
    ours = match(points(a), points(b), ratio=None)
    assert len(ours) > 150
    np.testing.assert_array_equal(ours, sorted((m.queryIdx, m.trainIdx) for m in theirs))


@pytest.mark.parametrize("ratio", [0.6, 0.8, 0.95])
def test_ratio_test_is_opencvs(rng, ratio):
    a, b = noisy_pair(rng)
    neighbors = cv2.BFMatcher(cv2.NORM_L2).knnMatch(a.astype(np.float32), b.astype(np.float32), k=2)
    theirs = [
        (first.queryIdx, first.trainIdx)
        for first, second in neighbors
        if first.distance < ratio * second.distance
    ]
    ours = match(points(a), points(b), ratio=ratio, mutual=False)
    assert 0 < len(ours) < len(a)
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("block", [{"ROWS": 1, "COLUMNS": 2}, {"ROWS": 512}])
@given(data=st.data())
@settings(max_examples=40)
def test_neighbors_are_exact(block, data):
    """Whole numbers, many of them equally near: the first of the nearest, both ways."""
    d = data.draw(st.integers(1, 4))
    sides = st.integers(1, 6)
    values = st.sampled_from([0, 1, 2, 254, 255])
    a = data.draw(hnp.arrays(np.uint8, (data.draw(sides), d), elements=values))
    b = data.draw(hnp.arrays(np.uint8, (data.draw(sides), d), elements=values))
    with mock.patch.multiple(matching, **block):
        nearest, distance, runner_up, back = matching.nearest_neighbors(a, b)
    table = cdist(a.astype(float), b.astype(float), "sqeuclidean")
    np.testing.assert_array_equal(nearest, table.argmin(axis=1))
    np.testing.assert_array_equal(back, table.argmin(axis=0))
    ordered = np.sort(np.c_[table, np.full(len(a), np.inf)], axis=1)
    np.testing.assert_array_equal(distance, ordered[:, 0])
    np.testing.assert_array_equal(runner_up, ordered[:, 1])


def test_the_longest_descriptors_stay_exact(rng):
    a = rng.integers(0, 256, (20, 128)).astype(np.uint8)
    a[0], a[1], a[2] = 0, 255, 255
    _, distance, runner_up, _ = matching.nearest_neighbors(a[:2], a[1:])
    table = np.sort(cdist(a[:2].astype(float), a[1:].astype(float), "sqeuclidean"), axis=1)
    np.testing.assert_array_equal(np.stack([distance, runner_up], axis=1), table[:, :2])


@pytest.mark.parametrize(("n", "k"), [(0, 0), (0, 5), (5, 0)])
@pytest.mark.parametrize("mutual", [True, False])
def test_nothing_to_match(n, k, mutual):
    pairs = match(
        points(np.zeros((n, 128), np.uint8)), points(np.ones((k, 128), np.uint8)), mutual=mutual
    )
    assert pairs.shape == (0, 2)
    assert pairs.dtype == np.int64


def test_a_single_candidate_has_no_rival(rng):
    a = rng.integers(0, 256, (4, 128)).astype(np.uint8)
    np.testing.assert_array_equal(match(points(a), points(a[2:3])), [[2, 0]])


def test_what_cannot_be_matched(rng):
    described = points(np.zeros((3, 128), np.uint8))
    with pytest.raises(ConfigError, match=r"second: expected keypoints with descriptors.*describe"):
        match(described, points(None))
    with pytest.raises(ConfigError, match=r"second: expected descriptors of length 128.*found 64"):
        match(described, points(np.zeros((3, 64), np.uint8)))
    for value in (np.nan, np.inf, 1e30):
        broken = np.zeros((3, 64), np.float32)
        broken[1, 5] = value
        with pytest.raises(ConfigError, match=r"second: expected finite descriptors.*keypoint 1"):
            match(points(np.zeros((3, 64), np.float32)), points(broken))
    for ratio in (0, -1, 1.5, float("nan")):
        with pytest.raises(ConfigError, match="ratio: expected"):
            match(described, described, ratio=ratio)
