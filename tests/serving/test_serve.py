"""The local server without a browser: access, limits, results and copied snippets."""

import json
import re
import signal
import socket
import subprocess
import sys
import threading
from importlib.resources import files
from typing import get_type_hints
from urllib.request import Request, urlopen

import numpy as np
import pytest

from saccade.errors import ConfigError, ImageError
from saccade.serving import analysis
from saccade.serving.analysis import PhotoAnalyzer
from saccade.serving.controls import controls
from saccade.serving.playground import Playground
from saccade.settings import load_settings, settings_from
from support.limits import TIMEOUT
from support.pictures import png, without_figures

pytest.importorskip("starlette", reason="the extra serve is not installed")
import anyio
from starlette.testclient import TestClient

from saccade.serving.app import application

PORT = 8014
HOME = f"http://127.0.0.1:{PORT}"
MAX_BYTES = 200_000
PHOTO = files("saccade") / "data" / "horse.jpg"
WORK = ("/look", "/points", "/slam/start", "/slam/step")
"""Paths of requests of JSON."""


class _StubAnalyzer:
    """Records its requests."""

    def __init__(self):
        self.done = []
        self.hold = threading.Event()
        self.hold.set()

    def open(self, data, name):
        self.done.append((name, len(data)))
        return {"photo": "1"}

    def analyze(self, request):
        self.hold.wait(5)
        self.done.append(request)
        if "fail" in request:
            raise {"key": KeyError, "setting": ConfigError, "own": RuntimeError}[request["fail"]](
                "why"
            )
        return {"maps": []}

    detect = start = step = analyze

    def warm_up(self):
        pass


@pytest.fixture
def analyzer():
    return _StubAnalyzer()


@pytest.fixture
def client(analyzer):
    app = application(analyzer, analyzer, {"a.jpg": b"jpeg"}, PORT, MAX_BYTES, {})
    with TestClient(app, base_url=HOME, raise_server_exceptions=False) as client:
        yield client


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LocalHost"])
def test_local_host_names_get_the_page(client, host):
    answer = client.get("/", headers={"Host": f"{host}:{PORT}"})
    assert answer.status_code == 200
    assert answer.text.startswith("<!doctype html>")


EVIL = f"127.0.0.1.evil.example:{PORT}"


REJECTED = {
    "Host": ("evil.example", EVIL, "", f"user@127.0.0.1:{PORT}"),
    "Origin": ("null", "", f"https://127.0.0.1:{PORT}", f"http://{EVIL}", "http://[evil"),
    "Sec-Fetch-Site": ("cross-site", "same-site"),
    "Upgrade": ("websocket", "h2c"),
}
REASONS = {
    "Host": "the Host header does not name this server",
    "Upgrade": "expected HTTP, found an upgrade to another protocol",
}


@pytest.mark.parametrize(
    ("header", "value"), [(name, value) for name, values in REJECTED.items() for value in values]
)
def test_requests_of_other_pages_are_rejected(client, analyzer, header, value):
    reason = REASONS.get(header, "cross-origin request")
    for path in ("/photo", *WORK):
        answer = client.post(path, content=b"{}", headers={header: value})
        assert (answer.status_code, answer.text) == (403, f"rejected: {reason}")
    for path in ("/state", "/samples/a.jpg"):
        assert client.get(path, headers={header: value}).status_code == 403
    assert not analyzer.done


def test_links_of_other_sites_open_the_page_and_nothing_else(client):
    link = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
    assert client.get("/", headers=link).status_code == 200
    assert client.post("/look", json={}, headers=link).status_code == 403
    own = {"Sec-Fetch-Site": "same-origin", "Origin": HOME}
    assert client.post("/look", json={}, headers=own).status_code == 200


def test_the_policy_allows_only_the_own_server(client):
    answer = client.get("/")
    policy = re.search('http-equiv="Content-Security-Policy" content="(.*?)"', answer.text)[1]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == rules["base-uri"] == "'none'"
    assert rules["connect-src"] == "'self'"
    assert "unsafe" not in policy
    assert "*" not in policy
    for word, kind in (("script", "script-src"), ("style", "style-src")):
        inline = re.findall(rf"<{word}>(.*?)</{word}>", answer.text, re.DOTALL)
        assert len(inline) == len(rules[kind].split())
    assert " style=" not in re.sub(r"<script>.*?</script>", "", answer.text, flags=re.DOTALL)
    for path in ("/", "/state", "/samples/a.jpg", "/nowhere"):
        headers = client.get(path).headers
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["X-Frame-Options"] == "DENY"
        assert headers["Cache-Control"] == "no-store"
        assert "Access-Control-Allow-Origin" not in headers


