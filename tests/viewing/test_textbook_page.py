"""The page of `saccade textbook`: equations, the code that computes them, and figures."""

import json
import re
import sys
from contextlib import redirect_stderr, redirect_stdout
from html import unescape
from importlib.resources import files
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
import pytest

import saccade
from saccade import textbook
from saccade.cli import main
from saccade.viewing.textbook.ekf import trace_filter
from saccade.viewing.textbook.walkthrough import (
    load_steps,
)
from support.accessibility import assert_accessible

DATA = files("saccade") / "data"
PRINTED = (("A", 14), ("B", 12), ("C", 18))
NUMBERS = [f"{appendix}.{n}" for appendix, last in PRINTED for n in range(1, last + 1)]
LINE = 'S = (M["intensity"].map + M["color"].map + M["orientation"].map) / 3'
CHANGED = 'S = (M["intensity"].map + 2 * M["color"].map + M["orientation"].map) / 4'
ROW = re.compile(
    r'<p class="number">(.*?)</p>.*?<div class="code"><pre( class="changed")?><code>(.*?)</code>',
    re.DOTALL,
)


@pytest.fixture(scope="module")
def changed(tmp_path_factory):
    """Of a copy of appendix A with A.14 changed: the photo, the JSON, the messages, the page."""
    folder = tmp_path_factory.mktemp("changed")
    photo, own = folder / "photo.png", folder / "my_contrast.py"
    cv2.imwrite(str(photo), cv2.imread(str(DATA / "chelsea.jpg"))[60:180, 100:260])
    source = Path(textbook.__path__[0], "contrast_saliency.py").read_text(encoding="utf-8")
    assert source.count(LINE) == 1
    own.write_text(source.replace(LINE, CHANGED), encoding="utf-8")
    words = ["textbook", photo, "--module", own, "--json", "--out", folder / "out"]
    out, err = StringIO(), StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["saccade", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
    assert not ended.value.code, err.getvalue()
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    return photo, json.loads(out.getvalue()), err.getvalue(), page


def test_the_page_shows_a_changed_equation_and_what_it_changes(changed):
    photo, result, messages, page = changed
    assert result["implementations"]["contrast_saliency"].endswith("my_contrast.py")
    assert (
        result["implementations"]["sift"]
        == result["implementations"]["EkfSlam"]
        == "saccade.textbook"
    )
    assert "contrast_saliency is that of" in messages
    assert f"-    {LINE}  # A.14\n+    {CHANGED}  # A.14" in unescape(page)
    marked = {number: unescape(code) for number, mark, code in ROW.findall(page) if mark}
    assert marked.keys() == {"A.14"}
    assert marked["A.14"].endswith(CHANGED)
    usual = textbook.contrast_saliency(saccade.read_image(photo))
    maps = {name: each.map for name, each in usual.conspicuity.items()}
    saliency = (maps["intensity"] + 2 * maps["color"] + maps["orientation"]) / 4
    shown = result["results"]["A"]["conspicuity"]["mean of the saliency"]
    assert shown == f"{saliency.mean():.3f} (textbook: {usual.saliency.mean():.3f})"
    assert shown in page
    assert "(textbook:" not in str(result["results"]["A"]["normalization"])  # before the change


def test_the_page_holds_every_equation_with_its_code_and_every_picture(changed, browser):
    page = changed[3]
    shown = [number for number, _, _ in ROW.findall(page)]
    assert [number for number in shown if "." in number] == NUMBERS
    assert "No line cites it" not in page
    assert page.count("<math") == len(shown)
    assert page.count('src="data:image/webp;base64,') == sum(
        len(load_steps(each)) for each in "ABC"
    )
    assert not re.search(r'(src|href)="(?!data:)|<script| style="', page)
    assert len(page) < 5e6
    shown = browser.new_page()
    shown.set_content(re.sub(r"data:image[^\"]*", "data:,", page))  # what is checked is text
    assert_accessible(shown)
    shown.close()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def contrast_saliency(image:\n", "line 1: SyntaxError"),
        ("import nonsense\n", "line 1: ModuleNotFoundError"),
        ("x = 1\n", "expected a definition of contrast_saliency or sift or EkfSlam, found none"),
        ("def contrast_saliency(image):\n    return 1 / 0\n", "line 2: ZeroDivisionError"),
        ("def contrast_saliency(image):\n    return image\n", "its result cannot be shown"),
        ("from saccade.textbook import sift\n", "expected a definition"),
        (None, "cannot be read"),
    ],
)
def test_a_mistake_in_the_file_is_one_line(run, tmp_path, text, said):
    photo = str(DATA / "chelsea.jpg")
    if text is not None:
        (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    code, out, err = run("textbook", photo, "--max-side", 64, "--module", "mine.py")
    (*_, last) = err.splitlines()
    assert (code, out) == (2, "")
    assert last.startswith("saccade: mine.py")
    assert said in last
    assert "Traceback" not in err


def test_a_log_is_walked_through_by_appendix_c(run, tmp_path):
    code, out, _ = run("textbook", DATA / "victoria_park.txt", "--json")
    assert code == 0
    assert json.loads(out)["implementations"] == {"EkfSlam": "saccade.textbook"}
    page = (tmp_path / "saccade-textbook" / "report.html").read_text(encoding="utf-8")
    assert {number[0] for number, _, _ in ROW.findall(page)} == {"C"}
    (tmp_path / "mine.py").write_text("def sift(image): ...\n", encoding="utf-8")
    code, _, err = run("textbook", DATA / "victoria_park.txt", "--module", "mine.py")
    assert code == 2
    assert "sift needs an image" in err


def test_a_control_that_drives_before_it_turns_is_applied_exactly():
    """Two of appendix C's lead to the pose of dead reckoning."""
    log = saccade.datasets.load("auto", DATA / "victoria_park.txt")
    ekf = trace_filter(log, textbook.EkfSlam).scans[0][1]
    steps = int(log.observation_pose[0])
    x, y, theta = log.start
    for forward, left, turn in log.control[:steps]:
        x += forward * np.cos(theta) - left * np.sin(theta)
        y += forward * np.sin(theta) + left * np.cos(theta)
        theta += turn
    np.testing.assert_allclose(ekf.s[:3], [x, y, theta], atol=1e-12)
