"""Steps one by one, as a live robot takes them, against whole logs and against custom rules."""

import copy
import dataclasses
import doctest
from importlib.resources import files

import numpy as np
import pytest

from saccade import slam
from saccade.datasets import load
from saccade.errors import LogError
from saccade.slam import EkfConfig, observe, online, turn_then_translate
from saccade.slam.run import slam_for
from support.circular_log import simulate


def _cluttered(rng, steps=250):
    """A log without names, trees that are there for a while only, and what is no tree."""
    log, truth, _ = simulate(rng, steps=steps)
    passing, first = rng.uniform(-9, 9, (60, 2)), 3 * np.arange(60)
    rows = [np.column_stack([log.observation_pose, log.observation])]
    for step, pose in enumerate(truth):
        there = passing[(first <= step) & (step < first + 12)]
        z, _ = observe(pose, there)
        false = np.column_stack([rng.uniform(1, 8, 2), rng.uniform(-3, 3, 2)])
        z = np.concatenate([z[z[:, 0] < 8.0], false])
        rows.append(np.column_stack([np.full(len(z), step), z]))
    seen = np.concatenate(rows)
    seen = seen[np.argsort(seen[:, 0], kind="stable")]
    return dataclasses.replace(
        log,
        observation_pose=seen[:, 0].astype(np.int64),
        observation=seen[:, 1:],
        observation_covariance=np.tile(log.observation_covariance[0], (len(seen), 1, 1)),
        landmark=np.full(len(seen), -1),
    )


CULLING = EkfConfig(candidate_scans=4, confirm_after=3, culling_ratio=0.9)


def _scan_of(log, step):
    """The arguments of `Slam.step`."""
    k = log.observation_pose == step
    moved = [log.control[step - 1], log.control_covariance[step - 1]] if step > 0 else [None, None]
    return (log.time[step], *moved, *(each[k] for each in (
        log.observation, log.observation_covariance, log.landmark
    )))  # fmt: skip


def _check_steps(log, config):
    """That the steps of a log have the bits of its run; returns the run and the number culled."""
    whole = slam.run(log, config)
    live = slam_for(log, config)
    steps, association = [], np.empty(0, np.int64)
    for i in range(len(log.time)):
        mapped = len(live.ekf)
        step = live.step(*_scan_of(log, i))
        kept = np.setdiff1d(np.arange(mapped + len(step.association)), step.culled)
        moved = np.full(mapped + len(step.association) + 1, -1)  # the last is for none
        moved[kept] = np.arange(len(kept))
        association = np.concatenate([moved[association], step.association])
        steps.append(step)
    for ours, theirs in (
        ([each.pose for each in steps], whole.trajectory.pose),
        ([each.covariance for each in steps], whole.trajectory.covariance),
        ([row for each in steps for row in each.innovations], whole.innovation),
        ([C for each in steps for C in each.innovation_covariances], whole.innovation_covariance),
        ([nis for each in steps for nis in each.nis], whole.consistency.nis),
        (live.ekf.landmarks[live.confirmed], whole.map.xy),
        (live.ekf.landmark_covariances[live.confirmed], whole.map.covariance),
    ):
        assert np.reshape(ours, theirs.shape).tobytes() == theirs.tobytes()
    number = np.where(live.confirmed, np.cumsum(live.confirmed) - 1, -1)
    association[association >= 0] = number[association[association >= 0]]
    np.testing.assert_array_equal(association, whole.association)
    culled = live.culling.removed
    assert culled == whole.removed
    assert culled + live.culling.forgotten == sum(len(each.culled) for each in steps)
    return whole, culled


def test_steps_of_victoria_park_have_the_bits_of_its_run():
    log = load("auto", files("saccade") / "data" / "victoria_park.txt")
    whole, _ = _check_steps(log, EkfConfig())
    assert len(whole.map) > 40


