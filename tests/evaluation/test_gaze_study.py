"""The study of gaze policies: its scores by hand, and its stored runs."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from saccade.errors import ConfigError
from saccade.evaluation.gaze import GazeScores
from saccade.evaluation.gaze_runs import SCORES, TIMES, GazeRun, first_closure, result_of
from saccade.types import LandmarkMap, Trajectory
from saccade.visual import LandmarkObservations, VisualResult


def run(world, policy, seed, ate, closed=1.0):
    scores = dict.fromkeys(SCORES, 0.5) | {"ate_m": ate, "closed": closed}
    names = {"world": world, "policy": policy, "seed": seed}
    return names | scores | {"entropy_over_time": [float(seed)] * TIMES}


def result(pose, frame, landmark, kind):
    """Of observations of landmarks along poses."""
    n, k = len(pose), len(frame)
    path = Trajectory(np.arange(n, dtype=float), pose, np.zeros((n, 3, 3)))
    observed = LandmarkObservations.zeros(
        k, frame=np.array(frame), landmark=np.array(landmark), kind=np.array(kind)
    )
    none = LandmarkMap(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    rest = (np.zeros((0, 128), np.uint8), np.zeros(0), observed, np.zeros((n, 3)), 0, {})
    return VisualResult(path, path, path, none, *rest, np.zeros(n), np.zeros(n, bool), ())


def test_the_ratio_of_the_ate_is_the_geometric_mean_over_worlds_and_seeds():
    runs = [
        run(world, policy, seed, factor * (seed + 1) * size, closed=float(policy == "sweep"))
        for world, size in (("ring", 0.1), ("rooms", 3.0))
        for policy, factor in (("fixed", 1.0), ("sweep", 4.0 if size > 1 else 1.0))
        for seed in range(3)
    ]
    scores = GazeScores.of(runs)
    fixed, sweep = scores.comparison("fixed")
    assert fixed["ate_m_ratio"] == [1, 1, 1]
    assert_allclose(sweep["ate_m_ratio"], [2, 2, 2])
    assert (fixed["closed"], sweep["closed"], sweep["drives"]) == (0, 6, 6)
    assert [row["ate_m"][0] for row in scores.rows()] == pytest.approx([0.2, 0.2, 6, 24])
    assert_allclose(scores.entropy[1, 0, 2], 2.0)


def test_a_loop_is_closed_by_three_landmarks_after_five_meters():
    pose = np.column_stack([np.arange(12.0), np.zeros((12, 2))])
    seen = [0, 0, 0, 4, 4, 4, 11, 11, 11]
    names = [0, 1, 2, 0, 1, 2, 0, 1, 2]
    first, again = [0] * 3, [2] * 3
    assert first_closure(result(pose, seen, names, [*first, *again, *again])) == 11
    assert first_closure(result(0.5 * pose, seen, names, [*first, *again, *again])) is None
    assert first_closure(result(pose, seen, names, [*first, *again, 2, 2, 1])) is None


def test_a_stored_run_is_read_and_a_broken_one_is_named(tmp_path):
    stored = GazeRun("rooms", "fixed", 0, 8)
    path = stored.path(tmp_path)
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps(run("rooms", "fixed", 0, 0.25)))
    assert result_of(stored, tmp_path)["ate_m"] == 0.25
    path.write_text(json.dumps(run("rooms", "fixed", 1, 0.25)))
    with pytest.raises(ConfigError, match="rooms-camera-8-fixed-0"):
        result_of(stored, tmp_path)


def test_a_run_is_computed_stored_and_repeated_to_the_bit(tmp_path):
    short = GazeRun("rooms", "informative", 1, 10)
    row = result_of(short, tmp_path / "a")
    assert json.loads(short.path(tmp_path / "a").read_text()) == row
    again = result_of(short, tmp_path / "b")
    assert {k: v for k, v in again.items() if "ms" not in k} == {
        k: v for k, v in row.items() if "ms" not in k
    }
    assert row["inside_3sigma"] > 0.8
