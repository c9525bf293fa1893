import json

import cv2
import numpy as np
import pytest

from saccade.datasets import save_drive


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
    code, out, _ = run("check", sequence, "--format", "kitti")
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
