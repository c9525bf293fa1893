"""What the README says can be done."""

import re
from importlib.resources import files

from support.documentation import anchors_of
from support.paths import ROOT

NUMBER = r"(?<![\w.])\d*\.?\d+(?![\w.]\d)"
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_five_lines_of_python_run(tmp_path, monkeypatch):
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    data = files("saccade") / "data"
    (tmp_path / "photo.jpg").write_bytes((data / "rocket.jpg").read_bytes())
    (tmp_path / "victoria_park.txt").write_bytes((data / "victoria_park.txt").read_bytes())
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(code, names)
    assert len(names["path"]) == 10
    assert len(names["keypoints"]) > 50
    assert len(names["run"].map) >= 151


def test_every_link_of_the_readme_leads_somewhere():
    links = re.findall(r"\]\(([^)]+)\)", README)
    assert links
    for link in links:
        place, _, anchor = link.partition("#")
        assert (ROOT / place).exists(), link
        assert not anchor or anchor in anchors_of(ROOT / place), link


def test_the_readme_fits_a_screen():
    assert len(README.splitlines()) <= 60


def test_every_figure_of_the_table_says_how_it_was_measured():
    measured = set(re.findall(NUMBER, (ROOT / "docs" / "measured.md").read_text(encoding="utf-8")))
    table = "".join(line for line in README.splitlines() if line.startswith("| "))
    figures = set(re.findall(NUMBER, table))
    assert len(figures) > 25
    assert figures <= measured
