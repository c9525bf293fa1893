"""Every format that we write is read back, by us and where it can by GTSAM."""

import dataclasses

import gtsam
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade.datasets import load, save
from saccade.datasets.logs.pose_graph import write_g2o
from saccade.errors import LogError, LogWarning
from saccade.slam import turn_then_translate
from saccade.types import LandmarkLog, Trajectory


def _spread(rng, n, d, scale):
    root = rng.normal(size=(n, d, d)) * 0.3 + np.eye(d)
    C = scale**2 * root @ root.transpose(0, 2, 1)
    return (C + C.transpose(0, 2, 1)) / 2


def a_log(seed=1, motion="compose", steps=12, seen=30):
    """Any log at all: what is in it need not come from a world."""
    rng = np.random.default_rng(seed)
    size = 3 if motion == "compose" else 2
    return LandmarkLog(
        name="any",
        start=np.array([4.0, -2.0, 0.7]),
        time=np.cumsum(rng.uniform(0.1, 1.0, steps + 1)),
        motion=motion,
        control=rng.normal(size=(steps, size)),
        control_covariance=_spread(rng, steps, size, 0.1),
        observation_pose=np.sort(rng.integers(0, steps + 1, seen)),
        observation=np.stack([rng.uniform(1, 20, seen), rng.uniform(-np.pi, np.pi, seen)], 1),
        observation_covariance=_spread(rng, seen, 2, 0.05),
        landmark=rng.integers(0, 9, seen),
    )


def _fields(log):
    return {f.name: getattr(log, f.name) for f in dataclasses.fields(log) if f.name != "name"}


logs = st.builds(
    a_log,
    st.integers(0, 2**32),
    st.sampled_from(["compose", "turn_then_translate"]),
    st.integers(0, 9),
    st.integers(0, 20),
)


@given(logs, st.booleans())
@settings(max_examples=15)
def test_csv_keeps_every_digit(tmp_path_factory, log, named):
    if not named:
        log = dataclasses.replace(log, landmark=np.full(len(log.landmark), -1))
    path = tmp_path_factory.mktemp("csv") / "any.csv"
    save(path, log)
    again = load("auto", path)
    for name, value in _fields(log).items():
        np.testing.assert_array_equal(getattr(again, name), value, err_msg=name)


def test_csv_has_the_true_trajectory(tmp_path):
    """At the poses, and as the start where the file gives no other; by hand from other programs."""
    path = tmp_path / "log.csv"
    time = np.arange(0, 20, 0.5)
    truth = Trajectory(time, np.stack([time, 0 * time, 0.5 + 0 * time], 1))  # 1 m/s
    log = dataclasses.replace(a_log(), truth=truth)
    save(path, log)
    again = load("csv", path)
    np.testing.assert_allclose(again.truth.time, log.time)
    np.testing.assert_allclose(again.truth.pose[:, 0], log.time)
    np.testing.assert_allclose(again.truth.pose[:, 2], 0.5)
    np.testing.assert_array_equal(again.start, log.start)
    text = "time,forward,left,turn,range,bearing,true_x,true_y\n0,,,,,,3,4\n1,1,0,0,,,,\n"
    path.write_text(text + "2,1,0,0,,,5,4\n")
    with pytest.warns(LogWarning):
        again = load("csv", path)
    np.testing.assert_array_equal(again.truth.pose, [[3, 4, np.nan], [5, 4, np.nan]])
    np.testing.assert_array_equal(again.start, np.zeros(3))  # no heading
    path.write_text(
        text.replace("true_y", "true_y,true_heading").replace("3,4", "3,4,0.5")[:-1] + ",\n"
    )
    with pytest.warns(LogWarning):
        np.testing.assert_array_equal(load("csv", path).start, [3, 4, 0.5])