def test_a_body_that_is_too_large_is_rejected_whatever_length_it_declares(client, analyzer):
    answer = client.post("/photo?name=x", content=b"x" * (MAX_BYTES + 1))
    assert (answer.status_code, answer.text) == (413, "too large: expected at most 0.2 MB")
    assert client.post("/look", content=b" " * 100_001).status_code == 413
    chunks = (b"x" * 10_000 for _ in range(100))
    assert client.post("/photo", content=chunks).status_code == 413
    assert not analyzer.done
    assert client.post("/photo?name=x", content=b"x" * MAX_BYTES).status_code == 200
    assert analyzer.done == [("x", MAX_BYTES)]


@pytest.mark.parametrize(
    "body",
    [b"", b"[]", b"[" * 50_000, b"\xff\xfe", b'{"a": ' + b"9" * 9999],
)
def test_malformed_requests_are_refused(client, analyzer, body):
    for path in WORK:
        answer = client.post(path, content=body)
        assert answer.status_code == 400
        assert answer.text.startswith("expected")
    assert not analyzer.done


@pytest.mark.parametrize(
    ("fail", "status", "words"),
    [
        ("key", 404, "why"),
        ("setting", 422, "why"),
        ("own", 500, "Internal Server Error"),
    ],
)
def test_errors_are_one_line(client, fail, status, words):
    answer = client.post("/look", json={"fail": fail})
    assert (answer.status_code, answer.text) == (status, words)


def test_a_photograph_stays_while_others_are_opened():
    analyzer, others = PhotoAnalyzer(), png(64, 64)
    photo = analyzer.open(PHOTO.read_bytes(), "mine")["photo"]
    for number in range(40):
        analyzer.open(others, f"{number}")
    assert analyzer.detect({"photo": photo})["count"] > 0


@pytest.mark.parametrize("value", [[], {}, 3, None, "nosuch"])
def test_a_choice_is_a_name(value):
    analyzer = PhotoAnalyzer()
    photo = analyzer.open(PHOTO.read_bytes(), "a")["photo"]
    for key, work in (
        ("model", analyzer.analyze),
        ("path", analyzer.analyze),
        ("detector", analyzer.detect),
        ("filter", Playground().start),
    ):
        with pytest.raises(ConfigError, match=f"^{key}: expected one of .*, found "):
            work({"photo": photo, key: value})


def test_a_slow_request_ends(analyzer, monkeypatch):
    async def sent():
        request = {"type": "http", "method": "POST", "path": "/photo", "query_string": b""}
        headers = [(b"host", f"127.0.0.1:{PORT}".encode())]
        await app({**request, "headers": headers}, stalls, collect)

    async def stalls():
        await anyio.sleep(TIMEOUT)

    async def collect(message):
        messages.append(message)

    messages = []
    monkeypatch.setattr("saccade.serving.app.UPLOAD_SECONDS", 0.01)
    app = application(analyzer, analyzer, {}, PORT, MAX_BYTES, {})
    anyio.run(sent)
    assert messages[0]["status"] == 408
    assert messages[1]["body"].startswith(b"too slow: expected the whole request within")
    assert not analyzer.done


@pytest.mark.parametrize("side", [7000, 12_000, 65_000])
def test_an_enormous_picture_is_refused_before_it_is_decoded(side, monkeypatch):
    monkeypatch.setattr("cv2.imdecode", lambda *_: pytest.fail("it was decoded"))
    with pytest.raises(
        ImageError, match=r"^bomb.png: (expected at most 40 million pixels|the image is far too)"
    ):
        PhotoAnalyzer().open(png(side, 0), "bomb.png")


def test_the_maps_of_a_photograph_are_never_those_of_one_that_is_gone(monkeypatch):
    """A photograph may reuse the memory, and so the id, of an earlier one."""
    coffee = files("saccade") / "data" / "coffee.jpg"
    monkeypatch.setattr(analysis, "MAX_FILE_BYTES", 3 * len(coffee.read_bytes()))
    monkeypatch.setattr(analysis, "MAX_DECODED_PIXELS", 1)
    analyzer = PhotoAnalyzer()
    request = {"model": "contrast", "fixations": 1}

    def opened(photo):
        return {"photo": analyzer.open(photo.read_bytes(), photo.name)["photo"], **request}

    first = opened(coffee)
    right = analyzer.analyze(first)["maps"]
    for _ in range(3):
        analyzer.analyze(opened(PHOTO))
        for _ in range(4):
            last = opened(coffee)
        assert analyzer.analyze(last)["maps"] == right
    with pytest.raises(KeyError, match="no longer in memory"):
        analyzer.analyze(first)


CHANGED = {
    "attention": {"contrast_weight": 0.5},
    "contrast": {"map_level": 5, "scales": [[1, 2], [2, 4], [3, 5]], "color": "quotient"},
    "symmetry": {
        "viewing_size": None,
        "kind": "isotropic",
        "gain": 3,
        "levels": [2, 3],
        "level_weights": [1, 0.5],
    },
    "scanpath": {"inhibition_sigma": 0.1},
    "must": {"contrast_threshold": 0.1, "upright": True},
}


