"""The equations are cited by the numbers that they have in print, each in its own file."""

import re
from pathlib import Path

import pytest

import saccade

SOURCE = Path(saccade.__file__).parent
TEXTBOOK = SOURCE / "textbook"
DOCS = Path(__file__).resolve().parents[2] / "docs"
LAST = {"A": 14, "B": 12, "C": 18}
"""The last equation of each appendix."""
FILES = {"A": "contrast_saliency.py", "B": "sift.py", "C": "ekf_slam.py"}
CITATION = re.compile(r"(?<![\w.])([ABC])\.(\d+)(?:\s*[-\u2013]\s*(?:([ABC])\.)?(\d+)(?![\w.]))?")


def cited(text):
    """Every (appendix, number) that a text cites, with those between the ends of a range."""
    for match in CITATION.finditer(text):
        appendix, first, other, last = match.groups()
        assert other in (None, appendix), f"{match[0]} runs from one appendix into another"
        ends = int(first), int(last or first)
        assert ends[0] <= ends[1], f"{match[0]} runs backwards"
        yield from ((appendix, number) for number in range(ends[0], ends[1] + 1))


@pytest.mark.parametrize("appendix", "ABC")
def test_each_file_cites_all_of_its_appendix(appendix):
    text = (TEXTBOOK / FILES[appendix]).read_text(encoding="utf-8")
    assert set(cited(text)) == {(appendix, number) for number in range(1, LAST[appendix] + 1)}


def test_the_page_of_equations_has_all_of_them():
    found = set(cited((DOCS / "equations.md").read_text(encoding="utf-8")))
    assert found == {(key, number) for key, last in LAST.items() for number in range(1, last + 1)}


def test_nothing_is_cited_that_is_not_in_print():
    for path in (*SOURCE.rglob("*.py"), *DOCS.rglob("*.md")):
        for appendix, number in cited(path.read_text(encoding="utf-8")):
            assert 1 <= number <= LAST[appendix], f"{path.name} cites {appendix}.{number}"
