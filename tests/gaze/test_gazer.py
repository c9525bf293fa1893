"""The gazer against an update of the filter, and what each of its terms is for."""

import sys
from dataclasses import replace
from math import radians
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import saccade
from saccade.errors import ConfigError
from saccade.gaze import POLICIES, Gazer
from saccade.gaze.gazer import GOAL_DURATION, HORIZON, INHIBITION_TIME, MISS_MEMORY
from saccade.slam import EkfConfig, Slam
from saccade.slam.filter.robot_models import observe
from support.paths import ROOT

CONFIG = EkfConfig(errors="standard", association="known", huber=np.inf, recover=False)


HEADING = 2.0
"""Heading of the robot, in radians; pans and landmarks are relative to it."""


def robot(landmarks=(), names=None, motion_sigma=0.0, heading=HEADING):
    """At the origin, with landmarks known to a centimeter, and then a pose less certain.

    Landmarks (k, 2) are ahead and to the left of the robot.
    """
    slam = Slam(CONFIG, start=(0.0, 0.0, heading))
    xy = np.array(landmarks, float).reshape(-1, 2)
    if len(xy):
        R = np.tile(np.diag([1e-4, 1e-5]), (len(xy), 1, 1))
        names = np.arange(len(xy)) if names is None else names
        slam.step(0.0, z=observe(np.zeros(3), xy)[0], R=R, labels=names)
    slam.step(1.0, np.zeros(3), motion_sigma**2 * np.diag([1, 1, 0.1]) + 1e-9 * np.eye(3))
    return slam


def gazer(slam, policy="active", **options):
    return Gazer(slam, radians(50), 8.0, policy=policy, **{"rate": 100.0, **options})


def look_around(made):
    """Nothing around is new any more."""
    for pan in np.linspace(*made.limits, 20):
        made.record(pan=pan)
    made.pan = 0.0


@pytest.mark.parametrize("pan", [1000.0, -2.5, np.nan])
def test_a_pan_outside_of_the_limits_is_refused(pan):
    made = gazer(robot())
    with pytest.raises(ConfigError, match=r"pan: expected radians from -2.4 to 2.4, found"):
        made.record(pan=pan)
    with pytest.raises(TypeError):
        made.record(0.0, [7])
    made.record(pan=2.41)  # an error of the measurement
    assert made.next().pan <= 2.4


def sensor(ranges):
    return np.stack([0.02 * ranges**2, np.full(len(ranges), 0.01)], 1)


@pytest.mark.parametrize("pan_sigma", [0.0, 0.02])
def test_the_information_is_the_entropy_that_an_update_takes_from_the_pose(pan_sigma):
    landmarks = np.array([[2.0, 0.1], [3.0, -0.4], [4.0, 0.5]])
    slam = robot(landmarks, motion_sigma=0.3)
    made = gazer(slam, pan_sigma=pan_sigma, sensor=sensor)
    view = made._roll_out()
    ahead = int(np.argmin(np.abs(made.candidates)))
    assert view.seen[ahead].tolist() == [1, 1, 1]
    information = made._information(view)[ahead]
    before = np.linalg.slogdet(slam.filter.pose_covariance)[1]
    r = np.hypot(*landmarks.T)
    R = np.stack([(0.02 * r**2) ** 2, np.full(3, 0.01**2)], 1)[:, None] * np.eye(2)
    R[:, 1, 1] += 3 * pan_sigma**2
    slam.step(2.0, z=observe(np.zeros(3), landmarks)[0], R=R, labels=np.arange(3))
    after = np.linalg.slogdet(slam.filter.pose_covariance)[1]
    assert_allclose(information, (before - after) / 2, rtol=1e-3)


@pytest.mark.parametrize("k", [1, 2, 9])
def test_the_bearings_of_a_scan_tell_the_heading_no_better_than_the_pan_is_measured(k):
    R = np.tile(np.diag([0.01, 1e-12]), (k, 1, 1))
    noisy = gazer(robot(), pan_sigma=0.03).add_pan_error(R)
    assert_allclose((1 / noisy[:, 1, 1]).sum(), 1 / 0.03**2, rtol=1e-6)  # information of k bearings
    assert_allclose(noisy[:, 0], R[:, 0])
    assert_allclose(noisy[:, 1, 0], 0)
    one = gazer(robot(), pan_sigma=0.03).add_pan_error(np.diag([0.01, 0.04**2])[None])
    assert_allclose(np.sqrt(one[0, 1, 1]), 0.05)


@pytest.mark.parametrize("sigma", [0.01, 1.0])
def test_a_landmark_that_was_seen_from_here_tells_nothing_of_an_uncertain_pose(sigma):
    slam = Slam(CONFIG)
    slam.step(1.0, np.zeros(3), sigma**2 * np.diag([1.0, 1.0, 0.1]))
    R = np.array([0.05, 0.02]) ** 2
    slam.step(2.0, z=np.array([[3.0, 0.0]]), R=np.diag(R)[None], labels=np.array([0]))
    made = gazer(slam)
    assert_allclose(made._information(made._roll_out()), 0, atol=1e-4)


def test_of_landmarks_in_one_square_meter_the_one_with_the_fewest_misses_counts():
    made = gazer(robot([[3.2, 0.5], [3.4, 0.5], [3.6, 0.5], [4.5, 0.5]], heading=0.0))
    assert sorted(made._roll_out().landmarks.tolist()) == [0, 3]
    made.record(pan=0.0, missed=[0, 1, 3])
    assert sorted(made._roll_out().landmarks.tolist()) == [2, 3]


