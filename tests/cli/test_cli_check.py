import json

import cv2
import numpy as np
import pytest

from saccade.datasets import save, save_drive
from saccade.simulation import WorldConfig, simulate_world
from support.logs import mounted


@pytest.fixture
def sequence(filmed, tmp_path):
    save_drive(tmp_path / "wall", filmed)
    return tmp_path / "wall"


def test_a_clean_drive_ends_with_0_and_one_with_findings_with_1(run, sequence):
    code, out, err = run("check", sequence)
    assert (code, err) == (0, "")
    assert out.split()[:7] == ["wall:", "40", "frames,", "40", "inspected,", "no", "problems"]
    for i in (3, 4):
        cv2.imwrite(str(sequence / "image_0" / f"{i:06d}.png"), np.zeros((120, 160), np.uint8))
    code, out, _ = run("check", sequence, "--kind", "kitti")
    assert code == 1
    assert "1 problem" in out
    assert "2 frames are black or uniformly gray (frames 3, 4)" in " ".join(out.split())


def test_programs_get_every_number(run, sequence):
    (sequence / "image_0" / "000007.png").unlink()
    code, out, _ = run("check", sequence, "--json")
    report = json.loads(out)
    assert code == 1
    assert not report["clean"]
    assert report["frames"] == 39
    by_check = {finding["check"]: finding for finding in report["findings"]}
    assert "1 image is missing, first number 7" in by_check["files"]["what"]
    assert by_check["no odometry"]["severity"] == "note"
    assert report["figures"]["points_per_frame"] > 50


@pytest.fixture
def log(tmp_path):
    world = WorldConfig(
        course_length=30.0, curvature_amplitude=1.5, steps=200, step_length=0.5,
        range_limits=(0.5, 8.0),
    )  # fmt: skip
    save(tmp_path / "log.csv", mounted(simulate_world(world, 1), (0.0, 0.3, 0.0)))
    return tmp_path / "log.csv"


def test_a_log_is_checked_with_and_without_the_pose_of_its_sensor(run, log):
    code, out, _ = run("check", log)
    assert code == 1
    assert "error: sensor mounting" in out
    for path in (log, log.parent):
        code, out, err = run("check", path, "--sensor", "0,0.3,0", "--json")
        assert (code, err) == (0, "")
        assert json.loads(out)["findings"] == []
    code, _, err = run("check", log, "--sensor", "left")
    assert code == 2
    assert "--sensor: expected X,Y,YAW, found 'left'" in err
