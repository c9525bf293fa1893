"""Landmarks whose names are text, from the table of a log to the map file and back."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from saccade import slam
from saccade.datasets import load, save
from saccade.errors import LogError
from saccade.landmark_names import number_names
from saccade.simulation.world import WorldConfig, simulate_world

TEXTS = np.array([f"tag36h11:{7 * i % 20}" for i in range(18)] + ["Tür, links", "4"], object)
"""A name for each landmark of the world; the last one is a number."""


@pytest.fixture(scope="module")
def numbered():
    return simulate_world(WorldConfig(steps=400, landmarks=20), seed=3)


@pytest.fixture(scope="module")
def named(numbered, tmp_path_factory):
    """The same log with text for names, as its table says, and the truth in another order."""
    path = tmp_path_factory.mktemp("named") / "log.csv"
    save(path, replace(numbered, landmark=TEXTS[numbered.landmark]))
    truth = numbered.landmark_truth
    ids, texts = number_names(TEXTS[::-1])
    truth = replace(truth, id=ids, text_names=texts, xy=truth.xy[::-1])
    return replace(load("csv", path), landmark_truth=truth)


@pytest.fixture(scope="module")
def results(numbered, named):
    return slam.run(numbered), slam.run(named)


def test_names_that_are_text_change_no_number(numbered, results):
    of_numbers, of_texts = results
    assert of_texts.filtered.pose.tobytes() == of_numbers.filtered.pose.tobytes()
    np.testing.assert_allclose(of_texts.map.xy, of_numbers.map.xy, atol=1e-9)
    assert of_texts.map.names.tolist() == TEXTS[of_numbers.map.id].tolist()
    assert of_numbers.map.names is of_numbers.map.id


def test_steps_maps_and_sessions_know_names(named, results, tmp_path):
    robot, z, R = slam.slam_for(named), named.observation, named.observation_covariance
    for i, time in enumerate(named.time):
        u, U = (named.control[i - 1], named.control_covariance[i - 1]) if i else (None, None)
        scan = named.observation_pose == i
        robot.step(time, u, U, z[scan], R[scan], named.names[scan].tolist())
    assert robot.pose.tobytes() == results[1].filtered.pose[-1].tobytes()
    robot.save(tmp_path / "map.npz")
    again = slam.Slam.load(tmp_path / "map.npz", "localize", start=named.start)
    assert again.map.label.tolist() == robot.map.label.tolist()
    other = replace(named, landmark=named.names[::-1], text_names=())  # numbered in another order
    assert other.text_names != named.text_names
    at_home = replace(other, landmark=named.names, text_names=other.text_names)
    result = slam.run(at_home, initial=again)
    assert (result.association >= 0).mean() > 0.9
    assert not result.rejected.any()
    assert set(result.map.names) == set(results[1].map.names)


def test_maps_are_merged_by_text(named):
    halves = []
    for part in (named.observation_pose < 250, named.observation_pose > 150):
        log = replace(
            named,
            observation_pose=named.observation_pose[part],
            observation=named.observation[part],
            observation_covariance=named.observation_covariance[part],
            landmark=named.names[part],
            text_names=(),
        )
        halves.append(slam.slam_for(log))
        slam.run(log, initial=halves[-1])
    merged = slam.merge_maps(*halves)
    names = [each.map.label for each in halves]
    assert merged.probability == 1.0
    for i, j in merged.common.tolist():
        assert names[0][i] == names[1][j]
    found = merged.slam.map.label.tolist()
    assert sorted(found) == sorted(set(names[0]) | set(names[1]))


def test_the_command_writes_the_names(named, tmp_path, run):
    save(tmp_path / "log.csv", named)
    code, _, message = run("slam", tmp_path / "log.csv", "--out", tmp_path / "out")
    assert code == 0, message
    for file, column in (("landmarks.csv", "id"), ("innovations.csv", "landmark")):
        with (tmp_path / "out" / file).open(encoding="utf-8", newline="") as table:
            written = {row[column] for row in csv.DictReader(table)}
        assert written - {""} == set(named.names), file
    assert "tag36h11:7" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "number"),
    [
        (7, 7),
        ("7", 7),
        ("3.0", 3),
        ("3.", 3),
        ("-1.0", -1),
        ("0.0", 0),
        (" 12 ", 12),
        (7.0, 7),
        (-1, -1),
        ("-1", -1),
        ("", -1),
        (None, -1),
    ]
    + [
        ("door", 10**18),
        ("007", 10**18),
        ("12e5", 10**18),
        ("36_11", 10**18),
        ("-7a", 10**18),
        (str(2**62), 10**18),
    ]
    + [(each, None) for each in (-2, 1.5, "1.5", "-7", "nan", np.nan, 2**63, "a\nb", [3])],
)
def test_what_a_name_is(name, number):
    if number is not None:
        numbers, texts = number_names([name])
        assert numbers.tolist() == [number]
        assert texts == (() if number < 10**18 else (name,))
        return
    with pytest.raises(LogError, match="names: expected names of landmarks"):
        number_names([name, 3])
