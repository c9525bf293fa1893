"""What the README says can be done."""

import re
from importlib.resources import files

import pytest

import saccade
from saccade.pictures import result_figure
from support.documentation import anchors_of, code_of
from support.nightly import nightly
from support.paths import ROOT

NUMBER = r"(?<![\w.])\d*\.?\d+(?![\w.]\d)"
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("lines", "trees"), [(1000, 39), *nightly((None, 122))])
def test_the_examples_run(tmp_path, monkeypatch, lines, trees):
    """With the beginning of the log, in which 6 of 45 trees are seen once, or with all of it."""
    data = files("saccade") / "data"
    copies = {
        "photo.jpg": "rocket.jpg",
        "left.jpg": "hallway_1.jpg",
        "right.jpg": "hallway_2.jpg",
        "victoria_park.txt": "victoria_park.txt",
    }
    for name, source in copies.items():
        content = (data / source).read_bytes()
        if name == "victoria_park.txt":
            content = b"".join(content.splitlines(keepends=True)[:lines])
        (tmp_path / name).write_bytes(content)
    monkeypatch.chdir(tmp_path)
    shown = []
    monkeypatch.setattr(saccade, "show", lambda *items: shown.append(result_figure(*items)))
    names = {}
    blocks = code_of(README)
    for block in blocks:
        assert len([line for line in block.splitlines() if line]) <= 10
        exec(block, names)
    assert len(blocks) == 4
    assert len(shown) == 2
    assert len(names["path"]) == 10
    assert names["heat"].shape == names["image"].shape[:2]
    assert len(names["same"]) > 50
    assert len(names["trees"]) == trees  # of all 151 28 were seen once, one was mostly rejected
    assert names["look"].pan != 0


def test_every_link_of_the_readme_leads_somewhere():
    links = re.findall(r"\]\(([^)]+)\)", README)
    assert links
    for link in links:
        place, _, anchor = link.partition("#")
        assert (ROOT / place).exists(), link
        assert not anchor or anchor in anchors_of(ROOT / place), link


def test_every_figure_says_how_it_was_measured():
    pages = (ROOT / "docs" / name for name in ("measured.md", "gaze.md"))
    measured = {each for page in pages for each in re.findall(NUMBER, page.read_text("utf-8"))}
    bullets = "".join(line for line in README.splitlines() if line.startswith(("- ", "  ")))
    table = "".join(line for line in README.splitlines() if line.startswith("| "))
    assert set(re.findall(NUMBER, bullets)) >= {".857", "4.8", "3.36"}
    figures = set(re.findall(NUMBER, bullets + table))
    assert len(figures) > 20
    assert figures <= measured
