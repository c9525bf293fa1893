"""Who is who: gates, exclusion, and what becomes a landmark."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from saccade.slam import Candidates, EkfSlam, KnownIdentity, NearestNeighbor, observe
from saccade.slam.association import DROPPED, NEW, mahalanobis_squared, pair_nearest_first

R = np.diag([0.01, 1e-4])
UNKNOWN = np.full(9, -1)
WORLD = np.array([[5.0, 1.0], [6.0, -2.0], [8.0, 0.0], [-3.0, 4.0]])


def _filter(landmarks=WORLD, spread=1e-4):
    ekf = EkfSlam(np.zeros(3), spread * np.eye(3))
    for landmark in landmarks:
        ekf.augment(observe(np.zeros(3), landmark)[0], R)
    return ekf


def _scan(places):
    z, _ = observe(np.zeros(3), np.atleast_2d(places))
    return z, np.tile(R, (len(z), 1, 1))


def test_distance_is_the_nis_of_an_update():
    z, noise = _scan(WORLD[::-1] + np.array([0.1, -0.05]))
    distance = mahalanobis_squared(_filter(), z, noise)
    for i in range(len(z)):
        for landmark in range(len(WORLD)):
            nis = _filter().update(z[i], R, landmark).nis
            np.testing.assert_allclose(distance[i, landmark], nis, rtol=1e-9)


def test_each_observation_finds_its_landmark_whatever_the_order():
    order = [2, 0, 3, 1]
    z, noise = _scan(WORLD[order] + 0.02)
    assert NearestNeighbor()(_filter(), z, noise, UNKNOWN[:4]).tolist() == order


def test_bearings_behind_the_robot_are_near_each_other():
    ekf = _filter(np.array([[-5.0, 0.001]]))
    z, noise = _scan([-5.0, -0.001])
    assert NearestNeighbor()(ekf, z, noise, UNKNOWN[:1]).tolist() == [0]


def test_a_landmark_takes_the_nearer_of_two_observations():
    z, noise = _scan([WORLD[0] + [0.15, 0], WORLD[0] + [0.02, 0]])
    assert NearestNeighbor()(_filter(), z, noise, UNKNOWN[:2]).tolist() == [DROPPED, 0]


def test_near_is_taken_far_is_new_and_between_is_dropped():
    ekf = _filter(WORLD[:1])
    sigma = np.sqrt(ekf.expect().covariance[0, 0, 0] + R[0, 0])
    z, noise = _scan(WORLD[[0, 0, 0]])
    z[:, 0] += np.array([2.5, 3.5, 5.0]) * sigma  # gates at 3.03 and 4.29 sigma
    found = [int(NearestNeighbor()(ekf, z[i : i + 1], noise[:1], UNKNOWN[:1])[0]) for i in range(3)]
    assert found == [0, DROPPED, NEW]


def test_in_an_empty_map_everything_is_new():
    z, noise = _scan(WORLD)
    ekf = EkfSlam(np.zeros(3), np.eye(3))
    assert NearestNeighbor()(ekf, z, noise, UNKNOWN[:4]).tolist() == [NEW] * 4


@given(arrays(np.float64, (5, 4), elements=st.floats(0, 10)), st.floats(0, 10))
def test_pairs_exclude_each_other_and_no_better_pair_is_left(distance, limit):
    paired = pair_nearest_first(distance, limit)
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


def test_known_identities_are_looked_up():
    associate = KnownIdentity()
    z, noise = _scan(WORLD)
    identity = np.array([7, 7, -1, 9])
    assert associate(_filter(), z, noise, identity).tolist() == [NEW, DROPPED, DROPPED, NEW]
    associate.added(0, 7)
    assert associate(_filter(), z, noise, identity).tolist() == [0, 0, DROPPED, NEW]


def _confirmed(candidates, place, time):
    ekf = EkfSlam(np.zeros(3), np.zeros((3, 3)))
    return candidates.confirm(ekf, *_scan(place), time)


def test_a_place_becomes_a_landmark_when_seen_often_enough():
    candidates = Candidates(sightings=3, lifetime=2.0)
    assert _confirmed(candidates, [4.0, 1.0], 0.0) == []
    assert _confirmed(candidates, [[9.0, 1.0], [4.01, 1.0]], 1.0) == []
    assert _confirmed(candidates, [[4.0, 1.01], [-2.0, 3.0]], 2.0) == [0]
    assert _confirmed(candidates, [4.0, 1.0], 3.0) == []  # it counts from the beginning


def test_a_place_that_is_not_seen_again_is_forgotten():
    candidates = Candidates(sightings=2, lifetime=2.0)
    assert _confirmed(candidates, [4.0, 1.0], 0.0) == []
    assert _confirmed(candidates, [4.0, 1.0], 2.1) == []
    assert _confirmed(candidates, [4.0, 1.0], 4.0) == [0]


def test_one_sighting_can_be_enough():
    assert _confirmed(Candidates(sightings=1, lifetime=1.0), WORLD, 0.0) == [0, 1, 2, 3]


def test_observations_without_noise_find_no_candidate():
    candidates = Candidates(sightings=2, lifetime=2.0)
    z, _ = _scan(WORLD)
    exact = np.zeros((4, 2, 2))
    for time in (0.0, 0.1):
        assert candidates.confirm(EkfSlam(np.zeros(3), np.zeros((3, 3))), z, exact, time) == []


def test_distance_is_the_nis_of_an_update_where_range_and_bearing_correlate():
    z, noise = _scan(WORLD + np.array([0.1, -0.05]))
    noise[:, 0, 1] = noise[:, 1, 0] = 9e-4
    distance = mahalanobis_squared(_filter(), z, noise)
    for landmark in range(len(WORLD)):
        nis = _filter().update(z[landmark], noise[landmark], landmark).nis
        np.testing.assert_allclose(distance[landmark, landmark], nis, rtol=1e-9)


def test_a_candidate_is_as_uncertain_along_the_ray_as_the_range():
    for shift, confirmed in (([0.0, 0.3], [0]), ([0.3, 0.0], [])):
        candidates = Candidates(sightings=2, lifetime=1.0)
        assert _confirmed(candidates, [[0.0, 5.0]], 0.0) == []
        assert _confirmed(candidates, np.add([[0.0, 5.0]], shift), 0.1) == confirmed
