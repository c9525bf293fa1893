"""Several association hypotheses among landmarks that are close to each other."""

import dataclasses
from itertools import product

import numpy as np
import pytest

from saccade import slam
from saccade.evaluation.trajectory import position_rmse
from saccade.slam import ERRORS, EkfConfig, EkfSlam, Slam
from saccade.slam.association.alternatives import Alternatives
from saccade.slam.association.outcomes import NEW
from support.clustered_world import clustered_world
from support.logs import scan_of, without_names
from support.nightly import nightly

SEVERAL = EkfConfig(association="hypotheses", estimate_systematic_errors=False)
"""The odometry of the clustered worlds has no systematic errors."""


def _wrong(log, association):
    """The fraction of associations that are not of what most of their landmark's are."""
    used = association >= 0
    counts = np.zeros((association.max() + 1, log.landmark.max() + 1), int)
    np.add.at(counts, (association[used], log.landmark[used]), 1)
    return 1 - counts.max(1).sum() / used.sum()


@pytest.mark.parametrize("seed", [1, *nightly(3, 4)])
def test_a_clustered_world_without_names_is_mapped_almost_as_with_them(seed):
    log = clustered_world(seed, steps=600)
    auto = dataclasses.replace(SEVERAL, association="auto")
    named, result = slam.run(log, auto), slam.run(without_names(log), auto)
    single = slam.run(without_names(log), dataclasses.replace(SEVERAL, association="mutual"))
    known = position_rmse(named.trajectory, log.truth)
    assert position_rmse(result.trajectory, log.truth) < 1.7 * known
    assert 10 <= len(result.map) <= 12  # of 12
    assert _wrong(log, result.association) < 0.1 < _wrong(log, single.association)


@pytest.mark.nightly
def test_a_map_from_wrong_odometry_may_be_unreliable(rng):
    log = without_names(clustered_world(1, steps=600))
    assert slam.run(log).warning == ""
    turned = log.control.copy()
    turned[200:, 2] += 0.3 * rng.normal(size=len(turned) - 200)
    result = slam.run(dataclasses.replace(log, control=turned))
    unused = (result.association < 0).mean()
    assert "the map may be unreliable" in result.warning
    assert f"{unused:.0%} of the observations are not used" in result.warning


def test_the_pose_has_the_mean_and_the_covariance_of_the_mixture():
    rng = np.random.default_rng(3)
    means = np.array([[0.0, 1.0, 3.1], [0.6, 0.2, -3.0], [0.1, 0.9, 3.0]])
    covariances = [np.diag([0.1, 0.2, 0.05]) ** 2, np.diag([0.2, 0.1, 0.1]) ** 2, 0.01 * np.eye(3)]
    weights = np.array([0.5, 0.3, 0.2])
    hypotheses = Slam().hypotheses
    first = hypotheses.best
    hypotheses.hypotheses = [first, first.copy(), first.copy()]
    for each, mean, C, weight in zip(
        hypotheses.hypotheses, means, covariances, weights, strict=True
    ):
        each.ekf, each.weight = EkfSlam(mean, C), np.log(weight / weights[0])
    which = rng.choice(3, 400_000, p=weights)
    drawn = (
        means[which]
        + np.array([rng.multivariate_normal(np.zeros(3), C, len(which)) for C in covariances])[
            which, np.arange(len(which))
        ]
    )
    drawn[:, 2] %= 2 * np.pi  # headings around half a turn
    pose, covariance = hypotheses.pose
    assert [*pose[:2], pose[2] % (2 * np.pi)] == pytest.approx(drawn.mean(0), abs=0.003)
    assert covariance == pytest.approx(np.cov(drawn.T), abs=0.002)
    best = hypotheses.best.ekf.pose
    hypotheses.branching = True
    hypotheses.keep_best()
    pose, covariance = hypotheses.pose  # of one that was merely the most probable
    np.testing.assert_array_equal(pose, best)
    moved = means - best
    moved[:, 2] = slam.wrap(moved[:, 2])
    expected = covariances[0] + (weights * moved.T) @ moved
    assert covariance == pytest.approx(expected, abs=1e-9)


def test_names_end_the_hypotheses():
    log = clustered_world(1, steps=200)
    late = np.where(log.observation_pose > 100, log.landmark, -1)
    live = slam.slam_for(log, dataclasses.replace(SEVERAL, association="auto", smooth=False))
    slam.run(dataclasses.replace(log, landmark=late), initial=live)
    assert live.hypotheses.branching is False
    labels, counts = np.unique(late, return_counts=True)
    assert set(labels[counts > 1]) <= set(live.map.label)  # a label may be wrong once


def test_a_new_landmark_costs_what_its_density_says():
    # Of a density per square metre in range and bearing, over a Gaussian's at its mean.
    r, R = 3.0, np.diag([0.02, 0.004]) ** 2
    size = np.sqrt(r) * np.linalg.det(R) ** 0.25
    density = 0.1 * r  # dx dy = r dr dbeta
    peak = 1 / (2 * np.pi * np.sqrt(np.linalg.det(R)))
    assert Alternatives().new_cost(size) == pytest.approx(-2 * np.log(density / peak))
    assert Alternatives().new_cost(1.0) == 10.0


