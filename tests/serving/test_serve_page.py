"""The local page in a real browser: drop, slide, switch, play, copy, and errors."""

import base64
import re
import socket
import threading
from contextlib import contextmanager
from importlib.resources import files
from urllib.request import urlopen

import pytest

from saccade.serving.analysis import PhotoAnalyzer
from saccade.serving.controls import controls
from saccade.serving.playground import Playground
from support.accessibility import assert_accessible
from support.limits import PAGE_TIMEOUT

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
uvicorn = pytest.importorskip("uvicorn", reason="the extra serve is not installed")
from saccade.cli.serve import _listening  # noqa: E402
from saccade.serving.app import application  # noqa: E402

expect = playwright.expect
DATA = files("saccade") / "data"
MAX_BYTES = 400_000
DROP = """([bytes, name]) => {
  const data = new DataTransfer();
  const letters = atob(bytes);
  data.items.add(new File([Uint8Array.from(letters, (each) => each.charCodeAt(0))], name));
  dispatchEvent(new DragEvent("drop", { dataTransfer: data, cancelable: true }));
}"""


class _Counting(PhotoAnalyzer):
    """Counts its analyses, and can be made to wait."""

    def __init__(self):
        super().__init__()
        self.looks, self._may_continue = 0, threading.Event()
        self._may_continue.set()

    def analyze(self, request):
        self.looks += 1
        self._may_continue.wait(PAGE_TIMEOUT)
        return super().analyze(request)

    @contextmanager
    def held(self, address):
        """No analysis ends until the block has, and the server has read what was sent in it."""
        self.looks = 0
        self._may_continue.clear()
        try:
            yield
            for _ in range(3):  # all that is there, what of it was closed, and once more
                urlopen(f"{address}state", timeout=PAGE_TIMEOUT).close()
        finally:
            self._may_continue.set()

    def warm_up(self):
        """The tests compile what they need."""


@pytest.fixture(scope="module")
def served():
    """A running server: its analyzer, its address and its playground."""
    analyzer, robots = _Counting(), Playground()
    samples = {name: (DATA / name).read_bytes() for name in ("horse.jpg", "coffee.jpg")}
    with _listening(0) as listener:
        port = listener.getsockname()[1]
        app = application(analyzer, robots, samples, port, MAX_BYTES, controls())
        server = uvicorn.Server(uvicorn.Config(app, log_level="error", timeout_graceful_shutdown=1))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        yield analyzer, f"http://127.0.0.1:{port}/", robots
        server.should_exit = True
        thread.join(PAGE_TIMEOUT)


@pytest.fixture
def opened(browser, served):
    """Opens the page; fails on console messages, page errors, dialogs and foreign requests."""
    address = served[1]
    problems, pages = [], []

    def open_page(**how):
        page = browser.new_page(**how)
        pages.append(page)
        page.set_default_timeout(1000 * PAGE_TIMEOUT)
        expected = "status of 4"  # what the server refuses is told on the page
        page.on("console", lambda said: expected in said.text or problems.append(said.text))
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("dialog", lambda dialog: problems.append(dialog.message))
        page.on(
            "request",
            lambda asked: asked.url.startswith((address, "data:")) or problems.append(asked.url),
        )
        page.goto(address)
        _settle(page)
        return page

    yield open_page
    for page in pages:
        page.close()
    assert not problems


def _settle(page):
    page.wait_for_selector("#serve[data-busy=false]:not([data-points=''])")


def _drop(page, data, name, script=DROP):
    page.evaluate(script, [base64.b64encode(data).decode(), name])


def _slide(page, name, value):
    page.get_by_role("slider", name=re.compile(f"^{name}")).first.fill(str(value))


