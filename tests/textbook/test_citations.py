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
    "A": {
        "intensity": [1],
        "red_green": [2],
        "blue_yellow": [3],
        "low_pass": [4],
        "every_second_sample": [5],
        "oriented_pyramid": [6],
        "across_scale_difference": [7, 8, 9, 10],
        "contrast_saliency": [11, 12, 13, 14],
    },
    "B": {
        "differences": [1],
        "smooth": [2],
        "gaussian_kernel": [3],
        "taylor": [4],
        "refine": [5],
        "value_at": [6],
        "gradient_and_hessian": [8, 9],
        "curvature_ratio": [7, 10],
        "gradient_at": [11, 12],
    },
    "C": {
        "f": [1],
        "h": [2],
        "predict": [5, 6, 7],
        "grad_f_x": [8],
        "grad_f_u": [9],
        "update": [10, 11, 12, 13],
        "grad_h": [14],
        "g": [15],
        "augment": [16, 17],
        "grad_g_x": [18],
        "grad_g_z": [18],
    },
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


def test_citations_are_read_as_people_write_them():
    text = "(A.7-A.10), B.7, B.8; Eq. C.1 and C.5-7; v1.2, USA.3, B.1\u2013B.2. Not 3.A.4 or A.x"
    expected = [("A", n) for n in (7, 8, 9, 10)] + [("B", 7), ("B", 8)]
    expected += [("C", n) for n in (1, 5, 6, 7)] + [("B", 1), ("B", 2)]
    assert list(cited(text)) == expected


@pytest.mark.parametrize("appendix", "ABC")
def test_each_file_cites_all_of_its_appendix_and_nothing_else(appendix):
    found = set(cited((TEXTBOOK / FILES[appendix]).read_text(encoding="utf-8")))
    assert found == {(appendix, number) for number in range(1, LAST[appendix] + 1)}


def test_results_in_a_file_of_their_own_cite_the_same_appendix():
    for path in TEXTBOOK.glob("*_result.py"):
        found = set(cited(path.read_text(encoding="utf-8")))
        assert {appendix for appendix, _ in found} == {"B"}


@pytest.mark.parametrize("appendix", "ABC")
def test_each_equation_stands_in_its_function(appendix):
    text = (TEXTBOOK / FILES[appendix]).read_text(encoding="utf-8")
    functions = {
        node.name: "\n".join(text.splitlines()[node.lineno - 1 : node.end_lineno])
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef)
    }
    for name, numbers in PLACES[appendix].items():
        missing = {(appendix, number) for number in numbers} - set(cited(functions[name]))
        assert not missing, f"{name} does not cite {missing}"


def test_the_page_of_equations_has_all_of_them():
    found = set(cited((DOCS / "equations.md").read_text(encoding="utf-8")))
    assert found == {(key, number) for key, last in LAST.items() for number in range(1, last + 1)}


@pytest.mark.parametrize(
    ("symbol", "number"),
    [
        ("| $R, G, B$ |", "A.1-A.3"),
        ("| $G_\\theta$, $\\theta$ |", "A.6"),
        ("| $G$, $L$ |", "B.3, B.2"),
        ("| $D$ |", "B.1"),
        ("| $\\hat{x}$ |", "B.5"),
        ("| $\\tau_c$ |", "B.6"),
        ("| $\\tau_r$ |", "B.10"),
        ("| $P$ |", "C.4"),
        ("| $U$ |", "C.7"),
        ("| $F_x, F_u$ |", "C.8, C.9"),
        ("| $R$ |", "C.12"),
        ("| $v = z - h$ |", "C.10"),
        ("| $S$ | covariance", "C.12"),
        ("| $W$ | Kalman gain", "C.13"),
        ("| $g$, $G_x, G_z$ |", "C.15, C.18"),
    ],
)
def test_symbols_stand_beside_the_equations_that_bring_them(symbol, number):
    lines = (DOCS / "equations.md").read_text(encoding="utf-8").splitlines()
    (row,) = [line for line in lines if line.startswith(symbol)]
    assert row.rsplit("|", 2)[1].strip() == number


def test_nothing_is_cited_that_is_not_in_print():
    files = [*SOURCE.rglob("*.py"), *DOCS.rglob("*.md")]
    assert len(files) > 100
    for path in files:
        for appendix, number in cited(path.read_text(encoding="utf-8")):
            assert 1 <= number <= LAST[appendix], f"{path.name} cites {appendix}.{number}"
