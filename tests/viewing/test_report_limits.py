"""Every page stays under 5 MB and escapes names, whatever it is given."""

import base64
import json
import os
import re
from html.parser import HTMLParser

import matplotlib as mpl
import numpy as np
import pytest

from saccade.io.image import decode_image
from saccade.types import Keypoints, MapSnapshot, Scanpath, Trajectory
from saccade.viewing.charts import uncertainty_charts
from saccade.viewing.page import Section
from saccade.viewing.report import (
    MAX_DESCRIBED_POINTS,
    MAX_MATCHES,
    ReportBuilder,
    image_part,
    match_part,
)
from saccade.viewing.report_map import ObservedLandmarks, map_part

LARGEST = 5_000_000
SECTION = Section("a heading", "Words.")
PATH = Scanpath(np.array([[10.0, 20.0]]), np.array([0.05]), np.ones(1))


def _noise(rng, *shape):
    return rng.random(shape, np.float32)


def _points(rng, count):
    return Keypoints(
        xy=_noise(rng, count, 2) * 1000,
        size=_noise(rng, count),
        angle=_noise(rng, count),
        response=_noise(rng, count),
        octave=np.zeros(count, np.int32),
        descriptors=rng.integers(0, 255, (count, 128), np.uint8),
    )


def _image(rng):
    maps = {str(number): _noise(rng, 500, 500) for number in range(7)}
    return image_part(
        SECTION, _noise(rng, 1300, 1300, 3), maps, PATH, _points(rng, 3 * MAX_DESCRIBED_POINTS)
    )


def _match(rng):
    images = (_noise(rng, 1200, 1200, 3), _noise(rng, 1200, 1200, 3))
    count = 2 * MAX_MATCHES + 1
    points = _points(rng, count)
    pairs = np.stack([np.arange(count)] * 2, 1)
    return match_part(SECTION, images, (points, points), pairs, np.ones(count, np.bool_))


def _map(rng):
    poses, landmarks, snapshots = 50_000, 1500, 300
    pose = rng.normal(size=(poses, 3))
    drive = Trajectory(np.arange(poses) * 0.1, pose, np.tile(np.eye(3), (poses, 1, 1)))
    spread = np.tile(np.eye(2), (landmarks, 1, 1))
    grown = [
        MapSnapshot(
            step=step,
            path=pose[step : step + 1],
            covariance=np.eye(3),
            landmarks=rng.normal(size=(landmarks, 2)),
            landmark_covariance=spread,
            observed=np.arange(300),
            ids=np.arange(landmarks),
        )
        for step in np.linspace(0, poses - 1, snapshots).astype(int).tolist()
    ]
    step = np.sort(rng.integers(0, poses, 400_000))
    name = rng.integers(0, landmarks, len(step))
    seen = ObservedLandmarks(
        step, name, rng.normal(size=(len(step), 2)), np.zeros(len(step), np.int64)
    )
    frame = rng.integers(0, 255, (280, 280, 3), np.uint8)
    charts = uncertainty_charts(drive, drive)
    trajectories = {"estimate": drive}
    return map_part(SECTION, trajectories, grown, seen, charts, image_at=lambda _: frame)


@pytest.mark.parametrize(
    ("make", "notes"),
    [
        (_image, ""),
        (_match, " This page shows one in 3 of 10,001 matches."),
        (
            _map,
            r" This page shows one in \d+ of 300 states of the map\. .* [\d,]+ intervals .*",
        ),
    ],
)
def test_a_part_never_outgrows_the_page(make, notes, rng, tmp_path):
    builder = ReportBuilder("title", "Lead.")
    builder.add(lambda: make(rng))
    page = builder.write(tmp_path / "report.html")
    assert LARGEST / 8 < page.stat().st_size < LARGEST
    text = re.search(r"<h2>a heading</h2>\n<p>Words\.(.*?)</p>", page.read_text())[1]
    assert re.fullmatch(notes, text), text


NAME = (
    "<img src=x onerror=alert(1)></script><svg onload=alert(2)>\"'><b>&amp;&"
    "\u202egnp.\N{SNOWMAN} \N{COMBINING ACUTE ACCENT} tab\tnew\nline" + os.fsdecode(b"\xff\xfe<b>")
)


def _is_harmless(page, name):
    """Whether a page shows a name as text and holds no element from it."""
    found, texts, tags = HTMLParser(), [], set()
    found.handle_starttag = lambda tag, attributes: tags.add(
        tag if tag in ("b", "svg") or any(each.startswith("on") for each, _ in attributes) else ""
    )
    found.handle_data = texts.append
    found.feed(page.read_text(encoding="utf-8"))
    words = name.encode(errors="replace").decode()
    return tags == {""} and any(words in each for each in texts)


def test_names_are_escaped(tmp_path):
    page = tmp_path / "report.html"
    image = np.zeros((40, 60, 3), np.float32)
    maps = {NAME: image[:, :, 0]}
    points = Keypoints.at([[1, 1]], size=2)
    section = Section(NAME, NAME, facts={NAME: NAME})
    builder = ReportBuilder(NAME, NAME)
    builder.add(lambda: image_part(section, image, maps, PATH, points))
    builder.write(page)
    assert _is_harmless(page, NAME)
    data = re.findall(r'<script type="application/json">(.*?)</script>', page.read_text())
    assert json.loads(data[0])["maps"][0]["name"] == NAME


def test_a_map_on_a_page_has_the_colors_of_its_values():
    image = np.zeros((40, 60, 3), np.float32)
    values = np.linspace(0, 3, 2400, dtype=np.float32).reshape(40, 60)
    part = image_part(SECTION, image, {"m": values}, PATH, Keypoints.at([[1, 1]], size=2))
    data = base64.b64decode(part.data["maps"][0]["address"].split(",")[1])
    expected = mpl.colormaps["cividis"](values / 3)[:, :, :3]
    assert np.abs(decode_image(data, "m") - expected).max() < 0.02
