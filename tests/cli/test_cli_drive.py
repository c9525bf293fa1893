"""`saccade drive` as a person runs it: options over the configuration, and what it writes."""

import csv
import json
from pathlib import Path

import numpy as np


def test_options_override_the_configuration(run, tmp_path):
    assert run("simulate", "drive", "--frames", 8, "--out", "ring")[0] == 0
    (tmp_path / "mine.toml").write_text("max_landmarks = 50\nselection = 'strength'\n")
    words = ("drive", "ring", "--no-film", "--json", "--config", "mine.toml")
    code, out, _ = run(*words, "--max-landmarks", 5, "--selection", "random")
    assert code == 0
    row = json.loads(out)
    assert row["settings"]["max_landmarks"] == 5
    assert row["settings"]["selection"] == "random"
    assert 0 < row["landmarks"] <= 5
    assert "film" not in row["files"]
    with Path(row["files"]["observations"]).open(newline="") as file:
        observations = list(csv.DictReader(file))
    assert len(observations) == row["observations"]
    assert len({each["landmark"] for each in observations}) == row["landmarks_observed"]
    trajectory = np.loadtxt(row["files"]["trajectory"])
    truth = np.loadtxt("ring/groundtruth.tum")[:8]
    end = np.hypot(*(trajectory[-1, 1:3] - truth[-1, 1:3]))
    np.testing.assert_allclose(row["end_m"], end, atol=1e-3)
    code, _, err = run(*words, "--selection", "luck")
    assert code == 2
    assert "selection: expected 'strength' or" in err


def test_a_fovea_sees_a_quarter_of_the_pixels_of_a_recording(run):
    assert run("simulate", "drive", "--frames", 8, "--out", "ring")[0] == 0
    words = ("drive", "ring", "--no-film", "--json")
    row, rows = json.loads(run(*words)[1]), {}
    for policy in ("fixed", "salient"):
        code, out, _ = run(*words, "--fovea", policy)
        assert code == 0
        rows[policy] = json.loads(out)
        assert rows[policy]["ate_m"] < 0.05
        assert not Path("saccade-drive", "checkpoint.npz").exists()
    assert rows["fixed"]["observations"] != row["observations"]
    code, _, err = run(*words, "--fovea", "luck")
    assert code == 2
    assert "fovea: expected one of fixed, random" in err
    code, _, err = run(*words, "--fovea", "fixed", "--camera", "0")
    assert code == 2
    assert "--fovea: expected none with --camera" in err


def test_foveas_are_compared_with_the_whole_images(run):
    assert run("simulate", "drive", "--frames", 10, "--out", "lane")[0] == 0
    words = ("evaluate", "gaze", "--fovea", "--seeds", 1, "--frames", 8, "--out", "study")
    chosen = [word for each in ("whole", "window", "sweep") for word in ("--policy", each)]
    code, out, _ = run(*words, "--world", "lane", *chosen, "--json")
    assert code == 0
    (whole, window, sweep) = (each for each in json.loads(out)["comparisons"]["whole"])
    assert whole["frames_per_second_ratio"] == whole["ate_m_ratio"][0] == 1
    assert window["frames_per_second_ratio"] != sweep["frames_per_second_ratio"]
    code, out, _ = run(*words, "--world", "lane", *chosen, "--report", "study.html")
    assert code == 0
    assert "speed" in out
    assert "whole" in Path("study.html").read_text(encoding="utf-8")
    code, _, err = run(*words, "--world", "rooms")
    assert code == 2
    assert "world: expected ring or the folder of a recorded drive, found 'rooms'" in err