def test_the_copied_files_have_the_settings(tmp_path):
    analyzer = PhotoAnalyzer()
    photo = analyzer.open(PHOTO.read_bytes(), "a.jpg")["photo"]
    request = {"photo": photo, "model": "attention", **CHANGED, "detector": "must"}
    for kind, inner, result in (
        ("attention", ("contrast", "symmetry"), analyzer.analyze(request)),
        ("must", (), analyzer.detect(request)),
    ):
        path = tmp_path / f"{kind}.toml"
        path.write_text(result["file"], encoding="utf-8")
        settings = CHANGED[kind] | {each: CHANGED[each] for each in inner}
        assert load_settings(kind, path=path) == settings_from(kind, settings, "request")


def test_the_page_opens_with_the_scanpath_of_look(tmp_path, run, monkeypatch):
    without_figures(monkeypatch)
    _, out, _ = run("look", PHOTO, "--json")
    expected = json.loads(out)["images"][0]["scanpath"]
    tables = {}
    for group in controls()["groups"]:
        tables |= group["presets"][group["initial"]]
    analyzer = PhotoAnalyzer()
    photo = analyzer.open(PHOTO.read_bytes(), "a.jpg")["photo"]
    found = analyzer.analyze({"photo": photo, **tables})
    xy = found["scanpath"]["xy"].reshape(-1, 2)
    assert np.allclose(xy, [row[:2] for row in expected], atol=1)
    assert "--scanpath most-probable --length 10" in found["file"]
    network = analyzer.analyze({"photo": photo, "path": "winner-take-all", **tables})
    assert not np.array_equal(network["scanpath"]["xy"], found["scanpath"]["xy"])


@pytest.mark.parametrize("group", controls()["groups"], ids=lambda group: group["kind"])
def test_every_slider_stays_where_the_configuration_allows(group):
    kind = group["kind"]
    hints = get_type_hints(type(load_settings(kind)))
    for field in group["fields"]:
        if field["input"] != "range":
            continue
        name, step = field["name"], field["step"]
        assert hints[name] not in (int, int | None) or step == int(step) >= 1
        for value in (field["low"], field["high"]):
            free = {"outer": 20, "inner": 1} if kind == "symmetry" else {}
            free |= {"grid": "centered"} if kind == "sift" else {}
            settings_from(kind, free | {name: value}, kind)
        assert not field.get("optional") or settings_from(kind, {name: None}, kind)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"model": "none"},
            "model: expected one of attention, contrast, symmetry, boolean, found 'none'",
        ),
        ({"fixations": 1000}, "fixations: expected 1 to 100, found 1000"),
        ({"contrast": 3}, "contrast: expected a table of settings, found 3"),
        ({"attention": {"no": 1}}, "attention: no setting 'no'"),
        ({"symmetry": {"inner": 9}}, "inner: expected 1 px to 4, found 9"),
        (
            {"path": "winner-take-all", "scanpath": {"gain": "x"}},
            "scanpath: gain: expected a number, found 'x'",
        ),
        ({"path": "shortest"}, "path: expected one of most-probable, winner-take-all"),
        ({"photo": None}, "no longer in memory"),
    ],
)
def test_invalid_settings_are_one_line_errors(change, words):
    analyzer = PhotoAnalyzer()
    token = analyzer.open(PHOTO.read_bytes(), "a")["photo"]
    with pytest.raises((ConfigError, KeyError), match=re.escape(words)):
        analyzer.analyze({"photo": token, **change})


def test_it_starts_answers_only_here_and_ends_with_an_upload_in_progress(tmp_path):
    command = [sys.executable, "-m", "saccade", "serve", "--port", "0"]
    pipes = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE}
    process = subprocess.Popen(command, cwd=tmp_path, text=True, **pipes)
    try:
        line = process.stderr.readline()
        port = int(re.search(r"open http://127\.0\.0\.1:(\d+)/ in a browser; Ctrl-C", line)[1])
        address = f"http://127.0.0.1:{port}/photo?name=a.png"
        with urlopen(Request(address, png(64, 64), method="POST"), timeout=TIMEOUT) as answer:
            assert answer.status == 200
        for each in socket.gethostbyname_ex(socket.gethostname())[2]:
            if not each.startswith("127."):
                with pytest.raises(OSError), socket.create_connection((each, port), timeout=1):
                    pass
        with socket.create_connection(("127.0.0.1", port)) as upload:
            address = f"127.0.0.1:{port}\r\nContent-Length: 9\r\n\r\n"
            upload.sendall(f"POST /photo HTTP/1.1\r\nHost: {address}".encode())
            process.send_signal(signal.SIGTERM)  # ends like Ctrl-C
            out, rest = process.communicate(timeout=TIMEOUT)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 0, rest
    assert out == ""
    assert rest.splitlines()[-1] == "saccade: stopped"
    assert "Traceback" not in rest
    assert not list(tmp_path.iterdir())