def test_steps_have_the_bits_of_a_run_where_landmarks_are_culled_and_biases_are_found(rng):
    log = dataclasses.replace(_cluttered(rng), odometry_bias=(0.05, 0.02, 0.02))
    whole, culled = _check_steps(log, dataclasses.replace(CULLING, max_hypotheses=1))
    assert whole.odometry_bias is not None
    assert culled > 1


def test_state_that_is_saved_goes_on_to_the_same_bits(rng):
    log = _cluttered(rng, steps=80)
    one, two = (slam_for(log, CULLING) for _ in "ab")
    for i in range(40):
        one.step(*_scan_of(log, i))
    saved = copy.deepcopy(one.to_arrays())
    ends = []
    two.from_arrays(saved)
    for each in (one, two):
        for i in range(40, 80):
            end = each.step(*_scan_of(log, i))
        ends.append(end)
    assert ends[0].pose.tobytes() == ends[1].pose.tobytes()
    assert one.ekf.covariance.tobytes() == two.ekf.covariance.tobytes()
    assert one.num_steps == two.num_steps == 80


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": np.nan}, "time: expected finite"),
        ({"control": [1.0]}, r"control: expected shape \(2,\), found \(1,\)"),
        ({"control": [np.nan, 0.0]}, "control 0: expected numbers within 1e\\+09, found .nan, 0"),
        ({"U": None}, "covariance of the control: expected shape"),
        ({"U": -np.eye(2)}, "covariance of control 0: expected a symmetric"),
        ({"z": [[1.0, 0.0, 2.0]]}, r"observations: expected shape \(1, 2\)"),
        ({"R": np.zeros((2, 2, 2))}, r"covariances of the observations: expected shape"),
        ({"names": [1, 2]}, r"names: expected shape \(1,\)"),
        ({"names": [1.5]}, r"names: expected names of landmarks .*, found 1.5"),
        ({"time": "now"}, "time: expected numbers, found 'now'"),
        ({"time": 0.5}, "time: expected 1 or later, found 0.5"),
        ({"control": ["a", "b"]}, "control: expected numbers, found"),
        ({"z": [[-1.0, 0.2]]}, "observation 0: expected a range of 0 m or more, found -1"),
        (
            {"z": [[3.0, 300.0]]},
            "observation 0: expected a bearing in radians, within 2 pi, found 300",
        ),
        ({"z": 3.0}, r"observations: expected shape \(1, 2\)"),
        ({"z": [[1.0], [1.0, 2.0]]}, "observations: expected numbers, found"),
    ],
)
@pytest.mark.parametrize(
    "motion", [turn_then_translate, lambda pose, control: turn_then_translate(pose, control)]
)
def test_a_step_that_is_none_is_refused_and_changes_nothing(change, message, motion):
    step = {
        "time": 1.0,
        "control": [0.5, 0.1],
        "U": np.eye(2) * 1e-4,
        "z": [[3.0, 0.2]],
        "R": np.eye(2)[None] * 0.01,
        "names": [4],
    }
    live = slam.Slam(EkfConfig(association="known"), motion=motion)
    if motion is not turn_then_translate and "found (1,)" in message.replace("\\", ""):
        message = "covariance of the control"  # a custom model has as many numbers as are given
    live.step(**step)
    before = copy.deepcopy(live.to_arrays())
    with pytest.raises(LogError, match=message) as caught:
        live.step(**{**step, **change})
    assert "\n" not in str(caught.value)
    for name, array in live.to_arrays().items():
        assert array.tobytes() == before[name].tobytes()
    live.step(**step)


def test_an_estimate_that_diverges_is_named():
    live = slam.Slam()
    live.step(0.0, [6e8, 0.0], np.eye(2))
    with pytest.raises(LogError, match="pose 1: expected a position within 1e\\+09 m"):
        live.step(1.0, [6e8, 0.0], np.eye(2))


def test_the_example_of_the_docstring_runs():
    assert doctest.testmod(online).attempted >= 7
    assert doctest.testmod(online).failed == 0