def test_half_an_observation_is_an_empty_cell_or_nan(tmp_path):
    path = tmp_path / "log.csv"
    log = a_log()
    log.observation[3, 0] = log.observation[5, 1] = np.nan
    save(path, log)
    assert ",nan" not in path.read_text()
    again = load("csv", path)
    np.testing.assert_array_equal(again.observation, log.observation)
    assert again.observation_covariance[3, 1, 1] == log.observation_covariance[3, 1, 1]
    assert np.isfinite(again.observation_covariance).all()
    header = "time,forward,left,turn,range,bearing,cov_range_range,cov_bearing_bearing\n0,,,,,,,\n"
    path.write_text(header + "0,,,,2.5,nan,0.01,nan\n0,,,,NaN,0.5,,0.01\n1,1,0,0,,,,\n")
    with pytest.warns(LogWarning, match="forward, .* without covariance"):
        again = load("csv", path)
    np.testing.assert_array_equal(again.observation, [[2.5, np.nan], [np.nan, 0.5]])
    path.write_text(header + "0,,,,nan,nan,0.01,\n")
    with pytest.raises(LogError, match="line 3: expected forward, left, turn or range, bearing"):
        load("csv", path)
    path.write_text(header + "0,,,,1.0,nan,,0.01\n")
    with pytest.warns(LogWarning), pytest.raises(LogError, match="a finite number for cov_range_r"):
        load("csv", path)
    with pytest.raises(
        LogError, match="observation 3: expected range and bearing, which g2o needs"
    ):
        save(tmp_path / "log.g2o", log)
    both = log.observation.copy()
    both[3] = np.nan
    with pytest.raises(LogError, match="observation: expected finite numbers, found NaN"):
        dataclasses.replace(log, observation=both)


def _as_relative_poses(log):
    """The same log with relative poses, by the models' own Jacobians."""
    if log.motion == "compose":
        return log.control, log.control_covariance
    found = [turn_then_translate(np.zeros(3), u) for u in log.control]
    spread = [Fu @ U @ Fu.T for (_, _, Fu), U in zip(found, log.control_covariance, strict=True)]
    control = np.array([[*u[:2], c[1]] for (u, _, _), c in zip(found, log.control, strict=True)])
    return control.reshape(-1, 3), np.array(spread).reshape(-1, 3, 3)


@given(log=logs.filter(lambda log: len(log.control) > 0))
@settings(max_examples=10)
def test_g2o_is_read_back(tmp_path_factory, log):
    path = tmp_path_factory.mktemp("g2o") / "any.g2o"
    save(path, log)
    again = load("auto", path)
    control, spread = _as_relative_poses(log)
    np.testing.assert_array_equal(again.time, np.arange(len(log.time)))
    np.testing.assert_allclose(again.control, control, atol=1e-12)
    close = {"rtol": 1e-6, "atol": 1e-9 if log.motion == "compose" else 2e-8}
    np.testing.assert_allclose(again.control_covariance, spread, **close)
    np.testing.assert_array_equal(again.observation_pose, log.observation_pose)
    np.testing.assert_allclose(again.observation, log.observation, atol=1e-9)
    np.testing.assert_allclose(
        again.observation_covariance, log.observation_covariance, rtol=1e-6, atol=1e-9
    )
    np.testing.assert_array_equal(again.landmark, log.landmark + len(log.time))
    np.testing.assert_array_equal(again.start, log.start)


def test_gtsam_and_we_read_the_same_g2o(tmp_path):
    """A file by other hands: ids that leave gaps, edges out of order, a correlated matrix."""
    path = tmp_path / "hand.g2o"
    path.write_text(
        "VERTEX_SE2 10 1 2 0.5\nVERTEX_SE2 12 2 2 0.4\nVERTEX_SE2 15 3 2 0.1\n"
        "VERTEX_XY 11 4 4\n"
        "EDGE_SE2 12 15 1 0.2 -0.3 90 1 2 80 3 400\n"
        "EDGE_SE2 10 12 1 0 0.1 100 1 2 50 3 400\n"
        "BR 12 11 0.3 2.5 0.01 0.1\n"
        "EDGE_SE2_XY 10 11 1.5 0.5 20 1 30\n"
        "FIX 10\n"
    )
    log = load("auto", path)
    assert log.time.tolist() == [10, 12, 15]
    assert log.start.tolist() == [1, 2, 0.5]
    assert log.observation_pose.tolist() == [0, 1]
    assert log.landmark.tolist() == [11, 11]
    np.testing.assert_allclose(
        log.observation, [[np.hypot(1.5, 0.5), np.arctan2(1, 3)], [2.5, 0.3]]
    )
    np.testing.assert_allclose(log.observation_covariance[1], np.diag([0.01, 0.0001]))
    graph, _ = gtsam.load2D(str(path), maxIndex=100, noiseFormat=gtsam.NoiseFormat.NoiseFormatG2O)
    later, earlier = graph.at(0), graph.at(1)
    for factor, u, U in zip((earlier, later), log.control, log.control_covariance, strict=True):
        pose = factor.measured()
        np.testing.assert_allclose([pose.x(), pose.y(), pose.theta()], u)
        np.testing.assert_allclose(factor.noiseModel().covariance(), U)


