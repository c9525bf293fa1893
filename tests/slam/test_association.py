"""Who is who: gates, exclusion, and what becomes a landmark."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import chi2

from saccade.errors import LogError
from saccade.slam import (
    ERRORS,
    EkfConfig,
    EkfSlam,
    observe,
)
from saccade.slam.association._kernels import prefilter_landmarks, squared_distance
from saccade.slam.association.labels import LabelAssociation
from saccade.slam.association.nearest_neighbor import (
    Gates,
    associate_by_geometry,
    mahalanobis_squared,
)
from saccade.slam.association.outcomes import DROPPED, NEW
from saccade.slam.association.rules import RULES
from saccade.slam.landmarks import CullingPolicy, LandmarkTable

R = np.diag([0.01, 1e-4])
GREEDY = Gates(chi2.ppf(0.99, 2), chi2.ppf(0.9999, 2), RULES["nearest"].pairing)
WORLD = np.array([[5.0, 1.0], [6.0, -2.0], [8.0, 0.0], [-3.0, 4.0]])


def _filter(landmarks=WORLD, spread=1e-4):
    ekf = EkfSlam(np.zeros(3), spread * np.eye(3))
    for landmark in landmarks:
        ekf.augment(observe(np.zeros(3), landmark)[0], R)
    return ekf


def _scan(places):
    z, _ = observe(np.zeros(3), np.atleast_2d(places))
    return z, np.tile(R, (len(z), 1, 1))


def test_a_landmark_takes_the_nearer_of_two_observations():
    z, noise = _scan([WORLD[0] + [0.15, 0], WORLD[0] + [0.02, 0]])
    assert associate_by_geometry(_filter(), z, noise, GREEDY).tolist() == [DROPPED, 0]


def test_near_is_taken_far_is_new_and_between_is_dropped():
    ekf = _filter(WORLD[:1])
    sigma = np.sqrt(ekf.predict_observations().covariance[0, 0, 0] + R[0, 0])
    z, noise = _scan(WORLD[[0, 0, 0]])
    z[:, 0] += np.array([2.5, 3.5, 5.0]) * sigma  # gates at 3.03 and 4.29 sigma
    found = [int(associate_by_geometry(ekf, z[i : i + 1], noise[:1], GREEDY)[0]) for i in range(3)]
    assert found == [0, DROPPED, NEW]


def test_what_could_as_well_be_of_another_is_dropped_unless_that_one_is_seen_too():
    """Two landmarks a little over a sigma to either side of where something is seen."""
    pair = np.array([[5.0, -0.1], [5.0, 0.12]])

    def rule(ekf, z, noise, confirmed=None):
        gates = GREEDY._replace(pairing=RULES["mutual"].pairing)
        return associate_by_geometry(ekf, z, noise, gates, confirmed=confirmed)

    z, noise = _scan([[5.0, 0.0], [5.0, 0.2]])
    assert rule(_filter(pair), z[:1], noise[:1]).tolist() == [DROPPED]
    assert rule(_filter(pair), z, noise).tolist() == [0, 1]
    for confirmed, expected in (([1, 1], DROPPED), ([1, 0], 0), ([0, 0], DROPPED)):
        found = rule(_filter(pair), z[:1], noise[:1], np.array(confirmed, bool))
        assert found.tolist() == [expected]
    far = pair * [1.0, 9.0]
    z, noise = _scan(far[0])
    assert rule(_filter(far), z, noise).tolist() == [0]


@given(arrays(np.float64, (5, 4), elements=st.floats(0, 10)), st.floats(0, 10))
def test_pairs_exclude_each_other_and_no_better_pair_is_left(distance, limit):
    paired = RULES["nearest"].pairing(distance)
    paired[distance[np.arange(5), paired] > limit] = -1
    taken = paired[paired >= 0]
    assert len(set(taken.tolist())) == len(taken)
    for row in range(5):
        for column in range(4):
            if distance[row, column] > limit or paired[row] == column:
                continue
            mine = distance[row, paired[row]] if paired[row] >= 0 else np.inf
            holder = np.flatnonzero(paired == column)
            theirs = distance[holder[0], column] if len(holder) else np.inf
            assert mine <= distance[row, column] or theirs <= distance[row, column]


def test_known_labels_are_looked_up():
    associate, ekf = LabelAssociation(EkfConfig(association="known")), _filter([])
    table = LandmarkTable(CullingPolicy(False, 1, 1))
    z, noise = _scan(WORLD)
    labels = [7, 7, None, "door"]
    assert associate(ekf, table, z, noise, labels).tolist() == [0, DROPPED, DROPPED, 1]
    assert table.landmarks_of([7, "door", 5]).tolist() == [0, 1, -1]
    assert associate(ekf, table, z, noise, labels).tolist() == [0, 0, DROPPED, 1]


@given(
    arrays(np.float64, (6, 2), elements=st.floats(-9, 9)),
    arrays(np.float64, (6, 2, 2), elements=st.floats(-2, 2)),
)
def test_distance_is_normalized_by_the_covariance(v, root):
    S = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(2)
    expected = [each @ np.linalg.solve(spread, each) for each, spread in zip(v, S, strict=True)]
    parts = [(*each, C[0, 0], C[0, 1], C[1, 1]) for each, C in zip(v, S, strict=True)]
    found = [squared_distance(*each) for each in parts]
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-12)
    assert np.isinf(squared_distance(1.0, 2.0, 0.0, 0.0, 0.0))


def test_distance_is_the_nis_of_an_update_where_range_and_bearing_correlate():
    z, noise = _scan(WORLD + np.array([0.1, -0.05]))
    noise[:, 0, 1] = noise[:, 1, 0] = 9e-4
    distance = mahalanobis_squared(_filter(), z, noise)
    for landmark in range(len(WORLD)):
        nis = _filter().update(z[landmark], noise[landmark], landmark).nis
        np.testing.assert_allclose(distance[landmark, landmark], nis, rtol=1e-9)


@given(arrays(np.float64, (5, 4), elements=st.floats(0, 10)))
def test_mutual_pairs_are_the_nearest_of_each_other(distance):
    for row, column in enumerate(RULES["mutual"].pairing(distance).tolist()):
        if column >= 0:
            assert distance[row, column] == distance[row].min() == distance[:, column].min()
        elif len(np.unique(distance)) == distance.size:  # without ties
            assert distance[:, distance[row].argmin()].argmin() != row


@pytest.mark.parametrize("errors", list(ERRORS))
def test_expectation_is_that_of_the_dense_covariance(rng, errors):
    """Compiled gates against H P H^T of the whole covariance, with rows not yet added up."""
    ekf = EkfSlam(np.array([0.3, -0.2, 0.4]), 1e-2 * np.eye(3), errors=errors)
    for landmark in WORLD:
        ekf.augment(observe(ekf.pose, landmark)[0], R)
    for number, landmark in enumerate(WORLD):
        ekf.predict(np.array([0.1, 0.2]), 1e-3 * np.eye(2))
        ekf.update(observe(ekf.pose, landmark + 0.02)[0], R, number)
    z, H = observe(ekf.pose, ekf.landmarks)
    expected = ekf.predict_observations()
    np.testing.assert_allclose(expected.z, z, atol=1e-12)
    for i in range(len(WORLD)):
        at = [0, 1, 2, 3 + 2 * i, 4 + 2 * i]
        S = H[i] @ ekf.covariance[np.ix_(at, at)] @ H[i].T
        np.testing.assert_allclose(expected.covariance[i], S, rtol=1e-9, atol=1e-15)


def test_removed_landmarks_leave_the_others_as_they_were(rng):
    ekf = _filter(np.concatenate([WORLD, WORLD + 9]), spread=1e-2)
    for number in (0, 5, 7):
        ekf.update(observe(ekf.pose, ekf.landmarks[number] + 0.1)[0], R, number)
    before, spread = ekf.landmarks, ekf.covariance
    ekf.remove(np.array([1, 6]))
    kept = [0, 2, 3, 4, 5, 7]
    at = [0, 1, 2, *(3 + 2 * k + i for k in kept for i in range(2))]
    np.testing.assert_array_equal(ekf.landmarks, before[kept])
    np.testing.assert_allclose(ekf.covariance, spread[np.ix_(at, at)], atol=1e-15)
    ekf.augment(np.array([2.0, 0.1]), R)
    fresh = ekf.covariance
    assert np.linalg.eigvalsh(fresh).min() > -1e-12
    assert ekf.ids.tolist() == [*kept, 8]
    ekf.update(observe(ekf.pose, ekf.landmarks[-2])[0], R, 7)
    with pytest.raises(LogError, match="landmark"):
        ekf.remove(np.array([6, 7]))


@pytest.mark.parametrize("errors", ERRORS)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 30.0]))
def test_what_is_out_of_reach_is_over_the_limit(errors, seed, away):
    """However the error of the heading swings the map about the origin."""
    rng = np.random.default_rng(seed)
    start = np.array([away, -away, 0.5])
    ekf = EkfSlam(start, np.diag([1e-4, 1e-4, rng.uniform(0, 0.3)]), errors=errors)
    for _ in range(6):
        ekf.augment(np.array([rng.uniform(1, 9), rng.uniform(-3, 3)]), R)
    ekf.predict(np.array([0.5, 0.3]), np.diag([1e-4, rng.uniform(0, 0.3)]))
    z = ekf.predict_observations().z[:3] + rng.normal(size=(3, 2)) * [0.3, rng.uniform(0, 0.8)]
    noise, found = np.tile(R, (3, 1, 1)), np.empty(6, np.int64)
    count = prefilter_landmarks(ekf.active, z, noise, 9.0, found)
    near = (mahalanobis_squared(ekf, z, noise) <= 9.0).any(0)
    assert set(np.flatnonzero(near)) <= set(found[:count])