def test_steps_and_copies_have_the_bits_of_a_run():
    log = without_names(clustered_world(2, steps=110))
    config = dataclasses.replace(SEVERAL, max_hypotheses=6, smooth=False)
    whole = slam.run(log, config)
    live, poses, several = slam.slam_for(log, config), [], 0
    for i in range(len(log.time)):
        poses.append(live.step(*scan_of(log, i)).pose)
        several = max(several, len(live.hypotheses.hypotheses))
        if i % 60 == 40:
            live.hypotheses.hypotheses = [each.copy() for each in live.hypotheses.hypotheses]
    assert np.array(poses).tobytes() == whole.filtered.pose.tobytes()
    assert 1 < several <= 6
    assert live.hypotheses.best.weight == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_alternatives_are_those_of_all_joint_associations(seed):
    rng = np.random.default_rng(seed)
    ekf = EkfSlam(np.zeros(3), np.diag([0.1, 0.1, 0.03]) ** 2, huber=np.inf)
    R = np.tile(np.diag([0.05, 0.02]) ** 2, (3, 1, 1))
    landmarks = np.array([[3.0, 0.1], [3.2, 0.12], [3.1, -0.05], [5.0, 1.0]])
    for z in landmarks:
        ekf.augment(z, R[0])
    ekf.predict(np.array([0.0, 0.0]), np.diag([0.2, 0.05]) ** 2)
    z = landmarks[rng.permutation(4)[:3]] + rng.normal(size=(3, 2)) * [0.1, 0.03]
    config = Alternatives(gate=0.9999, known=-np.inf, max_nodes=10**6, max_assignments=100)
    new_cost = config.new_cost(0.05)
    found = config(ekf, z, R, new_cost)
    costs = {}
    for which in product(range(-1, 4), repeat=3):
        pairs = [(i, j) for i, j in enumerate(which) if j >= 0]
        if len({j for _, j in pairs}) < len(pairs):
            continue
        cost = new_cost * (3 - len(pairs))
        if pairs:
            rows, columns = (list(each) for each in zip(*pairs, strict=True))
            predicted, S = ekf.predict_jointly(np.array(columns))
            noise = np.kron(np.eye(len(pairs)), R[0])
            v = slam.difference(z[rows], predicted).ravel()
            cost += v @ np.linalg.solve(S + noise, v)
            cost += np.linalg.slogdet(S + noise)[1] - np.linalg.slogdet(noise)[1]
        costs[which] = cost
    least = min(costs.values())
    expected = {key: cost for key, cost in costs.items() if cost < least + config.window - 1e-9}
    got = {
        tuple(np.where(each.association == NEW, -1, each.association).tolist()): each.cost
        for each in found
    }
    assert next(iter(got)) == min(costs, key=costs.get)
    for key, cost in got.items():
        assert cost == pytest.approx(costs[key])
    assert len(got) >= min(2, len(expected))
    assert set(got) <= set(expected)


@pytest.mark.parametrize(("sigmas", "is_alternative"), [(1.0, True), (6.0, True), (9.0, False)])
def test_after_a_slip_a_landmark_far_outside_of_its_gate_costs_the_loss_of_huber(
    sigmas, is_alternative
):
    """Huber (1964): e^2 up to k, then 2 k e - k^2. Beyond the gate of slips it is another one."""
    ekf, huber = EkfSlam(np.zeros(3), np.zeros((3, 3))), 1.345
    R = np.diag([0.05, 0.02])[None] ** 2
    ekf.augment(np.array([4.0, 0.0]), R[0])
    ekf.predict(np.zeros(2), np.diag([1.0, 0.0]) ** 2)  # along the line of sight
    variance = 1.0 + 2 * 0.05**2
    z = np.array([[4.0 - sigmas * np.sqrt(variance), 0.0]])
    config = Alternatives(huber=huber, window=np.inf)
    found = {int(each.association[0]): each.cost for each in config(ekf, z, R, new_cost=12.0)}
    assert (0 in found) == is_alternative
    if is_alternative:
        loss = sigmas**2 if sigmas < huber else 2 * huber * sigmas - huber**2
        determinant = variance / 0.05**2 * 2  # the landmark has the variance of its bearing
        assert found[0] == pytest.approx(loss + np.log(determinant), rel=1e-6)


@pytest.mark.parametrize("kind", list(ERRORS))
def test_joining_landmarks_is_an_update_by_a_distance_of_zero(kind):
    start = np.array([0.3, -0.2, 0.1])
    ekf = EkfSlam(start, np.diag([0.01, 0.02, 0.001]), errors=kind)
    R = np.diag([0.05, 0.02]) ** 2
    for z in ([2.0, 0.3], [2.05, 0.32], [3.0, -0.5]):
        ekf.augment(np.array(z), R)
    state, P = ekf.state, ekf.covariance
    H = np.zeros((2, 9))
    H[:, 3:5], H[:, 5:7] = np.eye(2), -np.eye(2)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 1e-8 * np.eye(2))
    ekf.join(0, 1)
    # the invariant filter corrects along the exponential and carries its covariance along
    np.testing.assert_allclose(ekf.state, state - K @ H @ state, atol=2e-4)
    np.testing.assert_allclose(ekf.covariance, (np.eye(9) - K @ H) @ P, atol=1e-4)
    np.testing.assert_allclose(ekf.landmarks[0], ekf.landmarks[1], atol=1e-4)
