"""Logs that are wrong in one thing are refused, or warned of with that cause first."""

import re
from dataclasses import replace

import numpy as np
import pytest

from saccade import slam
from saccade.datasets import load
from saccade.diagnostics import check_log, check_run
from saccade.errors import LogError
from saccade.simulation import WorldConfig, simulate_world
from saccade.types import LandmarkLog
from support.logs import mounted, with_observations
from support.nightly import nightly

WORLD = WorldConfig(
    course_length=30.0,
    curvature_amplitude=1.5,
    steps=140,
    step_length=0.5,
    landmarks=20,
    range_limits=(0.5, 8.0),
)


def scaled(log, control=(1, 1, 1), observation=(1, 1), sigma=1.0):
    u, z = np.array(control, float), np.array(observation, float)
    return replace(
        log,
        control=log.control * u,
        control_covariance=log.control_covariance * np.outer(u, u) * sigma**2,
        observation=log.observation * z,
        observation_covariance=log.observation_covariance * np.outer(z, z) * sigma**2,
    )


def drive_before_turn(log):
    distance, turn = np.hypot(*log.control[:, :2].T), log.control[:, 2]
    return replace(log, control=np.stack([distance, 0 * distance, turn], 1))


def rename(log):
    names = log.landmark.copy()
    names[len(names) // 2 :] = np.roll(np.arange(20), 7)[names[len(names) // 2 :]]
    return replace(log, landmark=names)


def share(log):
    first, second = np.argsort(-np.bincount(log.landmark))[:2]
    return replace(log, landmark=np.where(log.landmark == second, first, log.landmark))


def observed(log, pose, keep):
    names = ("observation", "observation_covariance", "landmark")
    kept = {name: getattr(log, name)[keep] for name in names}
    return replace(log, observation_pose=pose[keep], **kept)


def delay(log):
    pose = log.observation_pose + 3
    return observed(log, pose, pose < len(log.time))


def turn_sensor(log):
    return replace(log, observation=log.observation + np.array([0, np.pi / 2]))


def lose_steps(log):
    keep = np.random.default_rng(3).random(len(log.time)) > 0.1
    keep[0] = True
    number = np.cumsum(keep) - 1
    fewer = observed(log, number[log.observation_pose], keep[log.observation_pose])
    return LandmarkLog(
        **{
            **vars(fewer),
            "time": log.time[keep],
            "control": log.control[keep[1:]],
            "control_covariance": log.control_covariance[keep[1:]],
        }
    )


DEGREES = 180 / np.pi
WRONG = {
    "degrees": (lambda log: scaled(log, (1, 1, DEGREES), (1, DEGREES)), "refused"),
    "millimeters": (lambda log: scaled(log, observation=(1000, 1)), "millimeters"),
    "sign": (lambda log: scaled(log, observation=(1, -1)), "mirrored bearings"),
    "order": (drive_before_turn, "motion order"),
    "sigmas x 30": (lambda log: scaled(log, sigma=30), "noise"),
    "sigmas / 30": (lambda log: scaled(log, sigma=1 / 30), "noise"),
    "renamed": (rename, "labels change"),
    "shared": (share, "shared label"),
    "clock": (delay, "clock offset"),
    "frame": (turn_sensor, "turned sensor"),
    "lost steps": (lose_steps, "lost steps"),
    "turn": (lambda log: scaled(log, (1, 1, DEGREES)), "degrees"),
}
WORDS = {
    "clock": "3 s late",
    "frame": "by 90 degrees",
    "sigmas x 30": "times too large",
    "sigmas / 30": "times too small",
}


@pytest.fixture(scope="module")
def good():
    return simulate_world(WORLD, 1)


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_log_is_refused_or_its_cause_is_named_first(kind, good):
    spoil, cause = WRONG[kind]
    log = spoil(good)
    if cause == "refused":
        with pytest.raises(LogError, match="they are in degrees; multiply bearings"):
            check_log(log)
        return
    causes = check_log(log)
    findings = causes or check_run(log, slam.run(log))
    assert findings[0].check == cause
    assert WORDS.get(kind, "") in findings[0].what


MOUNTINGS = [(0.3, 0.0, 0.0), (0.0, -0.3, 0.0), (0.0, 0.0, np.deg2rad(5)), (0.3, 0.3, -0.5)]


def test_a_slip_of_odometry_that_labels_correct_is_reported():
    """One step that is declared 1.04 m and half a radian too far."""
    log = simulate_world(replace(WORLD, steps=300), 2)
    slip, control = np.array([1.0, 0.3, 0.5]), log.control.copy()
    control[150] += slip
    slipped = replace(log, control=control)
    result = slam.run(slipped)
    (finding,) = check_run(slipped, result, check_log(slipped))
    assert finding.check == "corrected"
    assert finding.value == pytest.approx(np.hypot(*slip[:2]), abs=0.15)
    (pose,) = np.flatnonzero(result.corrections.any(1))
    assert 151 <= pose < 156
    assert result.corrections[pose, 2] == pytest.approx(-slip[2], abs=0.05)
    assert not slam.run(log).corrections.any()


@pytest.mark.parametrize(
    ("sensor", "known"),
    [
        *((sensor, (0.0, 0.0, 0.0)) for sensor in MOUNTINGS[2:]),
        (MOUNTINGS[3], (0.5, 0.0, 0.25)),
        *nightly(*((sensor, (0.0, 0.0, 0.0)) for sensor in MOUNTINGS[:2])),
    ],
)
def test_the_mounting_of_the_sensor_is_found(sensor, known, good):
    """By the data alone, within 0.1 m and a degree; and in the frame that the log gives."""
    log = mounted(good, sensor)
    if any(known):
        x, y, yaw = known  # the log has the sensor there
        c, s = np.cos(yaw), np.sin(yaw)
        true = x + c * sensor[0] - s * sensor[1], y + s * sensor[0] + c * sensor[1]
        log = replace(mounted(good, (*true, yaw + sensor[2])), sensor=known)
        sensor = *true, yaw + sensor[2]
    (finding,) = check_log(log)
    assert (finding.severity, finding.check) == ("error", "sensor mounting")
    found = np.array(finding.advice.split()[4].split(","), float)
    np.testing.assert_allclose(found[:2], sensor[:2], atol=0.1)
    assert found[2] == pytest.approx(sensor[2], abs=np.deg2rad(1))
    assert check_log(replace(log, sensor=sensor)) == ()


def test_a_sensor_one_step_ahead_is_like_the_other_motion_order(good):
    """Turn and translation are exchanged exactly by a lever arm of the length of a step."""
    (finding,) = check_log(mounted(good, (0.5, 0.0, 0.0)))
    assert finding.severity == "warning"
    assert finding.check == "motion order"
    assert re.search("or the sensor is mounted 0.(4|5)", finding.what)


def test_halves_of_observations_are_left_out(good):
    half = good.observation.copy()
    half[::7, 0] = half[3::7, 1] = np.nan
    log = replace(mounted(good, (0.0, 0.3, 0.0)), observation=half)
    whole = np.isfinite(half).all(1)
    assert check_log(log) == check_log(with_observations(log, whole))


@pytest.mark.shared
@pytest.mark.parametrize("number", [6, 9])
@pytest.mark.parametrize("robot", range(1, 6))
def test_recorded_logs_have_no_findings(number, robot, shared):
    log = load("mrclam", shared / f"data/logs/mrclam/mrclam{number}.npz", robot=robot)
    assert check_log(log) == ()


PRECISE = replace(WORLD, range_percent=2.0, bearing_sigma_deg=1.0, odometry_percent=1.0, steps=600)
"""A sensor and odometry in which errors of a few percent are seen."""


def veer(log):
    turned = log.control + np.array([0, 0, np.deg2rad(1.6)]) * log.control[:, :1]  # per meter
    return replace(log, control=turned)


@pytest.mark.parametrize(
    ("spoil", "hint", "seed"),
    [
        (lambda log: scaled(log, observation=(1.02, 1)), "ranges are on average", 0),
        (veer, "bearings are on average", 1),
        (lambda log: mounted(log, (0, 0, np.deg2rad(2))), "noise", 2),
    ],
)
def test_an_inconsistent_run_warns_with_the_side_of_its_innovations(spoil, hint, seed):
    config = slam.EkfConfig(estimate_systematic_errors=False, smooth=False)
    log = simulate_world(PRECISE, seed)
    assert check_run(log, slam.run(log, config)) == ()
    wrong = spoil(log)
    finding = check_run(wrong, slam.run(wrong, config))[0]
    assert (finding.severity, finding.check) == ("warning", "consistency")
    assert hint in finding.what


def test_a_difference_of_scale_is_told_where_it_is_not_declared():
    """Ranges 5 % too long are odometry 5 % too short, by the data alone."""
    log = scaled(simulate_world(PRECISE, 1), observation=(1.05, 1))
    result = slam.run(replace(log, odometry_bias=(0.05, 0.05, 0.05)))
    (finding,) = check_run(replace(log, odometry_bias=(0.0, 0.0, 0.0)), result)
    assert finding.check == "scale"
    assert finding.value == pytest.approx(5, abs=0.5)
    assert check_run(replace(log, odometry_bias=(0.1, 0.0, 0.0)), result) == ()


@pytest.mark.parametrize(("seed", "named"), [(0, True), (2, False)])
def test_good_logs_have_no_findings(seed, named):
    log = simulate_world(WORLD, seed)
    if not named:
        log = replace(log, landmark=np.full(len(log.landmark), -1))
    assert check_run(log, slam.run(log), check_log(log)) == ()


@pytest.mark.parametrize(("later", "found"), [(0.07, []), (0.4, ["labels change"])])
def test_labels_that_are_misread_at_times_do_not_change(later, found, good):
    """Few misread labels are rejected at first, while most labels are new."""
    rows = np.arange(len(good.landmark))
    rate = np.where(rows < len(rows) // 5, 0.02, later)
    rejected = np.random.default_rng(0).random(len(rows)) < rate
    findings = check_run(good, replace(slam.run(good), rejected=rejected))
    assert [each.check for each in findings] == found


@pytest.mark.nightly
def test_a_run_with_halves_of_observations_is_judged(good):
    half = good.observation.copy()
    half[::5, 0] = half[2::5, 1] = np.nan
    log = replace(good, observation=half)
    assert check_run(log, slam.run(log), check_log(log)) == ()
    unnamed = replace(log, landmark=np.full(len(log.landmark), -1))
    findings = check_run(unnamed, slam.run(unnamed), check_log(unnamed))
    assert [each.check for each in findings] == ["unused"]  # halves name no landmark


@pytest.mark.parametrize("seed", [0, *nightly(1)])
def test_odometry_that_turns_too_far_is_left_to_the_filter(seed):
    """It resembles a wrong order of motion, or noise that is stated too small."""
    sensors = {"odometry_percent": 0.5, "range_percent": 1.0, "bearing_sigma_deg": 0.5}
    world = WorldConfig(heading_drift_deg=2.0, steps=250, **sensors)
    assert check_log(simulate_world(world, seed)) == ()
