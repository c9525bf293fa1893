"""The SLAM playground without a browser: its world, its filters, and what it refuses."""

import json
import re

import numpy as np
import pytest

from saccade.errors import ConfigError, LogError
from saccade.serving.playground import (
    MAX_SESSIONS,
    MAX_STEPS,
    MAX_WORLD_LANDMARKS,
    Playground,
    PlaygroundNoise,
    Session,
    World,
    positions,
    rings,
)
from saccade.slam.consistency import chi_square_band
from saccade.viewing.page import as_json

LAP = [0.5, 0.05]
"""A step on the circle between the rings of landmarks."""


def _rings():
    return positions(rings(), "landmarks")


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_measurements_vary_as_their_covariances_say_times_the_assumed_factor(factor):
    noise = PlaygroundNoise(max_range=20, assumed_factor=factor)
    world = World(3)
    world.add(_rings())
    controls, observations = [], []
    for _ in range(126):
        scan = world.move(np.array(LAP), noise)
        offset = np.array([world.landmarks[each] for each in scan.labels]) - world.pose[:2]
        expected = np.stack([np.hypot(*offset.T), np.arctan2(offset[:, 1], offset[:, 0])], 1)
        error = scan.z - expected
        error[:, 1] += world.pose[2]
        error[:, 1] = np.angle(np.exp(1j * error[:, 1]))
        controls.append(factor * (scan.control - LAP) / np.sqrt(np.diagonal(scan.U)))
        sigma = np.sqrt(np.diagonal(scan.R, axis1=1, axis2=2)) / factor
        observations.append(error / sigma)
    for normalized in (np.array(controls), np.concatenate(observations)):
        low, high = chi_square_band(1, len(normalized), 0.9999)
        assert (low < np.square(normalized).mean(0)).all()
        assert (np.square(normalized).mean(0) < high).all()
    assert np.allclose(np.hypot(*world.pose[:2]), 10, atol=0.5)  # the circle is closed


def test_a_session_is_started_driven_and_switched():
    playground = Playground()
    started = json.loads(as_json(playground.start({"seed": 4, "filter": "invariant"})))
    assert len(started["steps"]) == 1
    assert started["steps"][0]["filters"]["standard"]["nees"] is None
    token = started["session"]
    ask = {"session": token, "commands": [LAP, None, [-0.1, 0.2]]}
    first = playground.step({**ask, "filter": "standard"})
    again = Playground()
    same = again.start({"seed": 4})
    second = again.step({"session": same["session"], "commands": ask["commands"]})
    assert as_json({"": first["steps"]}) == as_json({"": second["steps"]})
    changed = {"add": [[0, -9]], "remove": [0, 3], "filter": "standard"}
    after = playground.step({"session": token, **changed})
    assert after["steps"] == []
    assert after["labels"] == [1, 2, *range(4, 17)]
    assert after["landmarks"][-1] == [0, -9]
    size = 3 + 2 * len(after["map"]["labels"])
    correlation = after["map"]["correlation"].reshape(size, size)
    assert np.allclose(np.diagonal(correlation), 1)
    assert np.abs(correlation).max() <= 1 + 1e-9
    assert np.allclose(correlation, correlation.T)


def test_only_the_last_sessions_are_kept_and_steps_are_limited(monkeypatch):
    playground = Playground()
    tokens = [playground.start({})["session"] for _ in range(MAX_SESSIONS + 1)]
    with pytest.raises(KeyError, match="no longer in memory"):
        playground.step({"session": tokens[0]})
    playground.sessions[tokens[1]].num_steps = MAX_STEPS - 1
    with pytest.raises(ConfigError, match="commands: expected 1 more steps; start again, found 2"):
        playground.step({"session": tokens[1], "commands": [None, None]})
    playground.step({"session": tokens[1], "commands": [None]})

    def diverges(*_):
        raise LogError("it diverged")

    monkeypatch.setattr(Session, "step", diverges)
    with pytest.raises(LogError):
        playground.step({"session": tokens[2], "commands": [None]})
    with pytest.raises(KeyError):
        playground.step({"session": tokens[2]})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"session": None}, "no longer in memory"),
        ({"filter": "none"}, "filter: expected one of invariant, standard"),
        ({"commands": 3}, "commands: expected a list of at most 50"),
        ({"commands": [None] * 51}, "commands: expected a list of at most 50"),
        ({"commands": [[1, "x"]]}, "commands: expected a distance up to 2 m"),
        ({"commands": [[2.1, 0]]}, "commands: expected a distance up to 2 m"),
        ({"commands": [[0, -4]]}, "commands: expected a distance up to 2 m and up to half a turn"),
        ({"add": [[101, 0]]}, "add: expected at most 60 positions within 100 m"),
        ({"add": [[0, 0, 0]]}, "add: expected at most 60 positions"),
        ({"add": [[0, 0]] * (MAX_WORLD_LANDMARKS + 1)}, "add: expected at most 60 positions"),
        ({"add": [[0, 0]] * MAX_WORLD_LANDMARKS}, "landmarks: expected at most 44 more, found 60"),
        ({"remove": [99]}, "remove: expected labels of landmarks, found [99]"),
        ({"remove": [[]]}, "remove: expected labels of landmarks"),
        ({"noise": []}, "noise: expected a table of settings"),
        ({"noise": {"loud": 1}}, "noise: no setting 'loud'; expected any of distance_percent"),
        ({"noise": {"max_range": "far"}}, "noise: max_range: expected a number, found 'far'"),
        ({"noise": {"range_percent": 0}}, "range_percent: expected 0.5 to 20, found 0"),
    ],
)
def test_invalid_requests_are_one_line_errors_and_change_nothing(change, words):
    playground = Playground()
    token = playground.start({})["session"]
    before = as_json(playground.step({"session": token}))
    with pytest.raises((ConfigError, KeyError), match=re.escape(words)):
        playground.step({"session": token, "commands": [LAP], **change})
    assert as_json(playground.step({"session": token})) == before
