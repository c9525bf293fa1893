"""The page of `saccade textbook`: equations, the code that computes them, and figures."""

import json
import re
import runpy
import sys
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pytest

import saccade
from saccade import textbook
from saccade.errors import LogError
from saccade.textbook.pop_out import pop_out_display, target_rank
from saccade.viewing.textbook import walkthrough
from saccade.viewing.textbook.ekf import simulated_log, trace_filter
from saccade.viewing.textbook.walkthrough import Walkthrough, load_steps
from support.accessibility import assert_accessible
from support.commands import json_of

DATA = files("saccade") / "data"
PRINTED = (("A", 14), ("B", 12), ("C", 18))
NUMBERS = [f"{appendix}.{n}" for appendix, last in PRINTED for n in range(1, last + 1)]
ROW = re.compile(
    r'<p class="number">(.*?)</p>.*?<div class="code"><pre[^>]*><code>(.*?)</code>',
    re.DOTALL,
)


def save_small(figure, file):
    """Draws a figure once, small and as it is laid out at first, in a third of the time."""
    figure.set_layout_engine("none")
    figure.savefig(file, format="webp", dpi=30)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The photo, the JSON and the page, with small pictures."""
    folder = tmp_path_factory.mktemp("made")
    photo = folder / "photo.png"
    cv2.imwrite(str(photo), cv2.imread(str(DATA / "chelsea.jpg"))[80:160, 130:230])
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(walkthrough, "save_webp", save_small)
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
    assert not re.search(r'(src|href)="(?!data:|#)| style="', page)
    assert len(page) < 5e6
    shown = browser.new_page()
    shown.set_content(re.sub(r"data:image[^\"]*", "data:,", page))  # what is checked is text
    assert_accessible(shown)
    shown.close()


@pytest.mark.nightly
def test_every_picture_has_room_for_its_panels(made, tmp_path):
    """Layouts that collapse are warned of, which is an error here."""
    json_of("textbook", made[0], "--out", tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count('src="data:image/webp;base64,') == made[2].count("data:image/webp;base64,")


def test_a_log_is_walked_through_by_appendix_c(run, tmp_path):
    code, out, _ = run("textbook", DATA / "victoria_park.txt", "--json")
    assert code == 0
    assert json.loads(out)["results"].keys() == {"C"}
    page = (tmp_path / "saccade-textbook" / "report.html").read_text(encoding="utf-8")
    assert {number[0] for number, _ in ROW.findall(page)} == {"C"}


def test_a_control_that_drives_before_it_turns_is_applied_exactly():
    """Two of appendix C's lead to the pose of dead reckoning."""
    log = saccade.datasets.load("auto", DATA / "victoria_park.txt")
    ekf = trace_filter(log, textbook.EkfSlam, 1).scans[0][1]
    steps = int(log.observation_pose[0])
    x, y, theta = log.start
    for forward, left, turn in log.control[:steps]:
        x += forward * np.cos(theta) - left * np.sin(theta)
        y += forward * np.sin(theta) + left * np.cos(theta)
        theta += turn
    np.testing.assert_allclose(ekf.s[:3], [x, y, theta], atol=1e-12)


def test_the_matrices_of_a_step_are_chosen_and_follow_their_definitions(made, browser):
    """W is P H' / S, so that for each step H W = 1 - R / S; Q has the covariance of the control."""
    page = browser.new_page()
    page.set_content(re.sub(r"data:image[^\"]*", "data:,", made[2]))
    chooser = page.locator(".chooser[data-kind=update]")
    assert chooser.locator(".values:visible").count() == 1
    R = np.diag([0.15, 0.05]) ** 2
    for number in range(chooser.locator("option").count()):
        chooser.locator("select").select_option(str(number))
        shown = chooser.locator(".values:visible")
        assert shown.get_attribute("data-step") == str(number)
        S, W, H = (numbers(shown.locator("table").nth(i)) for i in (1, 2, 3))
        np.testing.assert_allclose(H @ W, np.eye(2) - R @ np.linalg.inv(S), atol=0.01)
        assert len(shown.locator("table").nth(2).locator("tbody th").all()) == len(W)
    page.close()


def numbers(table):
    """The numbers of a table."""
    rows = table.locator("tbody tr").all()
    return np.array([[float(t) for t in row.locator("td").all_inner_texts()] for row in rows])


def test_the_steps_of_any_scan_are_shown():
    log = saccade.datasets.load("auto", DATA / "victoria_park.txt")
    trace = trace_filter(log, textbook.EkfSlam, 40)
    assert [title.partition(":")[0] for title, _ in trace.scans] == [
        f"scan {number}" for number in range(33, 41)
    ]
    assert {step.scan for step in trace.steps["update"]} <= set(range(33, 41))
    with pytest.raises(LogError, match="small world: expected a scan from 1 to 7, found 8"):
        trace_filter(simulated_log(), textbook.EkfSlam, 8)


def test_a_parameter_is_changed_as_in_a_copy_of_the_textbook(made, tmp_path):
    photo, row, _ = made
    copied = tmp_path / "copied.py"
    text = Path(sys.modules["saccade.textbook.sift"].__file__).read_text(encoding="utf-8")
    copied.write_text(text.replace("TAU_C = 0.02", "TAU_C = 0.05"), encoding="utf-8")
    by_hand = runpy.run_path(str(copied))["sift"](saccade.read_image(photo))
    image, changes = saccade.read_image(photo), ["sift.tau_c=0.05"]
    _, results = Walkthrough(simulated_log(), image, changes=changes).run("B")
    kept = sum(each.status == "kept" for each in by_hand.candidates)
    assert results["candidates"]["kept"] == str(kept)
    assert results["candidates"]["kept"] != row["results"]["B"]["candidates"]["kept"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("contrast.gamma=1", "set: expected NAME=VALUE with one of contrast.center, contrast."),
        ("contrast.delta=9", "set: contrast.delta: expected a value such as (3, 4), from 1 to 4"),
        ("contrast.delta=", "found ''"),
        ("contrast.delta=2.5", "found '2.5'"),
        ("sift.s=3,4", "set: sift.s: expected a value such as 3, from 1 to 8, found '3,4'"),
        ("sift.tau_c=nan", "found 'nan'"),
    ],
)
def test_invalid_parameters_are_refused(made, run, change, words):
    code, _, said = run("textbook", made[0], "--set", change)
    assert code == 2
    assert words in said


def test_a_red_bar_pops_out_by_the_default():
    for image, *bars in map(pop_out_display, range(5)):
        assert target_rank(saccade.contrast_saliency(image).saliency, *bars) == 1


@pytest.mark.nightly
def test_a_red_bar_does_not_pop_out_by_the_equations_as_printed():
    for image, *bars in map(pop_out_display, range(2)):
        assert target_rank(textbook.contrast_saliency(image).saliency, *bars) > 1
