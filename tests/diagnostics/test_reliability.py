"""Maps that are wrong in a known way: landmarks twice, a robot that was moved, hidden landmarks."""

import dataclasses

import numpy as np
import pytest

from saccade import slam
from saccade.diagnostics.reliability import copied_landmarks, map_warning, reobserved
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam.consistency import pose_nees
from saccade.types import LandmarkLog, LandmarkMap, Trajectory
from support.clustered_world import clustered_world
from support.logs import without_names
from support.nightly import nightly

REACH, STEPS = 4.0, 240  # a lap


def laps(count=2, hidden=None):
    """A log of laps of a circle among random landmarks, and where they are.

    Of the landmarks from `hidden` on each is hidden from a half of the course.
    """
    rng = np.random.default_rng(5)
    landmarks = rng.uniform(-9, 9, (40, 2))
    angle = np.arange(count * STEPS) * 2 * np.pi / STEPS
    pose = np.stack([6 * np.cos(angle), 6 * np.sin(angle), slam.wrap(angle + np.pi / 2)], 1)
    rows, z, label = [], [], []
    for i, p in enumerate(pose):
        observed = slam.observe(p, landmarks)[0]
        seen = observed[:, 0] < REACH
        if hidden is not None:
            seen[hidden:] &= (landmarks[hidden:] @ p[:2] > 0) & (i % STEPS < STEPS / 2)
        found = np.flatnonzero(seen & (rng.random(len(landmarks)) < 0.9))
        rows += [i] * len(found)
        z.append(observed[found])
        label += found.tolist()
    return log_of(pose, np.array(rows), np.concatenate(z)), landmarks, np.array(label)


def log_of(pose, rows, z):
    """A log of observations (k, 2) from the poses `rows` (k,)."""
    time = np.arange(float(len(pose)))
    return LandmarkLog(
        name="laps",
        start=pose[0],
        time=time,
        motion="compose",
        control=np.zeros((len(pose) - 1, 3)),
        control_covariance=np.zeros((len(pose) - 1, 3, 3)),
        observation_pose=rows,
        observation=z,
        observation_covariance=np.tile(1e-4 * np.eye(2), (len(rows), 1, 1)),
        landmark=np.full(len(rows), -1),
        truth=Trajectory(time, pose),
    )


def warning(log, pose, xy, association):
    found = LandmarkMap(np.arange(len(xy)), xy)
    return map_warning(log, Trajectory(log.time, pose), found, association)


@pytest.mark.parametrize("hidden", [None, 20])
def test_a_right_map_has_no_warning(hidden):
    log, xy, association = laps(hidden=hidden)
    assert np.nanmin(reobserved(log, log.truth.pose, xy, association)) > 0.8
    assert copied_landmarks(log, xy, association) == (0, 0.0)
    assert warning(log, log.truth.pose, xy, association) == ""


def test_landmarks_that_are_not_recognized_are_missed():
    log, xy, association = laps()
    again = log.observation_pose >= STEPS
    twice = np.where(again & (association < 20), association + 40, association)
    both = np.concatenate([xy, np.add(xy[:20], (0.05, 0.0))])
    again = reobserved(log, log.truth.pose, both, twice)
    seen = np.isfinite(again)
    assert seen.sum() > 30
    twice_mapped = (np.arange(60) < 20) | (np.arange(60) >= 40)
    assert (again[seen & ~twice_mapped] > 0.8).all()
    assert (again[seen & twice_mapped] < 0.1).all()
    assert "missing where the robot returns" in warning(log, log.truth.pose, both, twice)


def test_first_observations_that_are_not_used_leave_the_start_open():
    log, xy, association = laps()
    association[:60] = -1
    assert "75% of the first observations are not used" in warning(
        log, log.truth.pose, xy, association
    )


def test_a_map_that_begins_anew_elsewhere_is_a_copy():
    log, xy, association = laps()
    again = log.observation_pose >= STEPS
    c, s = np.cos(0.7), np.sin(0.7)
    turn, shift = np.array([[c, s], [-s, c]]), np.array([30.0, 5.0])
    pose = log.truth.pose.copy()
    pose[STEPS:, :2] = pose[STEPS:, :2] @ turn + shift
    pose[STEPS:, 2] += 0.7
    both = np.concatenate([xy, xy @ turn + shift])
    seen = len(np.unique(association))
    rows = np.unique(association + 40 * again)
    association = np.searchsorted(rows, association + 40 * again)
    assert copied_landmarks(log, both[rows], association)[0] >= 0.9 * seen
    again = reobserved(log, pose, both[rows], association)
    assert np.isnan(again).all()  # it does not come back
    assert "a copy of older ones" in warning(log, pose, both[rows], association)


def test_rooms_that_are_alike_are_no_copy(rng):
    """A corridor of eight rooms with the same landmarks, driven through once and back."""
    room = rng.uniform(0, 4, (6, 2))
    xy = np.concatenate([np.add(room, (5.0 * i, 0)) for i in range(8)])
    x = np.concatenate([np.arange(0, 40, 0.2), np.arange(40, 0, -0.2)])
    pose = np.stack([x, np.full(len(x), 2.0), np.repeat([0.0, np.pi], len(x) // 2)], 1)
    row, association = np.nonzero(np.abs(xy[:, 0] - x[:, None]) < 2.5)
    z = slam.observe(pose[row].T, xy[association])[0]
    assert warning(log_of(pose, row, z), pose, xy, association) == ""


@pytest.mark.nightly
def test_a_map_with_labels_has_no_such_warning():
    log = clustered_world(1, steps=600)
    turned = log.control.copy()
    turned[200:, 2] += 0.3 * np.random.default_rng(0).normal(size=len(turned) - 200)
    log = dataclasses.replace(log, control=turned)
    assert slam.run(log).warning == ""
    assert "may be unreliable" in slam.run(without_names(log)).warning


@pytest.mark.parametrize(
    ("steps", "seed", "missing", "wrong"),
    [(800, 6, 0.95, True), *nightly((1500, 4, 0.95, True), (1500, 3, 0.5, False))],
)
def test_a_map_with_few_labels_is_judged_too(steps, seed, missing, wrong):
    log = simulate_world(dataclasses.replace(WorldConfig.coarse(), steps=steps), seed)
    hidden = np.random.default_rng(seed).random(len(log.landmark)) < missing
    log = dataclasses.replace(log, landmark=np.where(hidden, -1, log.landmark))
    result = slam.run(log)
    assert (np.nanmean(pose_nees(result.trajectory, log.truth, 0)) > 15) == wrong
    assert ("may be unreliable" in result.warning) == wrong
