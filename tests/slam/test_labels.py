"""Landmark names that may be wrong, in simulated worlds whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from saccade import slam
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam import EkfConfig
from support.logs import without_names
from support.nightly import nightly

FILTER = EkfConfig(smooth=False)
KNOWN = EkfConfig(association="known", smooth=False)


def _rmse(log, result):
    return np.sqrt(np.square((result.filtered.pose - log.truth.pose)[:, :2]).sum(1).mean())


def _wrong(log, fraction, seed=0):
    """Random other names, and which observations have one."""
    rng, names = np.random.default_rng(seed), np.unique(log.landmark)
    wrong = rng.random(len(log.landmark)) < fraction
    other = (log.landmark[wrong] + rng.integers(1, len(names), wrong.sum())) % len(names)
    landmark = log.landmark.copy()
    landmark[wrong] = names[other]
    return replace(log, landmark=landmark), wrong


def test_right_names_are_believed():
    log = simulate_world(WorldConfig(steps=400), seed=3)
    doubted, believed = slam.run(log, FILTER), slam.run(log, KNOWN)
    assert not doubted.rejected.any()
    np.testing.assert_array_equal(doubted.association, believed.association)
    np.testing.assert_array_equal(doubted.filtered.pose, believed.filtered.pose)
    np.testing.assert_array_equal(doubted.map.id, believed.map.id)


@pytest.mark.parametrize(("fraction", "steps"), [(0.01, 500), *nightly((0.05, 700))])
def test_wrong_names_are_refused_and_cost_little(fraction, steps):
    log = simulate_world(WorldConfig(steps=steps), seed=1)
    named, wrong = _wrong(log, fraction)
    result, right = slam.run(named, FILTER), slam.run(log, FILTER)
    assert _rmse(log, result) < 1.5 * _rmse(log, right)
    assert result.rejected[wrong].mean() > 0.8
    assert result.rejected[~wrong].mean() < 0.01
    assert "of the labels contradict the map" in (
        result.consistency.warning + result.consistency.remark
    )
    assert _rmse(log, slam.run(named, KNOWN)) > 3 * _rmse(log, right)


def test_a_wrong_name_at_the_first_observation_is_put_right():
    log = simulate_world(WorldConfig(steps=400), seed=1)
    last = np.flatnonzero(log.landmark == log.landmark[-1])[0]  # of one that is observed late
    other = np.setdiff1d(log.landmark, log.landmark[:last])
    assert len(other) > 1
    landmark = log.landmark.copy()
    landmark[0] = other[1]
    result = slam.run(replace(log, landmark=landmark), FILTER)
    assert len(result.map) == len(np.unique(log.landmark))
    assert _rmse(log, result) < 1.5 * _rmse(log, slam.run(log, FILTER))
    assert result.association[0] == -1


def test_names_that_are_swapped_half_way_move_to_the_other_landmark():
    log = simulate_world(WorldConfig(steps=750), seed=4)
    a, b = 3, 11
    late = log.observation_pose > 400
    landmark = log.landmark.copy()
    landmark[(log.landmark == a) & late], landmark[(log.landmark == b) & late] = b, a
    result, right = slam.run(replace(log, landmark=landmark), FILTER), slam.run(log, FILTER)
    assert _rmse(log, result) < 1.2 * _rmse(log, right)
    assert len(result.map) == len(right.map)
    ours, theirs = (dict(zip(r.map.id.tolist(), r.map.xy, strict=True)) for r in (result, right))
    assert np.hypot(*(ours[a] - theirs[b])) < 0.5
    assert np.hypot(*(ours[b] - theirs[a])) < 0.5


@pytest.mark.parametrize(
    ("length", "seed"),
    [(150, 20), *nightly((250, 52))],  # the loop closes 29 m and more off
)
def test_right_names_are_believed_where_the_pose_is_uncertain(length, seed):
    world = WorldConfig(
        course_length=length, steps=8 * length, range_limits=(0.5, 12.0), odometry_percent=10.0
    )
    log = simulate_world(world, seed)
    result, known = slam.run(log, FILTER), slam.run(log, KNOWN)
    assert result.rejected.mean() < 0.02
    assert len(result.map) == len(np.unique(log.landmark))
    assert _rmse(log, result) < 1.2 * _rmse(log, known)


def test_names_that_agree_are_believed_against_the_filter():
    """The odometry misses a turn by 20 degrees: every name is refused, and all of them agree."""
    log = simulate_world(WorldConfig(landmarks=40, steps=700), seed=0)
    control = log.control.copy()
    control[400, 2] += np.deg2rad(20)
    log = replace(log, control=control)
    doubted, believed = slam.run(log, FILTER), slam.run(log, KNOWN)
    late = log.observation_pose > 450
    assert not doubted.lost.any()
    assert doubted.rejected[late].mean() < 0.02
    assert _rmse(log, doubted) < 1.5 * _rmse(log, believed)


@pytest.mark.nightly
def test_observations_without_a_name_are_associated_by_geometry():
    log = simulate_world(WorldConfig(), seed=0)
    hidden = np.random.default_rng(0).random(len(log.landmark)) < 0.5
    mixed = slam.run(replace(log, landmark=np.where(hidden, -1, log.landmark)), FILTER)
    used = hidden & (mixed.association >= 0)
    assert used.sum() > 0.7 * hidden.sum()
    assert (mixed.map.id[mixed.association[used]] == log.landmark[used]).mean() > 0.95
    nameless = without_names(log)
    by_geometry = slam.run(nameless, replace(FILTER, association="mutual"))
    single = slam.run(nameless, replace(FILTER, max_hypotheses=1))
    np.testing.assert_array_equal(single.trajectory.pose, by_geometry.trajectory.pose)
    assert _rmse(log, mixed) < _rmse(log, by_geometry)


def test_a_label_that_is_only_misread_is_no_landmark():
    """Seven misread labels of a tag that is never in view, three of them at one other tag."""
    log = simulate_world(WorldConfig(steps=700), 0)
    at_one = np.flatnonzero(log.landmark == 3)[[5, 6, 7]]
    elsewhere = [np.flatnonzero(log.landmark == other)[20] for other in (5, 7, 9, 11)]
    label = log.landmark.copy()
    label[np.append(at_one, elsewhere)] = 99
    result = slam.run(replace(log, landmark=label), FILTER)
    assert 99 not in result.map.id
    assert len(result.map) == len(np.unique(log.landmark))


@pytest.mark.nightly
def test_a_loop_is_closed_by_a_label_where_half_of_the_labels_are_missing():
    """The first observation after the loop has no label, and fits a wrong landmark better."""
    log = simulate_world(WorldConfig.coarse(), 1)
    missing = np.random.default_rng(1).random(len(log.landmark)) < 0.5
    labeled = slam.run(log, FILTER)
    result = slam.run(replace(log, landmark=np.where(missing, -1, log.landmark)), FILTER)
    assert len(result.map) == len(np.unique(log.landmark))
    assert _rmse(log, result) < 1.1 * _rmse(log, labeled)


def test_the_filter_of_the_source_believes_every_name():
    log, _ = _wrong(simulate_world(WorldConfig(steps=100), 0), 0.1)
    result = slam.run(log, EkfConfig.kootstra2010())
    assert not result.rejected.any()
    assert (result.association >= 0).sum() >= len(log.landmark) - 1
