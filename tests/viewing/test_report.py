"""The report in a real browser: loading, layers, scrubbing, and accessibility."""

import numpy as np
import pytest
from scipy.stats import chi2

from saccade.types import Keypoints, MapSnapshot, Scanpath, Trajectory
from saccade.viewing.charts import innovation_charts, uncertainty_charts
from saccade.viewing.page import Section
from saccade.viewing.report import image_part, match_part, report_page
from saccade.viewing.report_map import ObservedLandmarks, map_part
from support.accessibility import assert_accessible
from support.limits import PAGE_TIMEOUT

LANDMARKS = np.array([[0.0, 0.0], [8.0, 4.0], [4.0, 4.0]])
STEPS = 12
DRAWN = "() => new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)))"
"""Waits until the requested frames have been drawn."""
TO = "\N{EN DASH}"


@pytest.fixture
def opened(browser, tmp_path):
    """Opens a page from disk; fails on console messages, page errors and dialogs."""
    problems, pages = [], []

    def open_page(text, **how):
        file = tmp_path / "report.html"
        file.write_text(text, encoding="utf-8")
        page = browser.new_page(**how)
        pages.append(page)
        page.set_default_timeout(1000 * PAGE_TIMEOUT)
        page.on("console", lambda message: problems.append(message.text))
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("dialog", lambda dialog: problems.append(dialog.message))
        page.on("request", lambda request: seen.append(request.url))
        seen = []
        page.goto(file.as_uri())
        page.wait_for_selector("html[data-ready]")
        others = [url for url in seen if url != file.as_uri() and not url.startswith("data:")]
        assert not others
        return page

    yield open_page
    for page in pages:
        page.close()
    assert not problems


def _drive():
    """A robot that passes three landmarks; one of them comes late, and one goes."""
    time = np.arange(STEPS, dtype=float)
    pose = np.stack([time * 0.7, np.ones(STEPS), np.zeros(STEPS)], 1)
    spread = np.tile(np.diag([0.01, 0.02, 0.001]), (STEPS, 1, 1))
    names = {
        step: [0, 1] if step < 4 else [0, 1, 2] if step < 8 else [1, 2] for step in range(STEPS)
    }
    snapshots = [
        MapSnapshot(
            step=step,
            path=pose[step : step + 1],
            covariance=spread[step],
            landmarks=LANDMARKS[names[step]],
            landmark_covariance=np.tile(np.eye(2) * 0.04, (len(names[step]), 1, 1)),
            observed=np.array([0]),
            ids=np.array(names[step]),
        )
        for step in range(STEPS)
    ]
    return Trajectory(time, pose, spread), snapshots


def _map_page(name="a map", lost=()):
    estimate, snapshots = _drive()
    rng = np.random.default_rng(2)
    k = 200
    innovation = rng.normal(size=(k, 2))
    charts = innovation_charts(
        np.linspace(0, STEPS - 1, k),
        innovation,
        np.tile(np.eye(2), (k, 1, 1)),
        np.square(innovation).sum(1),
        (1.5, 2.5),
        20,
    )
    picture = np.full((30, 40, 3), 128, np.uint8)
    part = map_part(
        Section(name, name, facts={name: name}),
        {"estimate": estimate, "odometry": estimate, "truth": estimate},
        snapshots,
        ObservedLandmarks(
            np.array([0, 1, 2, 3, 5, 8, 9]),
            np.array([1, 1, 1, 0, 2, 1, 1]),
            np.full((7, 2), 12.0),
            np.array([0, 1, 1, 0, 0, 2, 1]),
        ),
        [*charts, *uncertainty_charts(estimate, estimate)],
        image_at=lambda step: picture if step % 2 == 0 else None,
        lost=lost,
    )
    return report_page(name, name, [part])


def _scrub(page, step):
    page.locator(".player input").fill(str(step))


def _pixels(page):
    page.evaluate(DRAWN)
    return page.locator("canvas.ground").screenshot()


