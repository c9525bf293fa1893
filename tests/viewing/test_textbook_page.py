"""The page of `saccade textbook`: equations, the code that computes them, and figures."""

import json
import re
from importlib.resources import files

import cv2
import numpy as np
import pytest

import saccade
from saccade import textbook
from saccade.viewing.textbook.ekf import trace_filter
from saccade.viewing.textbook.walkthrough import (
    load_steps,
)
from support.accessibility import assert_accessible
from support.commands import json_of

DATA = files("saccade") / "data"
PRINTED = (("A", 14), ("B", 12), ("C", 18))
NUMBERS = [f"{appendix}.{n}" for appendix, last in PRINTED for n in range(1, last + 1)]
ROW = re.compile(
    r'<p class="number">(.*?)</p>.*?<div class="code"><pre><code>(.*?)</code>',
    re.DOTALL,
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The photo, the JSON and the page."""
    folder = tmp_path_factory.mktemp("made")
    photo = folder / "photo.png"
    cv2.imwrite(str(photo), cv2.imread(str(DATA / "chelsea.jpg"))[60:180, 100:260])
    row = json_of("textbook", photo, "--out", folder / "out")
    return photo, row, (folder / "out" / "report.html").read_text(encoding="utf-8")


def test_the_results_are_those_of_the_textbook(made):
    photo, row, page = made
    saliency = textbook.contrast_saliency(saccade.read_image(photo)).saliency
    shown = row["results"]["A"]["conspicuity"]["mean of the saliency"]
    assert shown == f"{saliency.mean():.3f}"
    assert shown in page


def test_the_page_holds_every_equation_with_its_code_and_every_picture(made, browser):
    page = made[2]
    shown = [number for number, _ in ROW.findall(page)]
    assert [number for number in shown if "." in number] == NUMBERS
    assert page.count("<math") == len(shown)
    assert page.count('src="data:image/webp;base64,') == sum(
        "alt" in step for each in "ABC" for step in load_steps(each)
    )
    assert not re.search(r'(src|href)="(?!data:)|<script| style="', page)
    assert len(page) < 5e6
    shown = browser.new_page()
    shown.set_content(re.sub(r"data:image[^\"]*", "data:,", page))  # what is checked is text
    assert_accessible(shown)
    shown.close()


def test_a_log_is_walked_through_by_appendix_c(run, tmp_path):
    code, out, _ = run("textbook", DATA / "victoria_park.txt", "--json")
    assert code == 0
    assert json.loads(out)["results"].keys() == {"C"}
    page = (tmp_path / "saccade-textbook" / "report.html").read_text(encoding="utf-8")
    assert {number[0] for number, _ in ROW.findall(page)} == {"C"}


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
