"""The equations are cited by the numbers that they have in print, each in its own file."""

import ast
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
PLACES = {
    "A": (
        "intensity A.1, red_green A.2, blue_yellow A.3, low_pass A.4, every_second_sample A.5, "
        "oriented_pyramid A.6, across_scale_difference A.7-10, contrast_saliency A.11-14"
    ),
    "B": (
        "differences B.1, smooth B.2, gaussian_kernel B.3, taylor B.4, refine B.5, value_at B.6, "
        "gradient_and_hessian B.8-9, curvature_ratio B.7, curvature_ratio B.10, gradient_at B.11-12"
    ),
    "C": (
        "f C.1, h C.2, predict C.5-7, grad_f_x C.8, grad_f_u C.9, update C.10-13, grad_h C.14, "
        "g C.15, augment C.16-17, grad_g_x C.18, grad_g_z C.18"
    ),
}
"""Which functions hold which equations, as the three appendices order them."""


def cited(text):
    """Every (appendix, number) that a text cites, with those between the ends of a range."""
    for match in CITATION.finditer(text):
        appendix, first, other, last = match.groups()
        assert other in (None, appendix), f"{match[0]} runs from one appendix into another"
        ends = int(first), int(last or first)
        assert ends[0] <= ends[1], f"{match[0]} runs backwards"
        yield from ((appendix, number) for number in range(ends[0], ends[1] + 1))


@pytest.mark.parametrize("appendix", "ABC")
def test_each_file_cites_all_of_its_appendix_each_equation_in_its_function(appendix):
    text = (TEXTBOOK / FILES[appendix]).read_text(encoding="utf-8")
    assert set(cited(text)) == {(appendix, number) for number in range(1, LAST[appendix] + 1)}
    functions = {
        node.name: "\n".join(text.splitlines()[node.lineno - 1 : node.end_lineno])
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef)
    }
    for place in PLACES[appendix].split(", "):
        name = place.split()[0]
        assert set(cited(place)) <= set(cited(functions[name])), place


def test_the_page_of_equations_has_all_of_them():
    found = set(cited((DOCS / "equations.md").read_text(encoding="utf-8")))
    assert found == {(key, number) for key, last in LAST.items() for number in range(1, last + 1)}


def test_nothing_is_cited_that_is_not_in_print():
    for path in (*SOURCE.rglob("*.py"), *DOCS.rglob("*.md")):
        for appendix, number in cited(path.read_text(encoding="utf-8")):
            assert 1 <= number <= LAST[appendix], f"{path.name} cites {appendix}.{number}"
