"""The study of gaze policies: its scores by hand, its stored runs, and what it claims."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from saccade.errors import ConfigError
from saccade.evaluation.gaze import (
    GazeRun,
    compare,
    drive_by_landmarks,
    gaze_drive,
    landmark_world,
    result_of,
)
from saccade.evaluation.runs import score_drive
from saccade.simulation import DriveConfig
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


def test_a_run_is_stored_and_read_and_a_broken_one_is_named(tmp_path):
    short = GazeRun("pond", "sweep", 1)
    path = short.path(tmp_path)
    row = result_of(short, tmp_path)
    assert json.loads(path.read_text()) == row == result_of(short, tmp_path / "again")
    path.write_text(json.dumps(run("pond", "sweep", 1, 0.25)))
    assert result_of(short, tmp_path)["ate_m"] == 0.25
    path.write_text(json.dumps(run("pond", "sweep", 2, 0.25)))
    with pytest.raises(ConfigError, match="pond-sweep-1-new"):
        result_of(short, tmp_path)


@pytest.mark.parametrize("egomotion", EGOMOTIONS)
def test_a_drive_whose_camera_is_turned_is_repeated_to_the_bit(egomotion):
    config = DriveConfig(world="rooms", frames=10, image_size=(240, 180), size=(7.0, 5.5))
    (drive, first), (_, second) = (
        gaze_drive(config, "active", 1, egomotion=egomotion) for _ in range(2)
    )
    np.testing.assert_array_equal(first.trajectory.pose, second.trajectory.pose)
    assert score_drive(first.trajectory, drive.truth).inside_3sigma > 0.8


@pytest.mark.parametrize("wrong", [{"world": "moon"}, {"policy": "clever"}, {"map": "old"}])
def test_runs_that_cannot_be_are_named(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
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


def test_a_policy_of_the_user_and_a_view_of_everything_are_driven():
    world = landmark_world("pond")
    ahead, zero = (drive_by_landmarks(world, policy, 3) for policy in ("fixed", lambda _: 0.0))
    around = drive_by_landmarks(world, "fixed", 3, fov=2 * np.pi)
    assert zero["ate_m"] == ahead["ate_m"] > around["ate_m"]