def test_a_map_is_scrubbed_played_and_explored(opened):
    page = opened(
        _map_page(lost=[[2.5, 4.0], [9.0, None]]), viewport={"width": 1200, "height": 900}
    )
    part, now = page.locator(".part"), page.locator("output")
    assert part.get_attribute("data-step") == "11"
    _scrub(page, 2)
    assert now.inner_text() == "2.0 s · 2 landmarks"
    early = _pixels(page)
    _scrub(page, 7)
    assert now.inner_text() == "7.0 s · 3 landmarks"
    assert _pixels(page) != early
    for step, lost in ((3, True), (4, False), (8, False), (10, True)):
        _scrub(page, step)
        assert now.inner_text().endswith("lost") == lost
    page.get_by_role("button", name="Play").click()
    page.wait_for_selector(".part[data-step='11']")
    page.wait_for_selector("button[aria-label=Play]")

    canvas = page.locator("canvas.ground")
    box = canvas.bounding_box()
    ellipse = 0.2 * np.sqrt(chi2.ppf(0.9973, 2))  # of the landmark in the corner
    wide, high = 8.0 + ellipse, 3.0 + ellipse  # meters, of all that is there at the end
    scale = 0.92 * min(box["width"] / wide, box["height"] / high)
    center = np.array([4.0, 2.5]) + ellipse / 2
    at = (LANDMARKS[1] - center) * [scale, -scale] + [box["width"] / 2, box["height"] / 2]
    canvas.click(position={"x": float(at[0]), "y": float(at[1])})
    detail = page.locator(".detail")
    assert detail.locator("h3").inner_text() == "Landmark 1"
    assert "Observed 5 times. At 8.00, 4.00 m" in detail.inner_text()
    assert detail.locator(".thumb").all_inner_texts() == ["frame 0", "frame 2", "frame 8"]
    detail.get_by_role("button", name=f"0{TO}2").click()
    assert part.get_attribute("data-step") == "0"

    areas = page.locator(".plotted")
    assert areas.count() == 6
    last = areas.last
    last.scroll_into_view_if_needed()
    box = last.bounding_box()
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] * 4 / (STEPS - 1), middle)
    limit = np.degrees(3 * np.sqrt(0.001))
    reading = page.locator(".reading").last.inner_text()
    assert reading == f"4.0 s: 0 ({-limit:.3g} to {limit:.3g})"
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 8 / (STEPS - 1), middle)
    page.mouse.up()
    ends = areas.evaluate_all(
        "(all) => all.map((each) => [each.ariaValueMin, each.ariaValueMax].map(Number))"
    )
    assert np.allclose(ends, [[4, 8]] * 6, atol=0.1)  # all charts zoom together
    assert_accessible(page)


KEYPOINTS = Keypoints(
    xy=np.array([[20, 30], [60, 10]], np.float32),
    size=np.array([8, 20], np.float32),
    angle=np.array([0, np.pi / 2], np.float32),
    response=np.array([0.5, 0.25], np.float32),
    octave=np.array([0, 1], np.int32),
    descriptors=np.arange(256, dtype=np.uint8).reshape(2, 128),
)


def _image_page(name="an image"):
    image = np.random.default_rng(1).random((60, 90, 3), np.float32)
    maps = {"saliency": image[::4, ::4, 0], name: image[::8, ::8, 1]}
    path = Scanpath(np.array([[10.0, 20.0], [70.0, 40.0]]), np.array([0.05, 0.1]), np.ones(2))
    pairs = np.array([[0, 1], [1, 0]])
    inliers = np.array([True, False])
    parts = [
        image_part(Section(name, name), image, maps, path, KEYPOINTS),
        match_part(Section(name, name), (image, image), (KEYPOINTS, KEYPOINTS), pairs, inliers),
    ]
    return report_page(name, name, parts)


def test_a_photograph_and_a_match_are_explored(opened):
    page = opened(_image_page(), viewport={"width": 1280, "height": 900})
    heat = page.locator(".heat")
    assert heat.is_visible()
    assert page.get_by_role("radio", name="saliency").is_checked()
    first = heat.get_attribute("src")
    page.get_by_role("radio", name="an image").check()
    assert heat.get_attribute("src") != first
    _scrub(page, 1)
    assert page.locator("output").inner_text() == "fixation 1, 50 ms"
    page.get_by_role("button", name="Play").click()
    page.wait_for_selector(".part[data-fixation='2']")

    page.get_by_role("checkbox", name="interest points").check()
    photo = page.locator(".photograph")
    scale = photo.bounding_box()["width"] / 90
    photo.hover(position={"x": 60 * scale, "y": 10 * scale})
    facts = page.locator(".detail").first.locator("dd").all_inner_texts()
    assert facts == ["60.0, 10.0 px", "20.0 px", "90\N{DEGREE SIGN}", "1", "0.250"]

    canvas, detail = page.locator(".pair"), page.locator(".detail").last
    scale = (canvas.bounding_box()["width"] - 6) / 180
    canvas.click(position={"x": 20 * scale, "y": 30 * scale})
    facts = detail.locator("dd").all_inner_texts()
    apart = np.sqrt(128) * 128  # the two descriptors lie 128 apart in each number
    expected = ["20.0, 30.0 px", "60.0, 10.0 px", "8.0 px and 20.0 px", f"{apart:.0f}"]
    assert facts == [*expected, "yes, an inlier"]
    page.get_by_role("spinbutton", name="Match").fill("2")
    assert detail.locator("dd").last.inner_text() == "no"
    assert_accessible(page)
