"""`saccade slam` as a person runs it: what it writes, and what becomes of it when it is stopped."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
import pytest
from evo.tools import file_interface

import saccade
from saccade import slam
from saccade.datasets import load
from saccade.evaluation.runs import summarize_run
from saccade.types import Trajectory
from support.circular_log import simulate
from support.commands import json_of

EXACT = dict.fromkeys(
    ("x", "cov_x_heading", "nis", "innovation_1", "innovation_2", "cov_1_1", "cov_1_2", "cov_2_2"),
    lambda text: float(text or "nan"),
)
"""Columns read with every digit, which pandas before 3.1 does not do by itself."""
PARK = Path(saccade.__file__).parent / "data" / "victoria_park.txt"


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """The first 150 lines of the park."""
    path = tmp_path_factory.mktemp("log") / "park.txt"
    path.write_text("".join(PARK.read_text().splitlines(keepends=True)[:150]))
    return path


@pytest.fixture(scope="module")
def made(short, tmp_path_factory):
    """What one run with everything printed and wrote."""
    folder = tmp_path_factory.mktemp("made")
    return json_of("slam", short, "--film", "--out", folder), folder


def test_a_run_writes_all_that_is_known(made, short):
    row, folder = made
    result = slam.run(load("auto", short))
    assert json.loads((folder / "run.json").read_text()) == row
    assert row["version"] == saccade.__version__
    assert row["settings"]["errors"] == "invariant"
    assert list(row["odometry_bias"].values()) == result.odometry_bias.tolist()
    files = row["files"]
    assert {*map(Path, files.values()), folder / "run.json"} == {*folder.iterdir()}
    trajectory = file_interface.read_tum_trajectory_file(files["trajectory"])
    assert trajectory.num_poses == row["poses"] == len(result.trajectory)
    landmarks, poses, seen = (
        pandas.read_csv(files[each], converters=EXACT)
        for each in ("landmarks", "poses", "innovations")
    )
    assert len(landmarks) == row["landmarks"] == len(result.map)
    assert {"id", "x", "y", "cov_xx", "cov_xy", "cov_yy"} <= set(landmarks)
    same = np.testing.assert_array_equal
    same(poses.x, result.trajectory.pose[:, 0])
    same(poses.cov_x_heading, result.trajectory.covariance[:, 0, 2])
    same(seen.nis, result.consistency.nis)
    v = seen[["innovation_1", "innovation_2"]].to_numpy()
    a, b, d = (seen[f"cov_{name}"] for name in ("1_1", "1_2", "2_2"))
    square = (d * v[:, 0] ** 2 - 2 * b * v[:, 0] * v[:, 1] + a * v[:, 1] ** 2) / (a * d - b * b)
    np.testing.assert_allclose(square, result.consistency.nis, rtol=1e-6)


def test_how_far_odometry_ends_from_what(rng):
    """From the truth where it is in the frame of the log, else from what the filter believes."""
    log, poses, _ = simulate(rng, steps=40)
    result = slam.run(log)
    ends = result.dead_reckoning.pose[-1, :2]
    off_truth = np.hypot(*(ends - poses[-1, :2]))
    off_estimate = np.hypot(*(ends - result.trajectory.pose[-1, :2]))
    places = np.column_stack([poses[:, :2] + 100, np.full(len(poses), np.nan)])  # as GPS has
    for truth, expected in (
        (Trajectory(log.time, poses), {"odometry_end_error_m": off_truth}),
        (Trajectory(log.time, places), {"odometry_end_from_estimate_m": off_estimate}),
        (None, {"odometry_end_from_estimate_m": off_estimate}),
    ):
        found = summarize_run(replace(log, truth=truth), result)
        ending = {name: each for name, each in found.items() if name.startswith("odometry_end")}
        assert ending == pytest.approx(expected)


def test_smoothing_is_written_beside_the_filter(run, short):
    kept = {}
    for option in ((), ("--no-smooth",)):
        code, out, _ = run("slam", short, *option, "--json")
        row = json.loads(out)
        assert code == 0
        kept[row["estimate"]] = {
            name: np.loadtxt(row["files"][name])[:, 1:3]
            for name in ("trajectory", "filtered")
            if name in row["files"]
        }
    assert np.abs(kept["smoothed"]["filtered"] - kept["smoothed"]["trajectory"]).max() > 0.001
    np.testing.assert_array_equal(kept["filtered"]["trajectory"], kept["smoothed"]["filtered"])
    assert "filtered" not in kept["filtered"]


def test_a_log_of_one_pose_has_a_map_and_a_film(run, tmp_path):
    """Nothing is driven and nothing is seen, and all of it is written."""
    (tmp_path / "one.csv").write_text(
        "time,forward,left,turn,cov_forward_forward,cov_left_left,cov_turn_turn,"
        "range,bearing,cov_range_range,cov_bearing_bearing\n0,,,,,,,,,,\n"
    )
    code, out, err = run("slam", "one.csv", "--film", "--json")
    assert code == 0
    assert "warning: Nothing is mapped: there are no observations" in err
    row = json.loads(out)
    assert (row["poses"], row["landmarks"], row["nis_mean"]) == (1, 0, None)
    assert all(Path(file).stat().st_size > 0 for file in row["files"].values())
