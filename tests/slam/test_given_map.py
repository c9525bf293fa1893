"""Localization and mapping in a map that is given: surveyed, or of another program."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest

from saccade import slam
from saccade.datasets import load_map, save, write_landmarks
from saccade.errors import ConfigError, LogError, LogWarning
from saccade.evaluation.trajectory import position_rmse
from saccade.landmark_names import TagSpelling, parse_name
from saccade.simulation import WorldConfig, simulate_world
from saccade.types import LandmarkMap
from support.logs import between, without_names

WORLD = WorldConfig(
    course_length=60, landmarks=40, landmark_spread=6, steps=240, range_limits=(0.5, 8.0)
)


@pytest.fixture(scope="module")
def log():
    """A robot whose course begins elsewhere than at the origin of the survey."""
    log = simulate_world(WORLD, 5)
    late = between(log, 60, 240)
    return replace(late, start=np.zeros(3))


@pytest.fixture
def survey(tmp_path, log):
    """Positions of a land surveyor to the centimeter, with the labels of the log."""
    rows = [f"{i},{x},{y}" for i, (x, y) in enumerate(log.landmark_truth.xy)]
    (tmp_path / "survey.csv").write_text("\n".join(["id,x,y", *rows]))
    return tmp_path / "survey.csv"


def error(result, log):
    return position_rmse(result.trajectory, log.truth, aligned=False)


@pytest.mark.parametrize("mode", ["localize", "continue"])
@pytest.mark.parametrize("named", [True, False])
def test_a_robot_is_found_in_a_surveyed_map(survey, log, mode, named):
    """Within the accuracy of a single scan of 5 % and 3 degrees; the map hardly moves."""
    with pytest.warns(LogWarning, match="40 landmarks without covariance: assumed a standard dev"):
        landmarks = load_map(survey)
    robot = slam.Slam(map=landmarks, mode=mode)
    result = slam.run(log if named else without_names(log), initial=robot)
    assert error(result, log) < 0.15
    given = robot.filter.landmarks[:40] - log.landmark_truth.xy
    assert np.abs(given).max() < 0.05
    assert len(robot.map) == 40
    assert (robot.map.label[:5].tolist() == [0, 1, 2, 3, 4]) is True


PRECISE = replace(WORLD, range_percent=1.0, bearing_sigma_deg=1.0)


@pytest.mark.parametrize("named", [True, False])
def test_ranges_that_are_7_percent_long_are_learned_and_used(named):
    """Long ranges are common to all landmarks: no label is wrong, and no loop is closed by them."""
    log = simulate_world(PRECISE, 5)
    log = replace(log, observation=log.observation * [1.07, 1.0], range_errors=(0.0, 0.0))
    xy = log.landmark_truth.xy
    surveyed = LandmarkMap(np.arange(len(xy)), xy, covariance=np.tile(1e-4 * np.eye(2), (40, 1, 1)))
    robot = slam.Slam(map=surveyed, mode="localize", start=log.start)
    result = slam.run(log if named else without_names(log), initial=robot)
    assert error(result, log) < 0.03
    assert robot.filter.range_errors[0] == pytest.approx(0.07, abs=0.003)
    assert not result.rejected.any()
    assert (result.association >= 0).mean() > 0.9


@pytest.mark.parametrize("seed", [2, 3])
def test_ranges_that_are_7_percent_long_find_an_unknown_start_without_labels(seed):
    """The uncertainty of their errors widens the points of the search."""
    log = simulate_world(replace(WORLD, landmarks=60, steps=40), seed)
    log = replace(log, observation=log.observation * [1.07, 1.0], range_errors=(0.0, 0.0))
    xy = log.landmark_truth.xy
    surveyed = LandmarkMap(np.arange(60), xy, covariance=np.tile(1e-4 * np.eye(2), (60, 1, 1)))
    robot = slam.Slam(map=surveyed, mode="localize")
    for scan in slam.scans.scans_of(without_names(log), robot.config):
        step = robot.process(scan)
    assert not step.lost
    assert np.hypot(*(step.pose - log.truth.pose[-1])[:2]) < 0.2


def test_live_a_robot_is_lost_until_scans_have_found_it(survey, log):
    with pytest.warns(LogWarning):
        robot = slam.Slam(map=load_map(survey), mode="localize")
    lost = [robot.process(scan).lost for scan in slam.scans.scans_of(log, robot.config)]
    assert lost[0]
    assert not any(lost[20:])
    np.testing.assert_allclose(robot.pose[:2], log.truth.at(log.time[-1:])[0, :2], atol=0.3)


def test_a_given_start_is_taken(survey, log):
    with pytest.warns(LogWarning):
        landmarks = load_map(survey)
    start = log.truth.at(log.time[:1])[0]
    robot = slam.Slam(map=landmarks, mode="localize", start=start)
    assert not robot.kidnapping.lost
    np.testing.assert_allclose(robot.pose_covariance, np.diag([0.25, 0.25, 0.01]))
    assert error(slam.run(log, initial=robot), log) < 0.15


def test_the_map_of_a_run_is_read_back(tmp_path):
    """`landmarks.csv` has labels and covariances."""
    first = simulate_world(WORLD, 1)
    result = slam.run(first)
    write_landmarks(tmp_path / "landmarks.csv", result.map)
    landmarks = load_map(tmp_path / "landmarks.csv")
    np.testing.assert_array_equal(landmarks.names, result.map.names)
    np.testing.assert_allclose(landmarks.covariance, result.map.covariance)
    second = simulate_world(WORLD, 2)
    localized = slam.run(second, initial=slam.Slam(map=landmarks, mode="localize"))
    assert error(localized, second) < 0.5


def test_a_second_session_elsewhere_searches_its_start(tmp_path):
    """Switched off at the end, carried, and switched on: the first scans contradict the end."""
    log = simulate_world(WORLD, 3)
    robot = slam.slam_for(log)
    slam.run(between(log, 0, 200), initial=robot)
    robot.save(tmp_path / "map.npz")
    for first, remark in ((100, "the first scans contradict the last pose"), (200, "")):
        part = between(log, first, first + 40)
        again = slam.run(part, initial=slam.Slam.load(tmp_path / "map.npz", "localize"))
        assert again.remark.startswith(remark)
        assert (remark == "") == ("contradict" not in again.remark)
        assert error(again, log) < 0.6


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,z\n1,2\n", r"line 1: expected the columns label, x, y, .*, found no y"),
        ("id,x,y\n3,1,2\n3,2,2\n", r"line 3: expected a unique label .*, found 3 again"),
        ("id,x,y\n2.5,1,2\n", r"line 2: expected a label"),
        ("id,x,y\n", "expected landmarks, found none"),
        ("id,x,y,cov_xx,cov_xy,cov_yy\na,1,2,1,2,1\n", r"line 2: expected a positive definite"),
    ],
)
def test_a_broken_map_is_refused(tmp_path, text, message):
    (tmp_path / "map.csv").write_text(text)
    with pytest.raises(LogError, match=message):
        load_map(tmp_path / "map.csv")


def test_the_command_takes_a_survey(run, tmp_path, survey, log):
    save(tmp_path / "log.csv", log)
    words = ["slam", tmp_path / "log.csv", "--map", survey, "--out", tmp_path / "out"]
    with warnings.catch_warnings():
        warnings.simplefilter("always", LogWarning)
        code, _, err = run(*words)
    assert code == 0
    assert "40 landmarks without covariance" in err
    summary = json.loads((tmp_path / "out" / "run.json").read_text())
    assert summary["map_landmarks"] == 40
    assert summary["filtered_position_unaligned_rmse_m"] < 0.15
    code, _, err = run(*words, "--start", "last")
    assert code == 2
    assert "--start: expected search, log or X,Y,HEADING with a survey" in err


def test_a_map_without_landmarks_is_refused(log):
    with pytest.raises(ConfigError, match="map: expected landmarks, found 'none'"):
        slam.Slam(map=replace(log.landmark_truth, id=np.empty(0, int), xy=np.empty((0, 2))))


@pytest.mark.filterwarnings("ignore::saccade.LogWarning")
def test_surveys_of_other_programs_are_maps(tmp_path):
    tag = '{"ID": 4, "pose": {"translation": {"x": 1.5, "y": 2, "z": 1}, "rotation": {}}}'
    (tmp_path / "field.json").write_text('{"field": {"length": 16}, "tags": [' + tag + "]}")
    (tmp_path / "world.dat").write_text("4 1.5 2\n")
    (tmp_path / "c.csv").write_text(
        "label,x,y,z,c00,c01,c02,c11,c12,c22\n4,1.5,2,1,1,0.1,0,2,0,3\n"
    )
    for name in ("field.json", "world.dat", "c.csv"):
        landmarks = load_map(tmp_path / name)
        assert landmarks.id.tolist() == [4]
        np.testing.assert_array_equal(landmarks.xy, [[1.5, 2.0]])
    np.testing.assert_array_equal(landmarks.covariance, [[[1, 0.1], [0.1, 2]]])
    (tmp_path / "field.json").write_text('{"tags": [{"ID": 4}]}')
    with pytest.raises(LogError, match=r"field.json: expected a field layout with tags"):
        load_map(tmp_path / "field.json")


@pytest.mark.parametrize("name", ["5", "05", "tag36h11:5"])
@pytest.mark.parametrize("live", [5, "05", "tag36h11:5"])
def test_a_tag_has_several_spellings(name, live):
    spelling = TagSpelling([parse_name(name), "exit"])
    assert spelling.resolve([live, None, "exit", 6]) == [parse_name(name), None, "exit", 6]
    two = TagSpelling(["tag36h11:5", "tag25h9:5"])
    assert two.resolve([5]) == [5]