def test_a_goal_is_kept_while_the_camera_turns_to_it():
    made = gazer(robot([[-1.5, 2.6], [2.0, -2.0]], motion_sigma=0.5), rate=0.1)
    goals = [made._active() for made.time in np.arange(0, GOAL_DURATION - 0.01, 0.1)]
    assert len(set(goals)) == 1


def test_a_landmark_that_was_missed_counts_less_until_it_is_forgotten():
    made = gazer(robot([[3.0, 0.1]], motion_sigma=0.3))
    found = made._information(made._roll_out()).max()
    made.record(pan=0.0, missed=[0])
    missed = made._information(made._roll_out()).max()
    far = gazer(robot([[3.0, 0.1]], motion_sigma=0.3))
    view = far._roll_out()
    half = far._information(replace(view, seen=view.seen / 2)).max()  # in view half of the time
    assert_allclose(missed, half, rtol=1e-6)
    made.time += 20 * MISS_MEMORY
    assert_allclose(made._information(made._roll_out()).max(), found, rtol=1e-6)


def test_an_uncertain_robot_looks_at_known_landmarks_and_a_certain_one_at_what_is_new():
    behind = [[-1.5, 2.6], [-1.3, 2.4], [-1.6, 2.8]]
    uncertain = gazer(robot(behind, motion_sigma=0.5))
    look_around(uncertain)
    look = uncertain.next()
    assert look.pan == pytest.approx(radians(120), abs=radians(25))
    assert look.reason == "informative landmarks"
    certain = gazer(robot(behind))
    for pan in np.linspace(-0.5, 2.4, 20):
        certain.record(pan=pan, labels=[0, 1, 2])
    look = certain.next()
    assert look.pan < -1
    assert look.reason == "new area"


def test_in_a_map_that_does_not_grow_new_area_is_worth_nothing():
    slam = robot([[3.0, 0.3], [3.0, -0.3]])
    reasons = set()
    for mode in ("continue", "localize"):
        slam.mode = mode
        made = gazer(slam)
        made.record(pan=0.0, labels=[0, 1])
        reasons.add((mode, made.next().reason == "new area"))
    assert reasons == {("continue", True), ("localize", False)}


def test_landmarks_that_were_looked_at_are_inhibited_until_they_are_forgotten():
    made = gazer(robot([[0.0, 3.0], [0.0, -3.0]]), "salient")
    assert made.next(salience={0: 0.9, 1: 0.6}).pan > 1
    made.record(pan=1.5, labels=[0])
    assert made.next().pan < -1
    made.record(pan=-1.5, labels=[1])
    made.time += 10 * INHIBITION_TIME
    assert made.next().pan > 1


def test_landmarks_to_come_are_seen_where_the_plan_leads():
    slam = robot([[6.0, 3.0]], motion_sigma=0.1)
    made = gazer(slam, "salient")
    stays = made.next().pan
    goes_on = gazer(slam, "salient").next(np.tile([0.5, 0.0, 0.0], (20, 1))).pan
    assert 0 < stays < goes_on


@pytest.mark.parametrize("policy", POLICIES)
def test_a_camera_turns_within_its_limits_and_no_faster_than_its_rate(policy):
    slam = robot(np.random.default_rng(0).uniform(-6, 6, (20, 2)), motion_sigma=0.1)
    made, again = (
        Gazer(slam, 0.9, 8.0, (-1.0, 0.7), 0.5, period=0.2, policy=policy, seed=3) for _ in range(2)
    )
    looks = [made.next(np.array([[0.1, 0.0, 0.01]])) for _ in range(30)]
    assert looks == [again.next(np.array([[0.1, 0.0, 0.01]])) for _ in range(30)]
    pan = np.array([0.0, *(look.pan for look in looks)])
    assert pan.min() >= -1.0
    assert pan.max() <= 0.7
    assert np.abs(np.diff(pan)).max() <= 0.1 + 1e-12
    x, y = looks[-1].target
    pose = slam.filter.pose
    assert_allclose([np.hypot(x, y), np.arctan2(y, x)], [4.0, pan[-1] + pose[2]], atol=1e-9)
    assert policy == "fixed" or np.ptp(pan) > 0.2


def test_a_policy_may_be_named_as_module_and_function(monkeypatch):
    monkeypatch.setitem(sys.modules, "own_gaze", SimpleNamespace(to_the_left=lambda made: 0.7))
    assert gazer(robot(), "own_gaze:to_the_left").next().pan == pytest.approx(0.7)


def test_help_and_page_have_every_policy(run):
    shown = " ".join(run("simulate", "--help")[1].replace("│", "").split())
    page = (ROOT / "docs" / "gaze.md").read_text(encoding="utf-8")
    for name, row in POLICIES.items():
        assert f"{name}: {row.summary}" in shown
        assert f"| `{name}` | {row.summary} |" in page


def test_a_policy_of_ones_own_is_a_function_of_the_gazer():
    made = gazer(robot(), lambda gazer: gazer.limits[1] / 2)
    assert made.next().pan == pytest.approx(1.2)
    assert saccade.gaze.Gazer is Gazer


@pytest.mark.parametrize(
    "wrong",
    [
        {"fov": 0.0},
        {"max_range": 0.0},
        {"pan": (1.0, 0.0)},
        {"rate": 0.0},
        {"period": 2 * HORIZON},
        {"policy": "clever"},
        {"policy": 3},
        {"policy": "no_such_module:policy"},
        {"pan_sigma": -0.1},
    ],
)
def test_arguments_out_of_range_are_named(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        Gazer(robot(), **{"fov": 1.0, "max_range": 8.0, **wrong})