def test_a_format_without_nameless_landmarks_says_so(tmp_path):
    log = a_log()
    log = dataclasses.replace(log, landmark=np.where(log.landmark == 3, -1, log.landmark))
    with pytest.raises(LogError, match="needs a number as the label of every observation"):
        write_g2o(tmp_path / "any", log)
    assert not (tmp_path / "any").exists()


def test_a_csv_without_covariances_has_those_of_a_bag(tmp_path):
    """After 2 m and a turn by 1 rad: 0.05 m after a metre, 0.05 rad after a metre and a radian."""
    path = tmp_path / "bare.csv"
    path.write_text("time,distance,turn,landmark,range,bearing\n0,,,,,\n1,-2,1,,,\n1,,,7,4,1\n")
    with pytest.warns(LogWarning) as said:
        log = load("auto", path)
    np.testing.assert_allclose(log.control_covariance, [np.diag([0.005, 0.0075])])
    np.testing.assert_allclose(log.observation_covariance, [np.diag([0.04, 0.0004])])
    found = [str(each.message) for each in said]
    assert "distance, turn without covariance: assumed standard deviations of 0.05 m" in found[0]
    assert "range, bearing without covariance: assumed standard deviations of 5% of the" in found[1]


GRAPH = (
    "VERTEX_SE2 {x0} 1 2 .5\nVERTEX_SE2 {x1} 2 2 .5\nVERTEX_XY {l} 5 5\n"
    "EDGE_SE2 {x0} {x1} 1 0 0 100 0 0 100 0 80\n"
    "EDGE_SE2_XY {x0} {l} 3 4 50 5 40\nEDGE_SE2_XY {x1} {l} 2 4 50 5 40\n"
)
SYMBOLS = {name: (ord(name[0]) << 56) + int(name[1]) for name in ("x0", "x1", "l5")}
"""Keys of GTSAM: a letter in the highest byte, and an index."""


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", ""),
        ("", "FIX 0 1\n"),
        ("", "FIX 0\n"),
        ("PARAMS_SE2OFFSET 0 0 0 0\n", ""),
        ("PARAMS_CAMERAPARAMETERS 0 500 320 240 0\n", ""),
    ],
)
def test_lines_of_g2o_that_say_nothing_about_the_log(tmp_path, before, after):
    (tmp_path / "a.g2o").write_text(before + GRAPH.format(x0=0, x1=1, l=10) + after)
    log = load("auto", tmp_path / "a.g2o")
    np.testing.assert_allclose(log.observation[:, 0], [5, np.hypot(2, 4)])
    assert (log.start.tolist(), log.landmark.tolist()) == ([1, 2, 0.5], [10, 10])


def test_symbol_keys_are_names(tmp_path):
    """They fit int64; they are distances apart that float64 does not tell."""
    keys = {"x0": SYMBOLS["x0"], "x1": SYMBOLS["x1"], "l": SYMBOLS["l5"]}
    (tmp_path / "a.g2o").write_text(GRAPH.format(**keys))
    log = load("auto", tmp_path / "a.g2o")
    assert log.time.tolist() == [0, 1]
    assert log.observation_pose.tolist() == [0, 1]
    assert log.names.tolist() == [str(SYMBOLS["l5"])] * 2
    save(tmp_path / "a.csv", log)
    assert load("auto", tmp_path / "a.csv").names.tolist() == log.names.tolist()
    as_array = dataclasses.replace(log, landmark=np.full(2, SYMBOLS["l5"], np.int64), text_names=())
    assert as_array.names.tolist() == log.names.tolist()


@pytest.mark.parametrize(
    "tag", ["TUTORIAL_VERTEX_SE2 0 1 2 3", "FIX one", "FIX 9223372036854775808"]
)
def test_other_lines_of_g2o_are_named(tmp_path, tag):
    (tmp_path / "a.g2o").write_text(GRAPH.format(x0=0, x1=1, l=10) + tag)
    with pytest.raises(LogError, match=r"a.g2o, line 7: expected .*, found"):
        load("auto", tmp_path / "a.g2o")
