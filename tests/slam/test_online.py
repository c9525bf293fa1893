"""Steps one by one, as a live robot takes them, against whole logs and against custom rules."""

import doctest

import numpy as np
import pytest

from saccade import slam
from saccade.errors import LogError
from saccade.slam import EkfConfig, online


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": np.nan}, "time: expected finite"),
        ({"control": [1.0]}, r"control: expected 2 or 3 numbers, found shape \(1,\)"),
        ({"control": [np.nan, 0.0]}, "control: expected numbers within 1e\\+09, found .nan, 0"),
        ({"U": None}, "covariance of the control: expected shape"),
        ({"U": -np.eye(2)}, "covariance of the control: expected a symmetric"),
        ({"z": [[1.0, 0.0, 2.0]]}, r"observations: expected shape \(1, 2\)"),
        ({"R": np.zeros((2, 2, 2))}, r"covariances of the observations: expected shape"),
        ({"labels": [1, 2]}, r"labels: expected shape \(1,\)"),
        ({"labels": [1.5]}, r"labels: expected names of landmarks .*, found 1.5"),
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
def test_a_step_that_is_none_is_refused_and_changes_nothing(change, message):
    step = {
        "time": 1.0,
        "control": [0.5, 0.1],
        "U": np.eye(2) * 1e-4,
        "z": [[3.0, 0.2]],
        "R": np.eye(2)[None] * 0.01,
        "labels": [4],
    }
    live = slam.Slam(EkfConfig(association="known"))
    live.step(**step)
    before = live.filter.copy(), live.landmarks.copy(), live.num_steps
    with pytest.raises(LogError, match=message) as caught:
        live.step(**{**step, **change})
    assert "\n" not in str(caught.value)
    assert live.filter.state.tobytes() == before[0].state.tobytes()
    assert live.filter.covariance.tobytes() == before[0].covariance.tobytes()
    assert (live.landmarks.counts.observations == before[1].counts.observations).all()
    assert (live.landmarks.labels, live.num_steps) == (before[1].labels, before[2])
    live.step(**step)


def test_one_covariance_serves_all_observations_and_the_map_is_read_by_label():
    one, all_alike = slam.Slam(), slam.Slam()
    z, R = np.array([[3.0, 0.2], [4.0, -0.1]]), np.diag([0.01, 0.001])
    one.step(0.0, z=z, R=R, labels=["door", 7])
    all_alike.step(0.0, z=z, R=np.tile(R, (2, 1, 1)), labels=["door", 7])
    assert one.filter.covariance.tobytes() == all_alike.filter.covariance.tobytes()
    assert len(one.map) == 0  # a label that was read once may be wrong
    one.step(1.0, z=z, R=R, labels=["door", 7])
    assert (one.map.id.tolist(), one.map.label.tolist()) == ([0, 1], ["door", "7"])


def test_an_estimate_that_diverges_is_named():
    live = slam.Slam()
    live.step(0.0, [6e8, 0.0], np.eye(2))
    with pytest.raises(LogError, match="pose 1: expected a position within 1e\\+09 m"):
        live.step(1.0, [6e8, 0.0], np.eye(2))


def test_the_example_of_the_docstring_runs():
    assert doctest.testmod(online).attempted >= 7
    assert doctest.testmod(online).failed == 0
