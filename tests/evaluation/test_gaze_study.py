"""The study of gaze policies: its scores by hand, its stored runs, and what it claims."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from saccade.errors import ConfigError
from saccade.evaluation.gaze import (
    GazeRun,
    closes_loop,
    compare,
    drive_by_landmarks,
    landmark_world,
    result_of,
)
from saccade.visual import LandmarkObservations
from saccade.visual.config import EGOMOTIONS


def run(world, policy, seed, ate, closed=1.0):
    names = {"world": world, "policy": policy, "seed": seed}
    return names | {"ate_m": ate, "closed": closed, "inside_3sigma": 0.5}


def test_the_ratio_of_the_ate_is_the_geometric_mean_over_worlds_and_seeds():
    runs = [
        run(world, policy, seed, factor * (seed + 1) * size, closed=float(policy == "sweep"))
        for world, size in (("ring", 0.1), ("rooms", 3.0))
        for policy, factor in (("fixed", 1.0), ("sweep", 4.0 if size > 1 else 1.0))
        for seed in range(3)
    ]
    fixed, sweep = compare(runs)
    assert fixed["to_fixed"] == [1, 1, 1]
    assert_allclose(sweep["to_fixed"], [2, 2, 2])
    assert_allclose(fixed["to_sweep"], [0.5, 0.5, 0.5])
    assert sweep["worlds"] == pytest.approx({"ring": 1, "rooms": 4})
    assert sweep["worst"] == pytest.approx(4)
    assert (fixed["closed"], sweep["closed"], sweep["drives"]) == (0, 6, 6)
    assert fixed["inside_3sigma"] == 0.5
    assert compare(runs[:3])[0]["to_sweep"] is None


@pytest.mark.parametrize(
    ("last", "landmarks", "kind", "closes"),
    [
        (11, [0, 1, 2], 2, True),
        (5, [0, 1, 2], 2, False),  # too early
        (11, [0, 1, 1], 2, False),  # too few
        (11, [0, 1, 2], 1, False),  # tracked all the time
    ],
)
def test_a_loop_is_closed_by_three_landmarks_that_are_found_again(last, landmarks, kind, closes):
    frame, landmark = [0, 0, 0, last, last, last], [0, 1, 2, *landmarks]
    columns = {"frame": frame, "landmark": landmark, "kind": [0, 0, 0, kind, kind, kind]}
    arrays = {name: np.array(values) for name, values in columns.items()}
    assert closes_loop(LandmarkObservations.zeros(6, **arrays), 12) is closes


def test_a_stored_run_is_read_and_a_broken_one_is_named(tmp_path):
    stored = GazeRun("rooms", "fixed", 0, "images", egomotion="camera", frames=8)
    path = stored.path(tmp_path)
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps(run("rooms", "fixed", 0, 0.25)))
    assert result_of(stored, tmp_path)["ate_m"] == 0.25
    path.write_text(json.dumps(run("rooms", "fixed", 1, 0.25)))
    with pytest.raises(ConfigError, match="rooms-fixed-0-images-new-camera-8"):
        result_of(stored, tmp_path)


@pytest.mark.parametrize("egomotion", EGOMOTIONS)
def test_a_run_is_computed_stored_and_repeated_to_the_bit(tmp_path, egomotion):
    short = GazeRun("rooms", "active", 1, "images", egomotion=egomotion, frames=10)
    row = result_of(short, tmp_path / "a")
    assert json.loads(short.path(tmp_path / "a").read_text()) == row
    assert result_of(short, tmp_path / "b") == row
    assert row["inside_3sigma"] > 0.8


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"world": "moon"}, "world"),
        ({"policy": "clever"}, "policy"),
        ({"egomotion": "camera"}, "egomotion"),
        ({"level": "images", "world": "ring", "map": "known"}, "map"),
        ({"level": "images", "world": "ring", "policy": "360"}, "policy"),
    ],
)
def test_runs_that_cannot_be_are_named(wrong, word):
    with pytest.raises(ConfigError, match=word):
        GazeRun(**{"world": "pond", "policy": "active", "seed": 0, **wrong})


@pytest.mark.parametrize("known", [False, True])
def test_a_robot_that_decides_where_to_look_errs_less_than_half_of_one_that_looks_ahead(known):
    fixed, active = (
        drive_by_landmarks(landmark_world("pond"), policy, 100, known)
        for policy in ("fixed", "active")
    )
    assert active["ate_m"] < 0.5 * fixed["ate_m"]
    assert active["closed"]
    assert active["inside_3sigma"] > 0.8


def test_a_constant_pan_and_a_view_of_everything_are_runs(tmp_path):
    ahead, zero, around = (
        result_of(GazeRun("pond", policy, 3), tmp_path) for policy in ("fixed", "0", "360")
    )
    assert zero["ate_m"] == ahead["ate_m"] > around["ate_m"]
