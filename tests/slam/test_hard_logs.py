"""Logs that are right but hard, and logs that are wrong: an estimate without NaN, or one line."""

import dataclasses
from importlib.resources import files

import numpy as np
import pytest

from saccade import slam
from saccade.datasets import load
from saccade.errors import LogError
from saccade.slam import EkfConfig, smooth
from saccade.types import LandmarkLog
from support.circular_log import simulate
from support.error_checks import result_or_refusal
from support.nightly import nightly

FILTERS = ["standard", "invariant"]
each_filter = pytest.mark.parametrize("kind", FILTERS)
each_association = pytest.mark.parametrize("association", ["known", "nearest"])


def _config(kind, association="known"):
    return EkfConfig(errors=kind, association=association, smooth=False)


def _is_sound(result):
    """Numbers everywhere, and no variance below zero beyond rounding."""
    for array in (
        result.trajectory.pose,
        result.trajectory.covariance,
        result.map.xy,
        result.map.covariance,
        result.dead_reckoning.pose,
    ):
        assert np.isfinite(array).all()
    for covariance in (result.trajectory.covariance, result.map.covariance):
        values = np.linalg.eigvalsh(covariance)
        assert (values[:, 0] >= -1e-9 * (values[:, -1] + 1)).all()


@each_filter
@each_association
@pytest.mark.parametrize("half", [[0.0, 0.0], [0.1, 0.0], [0.1, 0.02]])
def test_observations_that_are_exact_in_some_direction(rng, kind, association, half):
    """Of singular covariance, and their errors are as it says."""
    log, truth, _ = simulate(rng, steps=60, noise=0.0)
    spread = [0.02, 0.01, 0.01]
    error = rng.normal(size=(len(log.observation), 1)) * half
    log = dataclasses.replace(
        log,
        control=log.control + rng.normal(size=log.control.shape) * spread,
        observation=log.observation + error,
        observation_covariance=np.tile(np.outer(half, half), (len(error), 1, 1)),
    )
    result = slam.run(log, _config(kind, association))
    _is_sound(result)
    if association == "nearest":  # gates of a tenth of a millimetre leave most of it out
        return
    drives = (result.trajectory, smooth(log, result).trajectory, result.dead_reckoning)
    filtered, smoothed, astray = (np.hypot(*(each.pose - truth)[:, :2].T).max() for each in drives)
    assert max(filtered, smoothed) < 0.5 * astray


@each_filter
@pytest.mark.parametrize(
    "R", [np.zeros((2, 2)), np.diag([0.01, 0.0]), np.outer([0.1, 0.02], [0.1, 0.02])]
)
def test_observations_that_lie_about_being_exact(rng, kind, R):
    log, _, _ = simulate(rng, steps=60)
    log = dataclasses.replace(log, observation_covariance=np.tile(R, (len(log.observation), 1, 1)))
    result, refusal = result_or_refusal(lambda: slam.run(log, _config(kind)))
    if result is None:
        assert "found that the estimate diverged" in refusal
    else:
        assert np.isfinite(result.trajectory.pose).all()
        assert np.isfinite(result.map.xy).all()


@each_filter
@each_association
def test_times_that_repeat(rng, kind, association):
    log, _, _ = simulate(rng, steps=60)
    stuttering = dataclasses.replace(log, time=np.repeat(log.time[::3], 3)[: len(log.time)])
    still = dataclasses.replace(log, time=np.zeros(len(log.time)))
    for each in (stuttering, still):
        _is_sound(slam.run(each, _config(kind, association)))


@pytest.mark.parametrize(
    ("kind", "systematic"),
    [
        *[("invariant", True), ("standard", False)],
        *nightly(("invariant", False), ("standard", True)),
    ],
)
def test_an_hour_of_standing_still_before_the_same_landmarks(rng, kind, systematic):
    """A scan a second of two landmarks, and odometry that says nothing moves."""
    scans = 3600
    pose = np.repeat(np.arange(scans), 2)
    true = np.tile([[4.0, 0.5], [6.0, -0.7]], (scans, 1))
    log = LandmarkLog(
        name="parked",
        start=np.zeros(3),
        time=np.arange(scans) * 1.0,
        motion="turn_then_translate",
        control=np.zeros((scans - 1, 2)),
        control_covariance=np.zeros((scans - 1, 2, 2)),
        observation_pose=pose,
        observation=true + rng.normal(size=true.shape) * [0.1, 0.02],
        observation_covariance=np.tile(np.diag([0.01, 0.0004]), (2 * scans, 1, 1)),
        landmark=np.tile([0, 1], scans),
    )
    plain = dataclasses.replace(  # for the spread in closed form
        _config(kind), huber=np.inf, estimate_systematic_errors=systematic
    )
    result = slam.run(log, plain)
    _is_sound(result)
    np.testing.assert_allclose(result.trajectory.pose[-1], 0, atol=1e-9)
    expected = true[:2, :1] * np.stack([np.cos(true[:2, 1]), np.sin(true[:2, 1])], 1)
    np.testing.assert_allclose(result.map.xy, expected, atol=0.01)
    spread = np.sqrt(result.map.covariance[0].trace())
    variance = (0.01 + 16 * 0.0004) / scans
    if systematic:  # who stands still does not learn them
        scale, offset = plain.range_errors
        variance += (4 * scale) ** 2 + offset**2
    assert spread == pytest.approx(np.sqrt(variance), rel=0.05)


