"""Every example runs, says what it found, and leaves its picture."""

import re
import runpy

import cv2
import pytest

from support.paths import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def numbers(text):
    return [float(each) for each in re.findall(r"\d+(?:\.\d+)?", text)]


def matching(said):
    matches, right = numbers(said.splitlines()[-1])[:2]
    return right > 0.8 * matches > 80


def landmark_slam(said):
    standard, invariant, odometry = (numbers(line) for line in said.splitlines()[-3:])
    return standard[1] > 6 > invariant[1] > 2 and odometry[0] > 2 * invariant[0]


def drive(said):
    by_camera, odometry, again = (numbers(line)[0] for line in said.splitlines()[-3:])
    return by_camera < 0.2 < 1 < odometry and again > 50


def tensors(said):
    rows = [numbers(line) for line in said.splitlines()]
    return all(abs(true - b) < 0.1 and abs(a - b) < 2e-3 for true, a, b in rows) and len(rows) == 3


FOUND = {
    "drive": drive,
    "gaze": lambda said: numbers(said.splitlines()[-1])[0] < 0.2 and " decisions" in said,
    "landmark_slam": landmark_slam,
    "matching": matching,
    "regions": lambda said: "Regions(12 regions)" in said,
    "saliency": lambda said: said.count(" ms  at (") == 8,
    "scanpath": lambda said: all(numbers(line)[0] > 0.95 for line in said.splitlines()),
    "symmetry": lambda said: said.count("pyramid levels") == 4,
    "tensors": tensors,
}
"""What each must say."""
MARKS = {"drive": ["nightly"], "gaze": ["nightly"], "tensors": ["torch"]}
"""When an example is not run with the others."""


def test_there_is_a_check_of_every_example():
    assert [example.stem for example in EXAMPLES] == sorted(FOUND)


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(
            path,
            id=path.stem,
            marks=[getattr(pytest.mark, name) for name in MARKS.get(path.stem, [])],
        )
        for path in EXAMPLES
    ],
)
def test_the_example_runs(example, tmp_path, monkeypatch, capsys):
    if example.stem == "tensors":
        pytest.importorskip("torch", reason="needs the group `torch`")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(example), run_name="__main__")
    said = capsys.readouterr().out
    assert FOUND[example.stem](said), said
    assert cv2.imread(f"{example.stem}.png").std() > 10
