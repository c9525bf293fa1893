"""The commands as a person runs them: what they print, write and return."""

import csv
import json
import sys
import tomllib
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pytest
from evo.tools import file_interface

from saccade.cli import main

DATA = Path(str(files("saccade") / "data"))
ROCKET = DATA / "rocket.jpg"
HALLWAY = (DATA / "hallway_1.jpg", DATA / "hallway_2.jpg")
COMMANDS = ("look", "detect", "match", "slam", "demo", "config")


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run `saccade` in an empty folder; gives the exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["saccade", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return call


def looks_like_a_picture(path):
    picture = cv2.imread(str(path))
    return picture is not None and min(picture.shape[:2]) > 200 and picture.std() > 10


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_an_example(run, command):
    code, out, _ = run(command, "--help")
    assert code == 0
    assert f"Example: saccade {command}" in out


def test_the_list_of_commands_is_complete(run):
    code, out, _ = run("--help")
    assert code == 0
    assert all(command in out for command in COMMANDS)


def test_version(run):
    assert run("--version")[:2] == (0, "saccade 0.1.0\n")


def test_look(run, tmp_path):
    code, out, _ = run("look", ROCKET, "--fixations", 4, "--out", "looked", "--json")
    assert code == 0
    (row,) = json.loads(out)["images"]
    assert looks_like_a_picture(row["picture"])
    x, y, time, saliency = np.array(row["scanpath"]).T
    assert len(x) == 4
    assert ((x >= 0) & (x < row["width"]) & (y >= 0) & (y < row["height"])).all()
    assert (np.diff(time) > 0).all()
    with np.load(tmp_path / "looked" / "rocket.look.npz") as arrays:
        assert saliency[0] == pytest.approx(arrays["saliency"].max())
        assert arrays["intensity"].shape == arrays["color"].shape == arrays["saliency"].shape
        np.testing.assert_allclose(arrays["scanpath_xy"], np.stack([x, y], axis=1))


def test_look_prints_a_table_for_people(run):
    code, out, _ = run("look", ROCKET, "--fixations", 3)
    assert code == 0
    assert "saccade-look/rocket.look.png" in out.replace("\n", "")
    assert out.count("\n") < 15


def test_detect(run, tmp_path):
    code, out, _ = run("detect", *HALLWAY, "--max", 50, "--json")
    assert code == 0
    rows = json.loads(out)["images"]
    assert [row["points"] for row in rows] == [50, 50]
    assert all(looks_like_a_picture(row["picture"]) for row in rows)
    with np.load(tmp_path / rows[0]["arrays"], allow_pickle=False) as arrays:
        assert arrays["xy"].shape == (50, 2)
        assert arrays["descriptors"].shape == (50, 128)


def test_match_agrees_with_the_epipolar_geometry(run):
    code, out, _ = run("match", *HALLWAY, "--json")
    assert code == 0
    row = json.loads(out)
    assert looks_like_a_picture(row["picture"])
    with Path(row["table"]).open() as table:
        places = np.array([[float(p[k]) for k in ("x1", "y1", "x2", "y2")]
                           for p in csv.DictReader(table)])  # fmt: skip
    assert len(places) == row["matches"] > 30
    _, inlier = cv2.findFundamentalMat(places[:, :2], places[:, 2:], cv2.USAC_MAGSAC, 1.5, 0.999)
    assert inlier.mean() > 0.6


def test_slam(run, tmp_path):
    code, out, _ = run("slam", DATA / "victoria_park.txt", "--json")
    assert code == 0
    row = json.loads(out)
    assert row["landmarks"] == 151
    assert looks_like_a_picture(row["files"]["picture"])
    trajectory = file_interface.read_tum_trajectory_file(row["files"]["trajectory"])
    assert trajectory.num_poses == row["poses"] == 6969
    assert json.loads((tmp_path / "saccade-slam" / "run.json").read_text()) == row
    with Path(row["files"]["landmarks"]).open() as table:
        landmarks = list(csv.DictReader(table))
    assert len(landmarks) == 151
    assert {"id", "x", "y", "cov_xx", "cov_xy", "cov_yy"} <= set(landmarks[0])


def test_demo_makes_a_page_whose_every_link_exists(run, tmp_path):
    code, out, err = run("demo")
    assert code == 0
    page = (tmp_path / "saccade-demo" / "index.html").read_text()
    links = [part.split('"')[0] for mark in ('src="', 'href="') for part in page.split(mark)[1:]]
    assert len(links) >= 8
    assert all((tmp_path / "saccade-demo" / link).is_file() for link in links)
    assert "saccade-demo/index.html" in out.replace("\n", "")
    assert "try: saccade look" in err


@pytest.mark.parametrize("kind", ["contrast", "scanpath", "sift", "slam"])
def test_config_prints_every_preset_as_toml(run, kind):
    code, out, _ = run("config", kind)
    assert code == 0
    assert "default" in tomllib.loads(out)


def test_a_printed_configuration_can_be_handed_back(run, tmp_path):
    _, out, _ = run("config", "sift", "--preset", "kootstra2010")
    (tmp_path / "mine.toml").write_text(out)
    named = run("detect", ROCKET, "--preset", "kootstra2010", "--json")
    filed = run("detect", ROCKET, "--config", "mine.toml", "--json")
    assert named[0] == 0
    assert filed == named


BAD_SETTINGS = {
    "unknown.toml": ("nonsense = 1", "no setting 'nonsense'"),
    "typed.toml": ('max_keypoints = "many"', "max_keypoints"),
    "broken.toml": ("= 3", "expected TOML"),
}


@pytest.mark.parametrize("name", BAD_SETTINGS)
def test_bad_settings_are_named(run, tmp_path, name):
    text, words = BAD_SETTINGS[name]
    (tmp_path / name).write_text(text)
    code, _, err = run("detect", ROCKET, "--config", name)
    assert code == 2
    assert name in err
    assert words in err
    assert err.count("\n") == 1


LOG = "ODOMETRY 0 1 1 0 0 0.01 0 0 0.01 0 0.01\nLANDMARK 1 2 3 0 0.1 0 0.1\n"
BAD_INPUT = {
    "missing": (["look", "missing.png"], None, ["missing.png", "No such file"]),
    "not an image": (["look", "text.png"], b"hello", ["text.png", "expected an image"]),
    "empty file": (["detect", "empty.png"], b"", ["empty.png", "empty"]),
    "bad preset": (["look", ROCKET, "--preset", "best"], None, ["kootstra2010", "'best'"]),
    "bad kind": (["config", "soup"], None, ["contrast", "'soup'"]),
    "missing log": (["slam", "missing.txt"], None, ["missing.txt"]),
    "empty log": (["slam", "empty.txt"], b"", ["empty.txt"]),
    "broken line": (["slam", "broken.txt"], f"{LOG}LANDMARK 1 x\n".encode(), ["line 3"]),
    "cut line": (["slam", "cut.txt"], f"{LOG}ODOMETRY 1 2 1 0".encode(), ["line 3"]),
    "not finite": (["slam", "nan.txt"], LOG.replace("3 0", "nan 0").encode(), ["line 2"]),
    "bad format": (["slam", DATA / "victoria_park.txt", "--format", "x"], None, ["mrclam"]),
    "bad association": (
        ["slam", DATA / "victoria_park.txt", "--association", "x"],
        None,
        ["association", "'x'"],
    ),
    "unwritable": (["look", ROCKET, "--out", ROCKET / "sub"], None, ["rocket.jpg"]),
}


@pytest.mark.parametrize("what", BAD_INPUT)
def test_bad_input_gets_one_clear_line(run, tmp_path, what):
    words, content, expected = BAD_INPUT[what]
    if content is not None:
        (tmp_path / words[1]).write_bytes(content)
    code, out, err = run(*words)
    assert code == (1 if what == "unwritable" else 2)
    assert out == ""
    assert err.startswith("saccade: ")
    assert err.count("\n") == 1
    assert all(word in err for word in expected), err


def test_an_image_that_is_too_small_is_named(run, tmp_path):
    cv2.imwrite(str(tmp_path / "dot.png"), np.zeros((2, 2), np.uint8))
    code, _, err = run("look", "dot.png")
    assert code == 2
    assert "dot.png" in err
    assert err.count("\n") == 1


def test_one_bad_image_does_not_stop_the_others(run, tmp_path):
    (tmp_path / "bad.png").write_bytes(b"?")
    code, _, err = run("detect", "bad.png", HALLWAY[0], "--max", 5)
    assert code == 2
    assert "bad.png" in err
    assert "1 of 2 images left out" in err
    assert (tmp_path / "saccade-detect" / "hallway_1.keypoints.npz").is_file()


def test_images_of_one_name_do_not_overwrite_each_other(run, tmp_path):
    (tmp_path / "other").mkdir()
    twin = tmp_path / "other" / "hallway_1.jpg"
    twin.write_bytes(HALLWAY[1].read_bytes())
    code, out, _ = run("detect", HALLWAY[0], twin, "--max", 5, "--json")
    assert code == 0
    assert len({row["arrays"] for row in json.loads(out)["images"]}) == 2