@each_filter
def test_a_landmark_under_the_robot(rng, kind):
    """It is driven over, seen from exactly there, and seen again."""
    R = np.tile(np.diag([0.01, 0.0004]), (6, 1, 1))
    log = LandmarkLog(
        name="over it",
        start=np.zeros(3),
        time=np.arange(4.0),
        motion="turn_then_translate",
        control=np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 0.5]]),
        control_covariance=np.tile(np.diag([1e-4, 1e-5]), (3, 1, 1)),
        observation_pose=np.array([0, 1, 1, 2, 2, 3]),
        observation=np.array(
            [[1.0, 0.0], [0.0, 0.0], [0.0, 2.0], [1.0, np.pi], [0.0, -1.0], [0.0, 0.0]]
        ),
        observation_covariance=R,
        landmark=np.array([0, 0, 1, 0, 2, 2]),
    )
    result = slam.run(log, _config(kind))
    _is_sound(result)
    np.testing.assert_allclose(result.map.xy, [[1, 0], [1, 0], [2, 0]], atol=0.2)
    smoothed, _ = result_or_refusal(lambda: smooth(log, result))
    if smoothed is not None:
        assert np.isfinite(smoothed.map.xy).all()


@each_filter
@each_association
def test_behind_is_behind_whichever_way_it_is_said(rng, kind, association):
    """Bearings of pi and of -pi are one; so are bearings that are a whole turn apart."""
    log, _, _ = simulate(rng, steps=80)
    turns = -np.sign(log.observation[:, 1]) * rng.integers(0, 2, len(log.observation))
    turned = log.observation + 2 * np.pi * np.stack([np.zeros(len(turns)), turns], 1)
    one, two = (
        slam.run(dataclasses.replace(log, observation=z), _config(kind, association))
        for z in (log.observation, turned)
    )
    np.testing.assert_allclose(two.trajectory.pose[:, :2], one.trajectory.pose[:, :2], atol=1e-9)
    np.testing.assert_array_equal(two.association, one.association)


@each_filter
@each_association
def test_a_log_of_nothing(kind, association):
    log = LandmarkLog(
        name="nothing",
        start=np.array([1.0, 2.0, 3.0]),
        time=np.zeros(1),
        motion="compose",
        control=np.empty((0, 3)),
        control_covariance=np.empty((0, 3, 3)),
        observation_pose=np.empty(0, np.int64),
        observation=np.empty((0, 2)),
        observation_covariance=np.empty((0, 2, 2)),
        landmark=np.empty(0, np.int64),
    )
    result = slam.run(log, _config(kind, association))
    np.testing.assert_array_equal(result.trajectory.pose, [[1, 2, 3]])
    assert len(result.map) == len(smooth(log, result).map) == 0


def test_a_log_that_ends_within_a_line_names_it(tmp_path):
    """Cut anywhere but between fields that the line can do without."""
    text = (files("saccade") / "data" / "victoria_park.txt").read_text()
    whole = text.splitlines()[:40]
    path = tmp_path / "cut.txt"
    for words in range(1, 8):
        path.write_text("\n".join(whole) + "\n" + " ".join(whole[39].split()[:words]))
        log, refusal = result_or_refusal(lambda: load("auto", path))
        assert log is None
        assert refusal.startswith(f"{path}, line 41: expected")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": [0.0, 1.0]}, "any: time: expected an array of numbers, found"),
        ({"landmark": np.array([1.5])}, "any: landmark: expected names .*, found 1.5"),
        ({"landmark": np.array([-2])}, "any: landmark: expected names .*, found -2"),
        ({"time": np.array([1.0, 0.0])}, "any: time: goes back at entry 1"),
        ({"control": np.zeros((0, 2))}, "expected shape"),
        ({"observation": np.array([[np.nan, np.nan]])}, "observation: expected finite"),
        ({"observation_pose": np.array([9])}, "numbers from 0 to 1"),
        ({"observation_covariance": -np.eye(2)[None]}, "negative"),
        ({"observation": np.array([[-1.0, 0.0]])}, "observation 0: expected a range of 0 m"),
        ({"observation": np.array([[1.0, 300.0]])}, "observation 0: expected a bearing .* 300"),
    ],
)
def test_a_log_of_impossible_values_is_refused(change, message):
    """The sensor of a log is not known before it is run."""
    fields = {
        "name": "any",
        "start": np.zeros(3),
        "time": np.array([0.0, 1.0]),
        "motion": "turn_then_translate",
        "control": np.zeros((1, 2)),
        "control_covariance": np.eye(2)[None],
        "observation_pose": np.array([1]),
        "observation": np.array([[1.0, 0.0]]),
        "observation_covariance": np.eye(2)[None],
        "landmark": np.array([4]),
    }
    slam.run(LandmarkLog(**fields))
    with pytest.raises(LogError, match=message) as caught:
        slam.run(LandmarkLog(**fields | change))
    assert "\n" not in str(caught.value)
