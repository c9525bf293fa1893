"""Every row of the table of association rules, measured in a run and not read from the row."""

import json
from dataclasses import replace

import numpy as np
import pytest

from saccade import slam
from saccade.errors import ConfigError, LogError
from saccade.slam.association.rules import RULES, nearest_first
from saccade.slam.map_file import read_map
from saccade.types import LandmarkMap
from support.paths import ROOT

POINTS = np.array([[4.0, 0.0], [5.0, 2.0], [6.0, -2.0]])
Z, R = slam.observe(np.zeros(3), POINTS)[0], np.diag([0.05, 0.01]) ** 2
each_rule = pytest.mark.parametrize("name", RULES)


def in_map(association):
    """A robot at the origin of a given map with the labels 0, 1 and 2."""
    known = LandmarkMap(np.arange(3), POINTS)
    config = slam.EkfConfig(association=association, start_sigma=(0.01, 0.01, 0.005))
    return slam.Slam(config, map=known, start=np.zeros(3))


@each_rule
def test_a_rule_pairs_observations_by_its_own_function(name, monkeypatch):
    row, calls = RULES[name], []

    def pairing(distance):
        calls.append(distance.shape)
        return row.pairing(distance)

    monkeypatch.setitem(RULES, name, replace(row, pairing=pairing))
    found = in_map(name).step(0.0, z=Z, R=R).association
    assert calls == [] if row.accepts_all else calls == [(3, 3)]
    assert found.tolist() == ([-1] * 3 if row.accepts_all else [0, 1, 2])


@each_rule
def test_a_rule_uses_labels_as_its_row_says(name):
    row = RULES[name]
    step = in_map(name).step(0.0, z=Z[:1], R=R, labels=[1])  # a wrong label
    by_label = 1 if row.accepts_all else -1
    assert step.association.tolist() == [by_label if row.uses_labels else 0]
    assert step.rejected.tolist() == [row.uses_labels and not row.accepts_all]


@each_rule
def test_a_rule_branches_as_its_row_says(name):
    robot = slam.Slam(slam.EkfConfig(association=name))
    robot.step(0.0, z=Z, R=R)
    assert robot.hypotheses.branching == RULES[name].may_branch


def test_an_own_function_is_a_rule_and_is_checked(tmp_path):
    own = in_map(lambda distance: nearest_first(distance))
    assert own.step(0.0, z=Z, R=R).association.tolist() == [0, 1, 2]
    for wrong in (np.zeros(3, int), np.zeros(2, int), np.arange(3) + 1, np.arange(3.0)):
        with pytest.raises(LogError, match=r"expected .3,. different columns below 3, or -1"):
            in_map(lambda distance, wrong=wrong: wrong).step(0.0, z=Z, R=R)


def test_an_own_function_is_given_again_with_its_map(tmp_path):
    config = slam.EkfConfig(association=nearest_first, confirm_after=1)
    robot = slam.Slam(config)
    robot.step(0.0, z=Z, R=R)
    robot.save(tmp_path / "map.npz")
    with pytest.raises(ConfigError, match=r"association: expected auto, .*, found 'own nearest_f"):
        slam.Slam.load(tmp_path / "map.npz")
    assert len(slam.Slam.load(tmp_path / "map.npz", config=config).filter) == 3
    assert read_map(tmp_path / "map.npz").settings["confirm_after"] == 1


@pytest.mark.parametrize("name", ["Mutual", "", None, 3, "jcbb"])
def test_a_name_that_is_not_in_the_table_is_refused(name):
    with pytest.raises(ConfigError, match=f"association: expected {', '.join(RULES)}, or a func"):
        slam.EkfConfig(association=name)


def test_help_and_page_have_every_rule(run):
    shown = run("slam", "--help")[1].replace("│", "")
    shown = " ".join(shown.split())
    page = (ROOT / "docs" / "slam.md").read_text(encoding="utf-8")
    for name in RULES:
        assert f" {name}, " in shown
        assert f"| `{name}` |" in page


def test_an_own_function_is_named_on_the_command_line_and_in_settings(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_pairs.py").write_text(
        "from saccade.slam.association.rules import nearest_first\n\n"
        "def pairs(distance):\n    return nearest_first(distance)\n"
    )
    (tmp_path / "own.toml").write_text('association = "own_pairs:pairs"\n')
    assert run("simulate", "world", "--config", _short_world(tmp_path), "--out", "w")[0] == 0
    log, found = "w/log.csv", []
    for words in (["--association", "own_pairs:pairs"], ["--config", "own.toml"]):
        code, out, _ = run("slam", log, *words, "--out", "out", "--json")
        assert code == 0
        row = json.loads(out)
        assert row["settings"]["association"] == "own_pairs:pairs"
        found.append(row["observations_used"])
    named = json.loads(run("slam", log, "--association", "nearest", "--out", "out", "--json")[1])
    assert found == [named["observations_used"]] * 2


def _short_world(folder):
    (folder / "world.toml").write_text("steps = 60\n")
    return folder / "world.toml"
