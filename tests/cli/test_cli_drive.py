"""`saccade drive` as a person runs it: its settings, and what it writes."""

import json
from pathlib import Path

import numpy as np


def test_a_drive_is_mapped_by_the_settings_of_a_file(run, tmp_path):
    assert run("simulate", "drive", "--frames", 8, "--out", "ring")[0] == 0
    (tmp_path / "mine.toml").write_text("max_landmarks = 5\nselection = 'random'\n")
    words = ("drive", "ring", "--json", "--config", "mine.toml")
    code, out, _ = run(*words)
    assert code == 0
    row = json.loads(out)
    assert row["settings"]["max_landmarks"] == 5
    assert row["settings"]["selection"] == "random"
    assert 0 < row["landmarks"] <= 5
    assert "film" not in row["files"]
    trajectory = np.loadtxt(row["files"]["trajectory"])
    truth = np.loadtxt("ring/groundtruth.tum")[:8]
    end = np.hypot(*(trajectory[-1, 1:3] - truth[-1, 1:3]))
    np.testing.assert_allclose(row["end_m"], end, atol=1e-3)
    assert row["poses_compared"] == 8
    truth = Path("ring/groundtruth.tum").read_text().splitlines()
    Path("ring/groundtruth.tum").write_text("\n".join(truth[:3]))
    code, out, err = run(*(word for word in words if word != "--json"))
    assert code == 0
    assert out.count("3 of 8") == 4  # of each trajectory
    assert "warning: truth for only 3 of 8 poses" in err