def test_a_photograph_is_dropped_set_and_copied(opened):
    page = opened(viewport={"width": 1300, "height": 1000})
    serve, part = page.locator("#serve"), page.locator(".part")
    assert page.locator(".title").inner_text() == "horse.jpg · 400 x 328 px"
    assert part.get_attribute("data-map") == "saliency"
    evil = "<img src=x onerror=alert(1)> \u202egpj.\N{SNOWMAN}'.jpg"
    _drop(page, (DATA / "coffee.jpg").read_bytes(), evil)
    expect(page.locator(".title")).to_contain_text("600 x 400")
    _settle(page)
    assert page.locator(".title").inner_text().startswith(evil)
    assert page.locator("#serve img[onerror]").count() == 0
    pre = page.locator("pre")

    before = int(serve.get_attribute("data-points"))
    sift = page.locator("[data-kind=sift]")
    sift.get_by_role("checkbox", name="contrast_threshold").check()
    _slide(page, "contrast_threshold", 0.05)
    expect(pre.last).to_contain_text("contrast_threshold = 0.05")
    assert 0 < int(serve.get_attribute("data-points")) < before
    assert sift.locator(".state").inner_text() == "changed"
    sift.get_by_label("Preset").select_option("kootstra2010")
    expect(pre.last).to_contain_text("octaves = 3")
    sift.get_by_role("button", name="Reset").click()
    expect(serve).to_have_attribute("data-points", str(before))
    assert sift.get_by_role("button", name="Reset").is_disabled()
    copy = page.locator(".snippet button").first
    copy.click()
    expect(copy).to_have_text(re.compile("Copied|Selected"))


def test_abandoned_requests_are_skipped(served):
    analyzer, address, _ = served
    place = ("127.0.0.1", int(address.rsplit(":", 1)[1].strip("/")))
    photo = analyzer.open((DATA / "horse.jpg").read_bytes(), "horse.jpg")["photo"]
    body = f'{{"photo": "{photo}", "fixations": 1, "model": "contrast"}}'
    words = f"POST /look HTTP/1.1\r\nHost: {place[0]}:{place[1]}\r\nContent-Length: {len(body)}"
    with socket.create_connection(place) as first, socket.create_connection(place) as last:
        with analyzer.held(address):
            first.sendall(f"{words}\r\n\r\n{body}".encode())
            for _ in range(6):
                with socket.create_connection(place) as gone:
                    gone.sendall(f"{words}\r\n\r\n{body}".encode())
            last.sendall(f"{words}\r\n\r\n{body}".encode())
        answers = [each.recv(12) for each in (first, last)]
    assert answers == [b"HTTP/1.1 200"] * 2
    assert analyzer.looks == 2


def _steps(page):
    return int(page.locator("#slam").get_attribute("data-steps"))


def test_a_robot_is_driven_by_keys_and_buttons_among_landmarks_that_are_placed(opened, served):
    page = opened(viewport={"width": 1280, "height": 1000}, has_touch=True)
    page.get_by_role("link", name="SLAM").click()
    page.wait_for_selector("#slam[data-steps='0']")
    assert page.locator("#photograph").is_hidden()
    rows = page.locator("#slam tbody tr")
    assert rows.locator("th").all_inner_texts() == ["invariant", "standard"]
    page.get_by_role("button", name="No landmarks").click()
    counter = page.locator(".steps")
    expect(counter).to_have_text("0 steps, 0 landmarks, 0 in the map of the filter")
    canvas = page.locator("#slam .ground")
    box = canvas.bounding_box()
    scale = 0.92 * min(box["width"], box["height"]) / 28  # the view is 28 m high and wide
    near = {"x": box["width"] / 2 + 2 * scale, "y": box["height"] / 2 + 9 * scale}  # (2, -9) m
    canvas.click(position=near)
    expect(counter).to_have_text("0 steps, 1 landmarks, 0 in the map of the filter")
    canvas.press(" ")
    page.wait_for_selector("#slam[data-steps='1']")
    expect(counter).to_contain_text("1 in the map")
    canvas.press("ArrowUp")
    page.wait_for_selector("#slam[data-steps='2']")
    forward = page.get_by_role("button", name="Forward")
    forward.tap()
    page.wait_for_selector("#slam[data-steps='3']")
    canvas.click(position=near)
    expect(counter).to_contain_text(", 0 landmarks, 1 in the map")
    circles = page.get_by_role("button", name="Drive in circles")
    before = _steps(page)
    circles.click()
    expect(counter).not_to_have_text(re.compile(f"^{before} steps"))
    circles.click()
    assert circles.get_attribute("aria-pressed") == "false"
    page.locator("#slam .segments label", has_text="invariant").click()
    page.wait_for_selector("#slam[data-filter=invariant]")
    assert rows.first.get_attribute("class") == "chosen"
    assert "Correlations" in page.locator(".correlation").get_attribute("aria-label")
    assert_accessible(page)
    served[2].sessions = Playground().sessions  # the server lost the session: it is started again
    canvas.press(" ")
    page.wait_for_selector("#slam[data-steps='0']")
    assert page.locator("#slam .alarm").is_hidden()
