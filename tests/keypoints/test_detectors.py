"""Every row of the table of detectors, and users' functions, wherever a detector is named."""

import json
from dataclasses import replace
from importlib.resources import files
from pkgutil import resolve_name
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import saccade
from saccade import exchange
from saccade.errors import ConfigError
from saccade.evaluation.detectors import find_detector
from saccade.keypoints.detectors import DETECTORS, Detector, keypoints_of, make_detector
from saccade.serving.analysis import PhotoAnalyzer
from saccade.serving.controls import GROUPS, controls
from support.keypoint_files import assert_same
from support.own_detectors import brightness, corners, fails, gray_patches
from support.pictures import looks_like_a_picture

pytest.importorskip("pyarrow", reason="needs the extra `parquet`")
from saccade.batch import Job, match_images, read_points

COUNT = 9
OWN = "support.own_detectors"


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Two overlapping parts of a photograph."""
    folder = tmp_path_factory.mktemp("photos")
    hallway = cv2.imread(str(files("saccade") / "data" / "hallway_1.jpg"))
    for number in range(2):
        cv2.imwrite(str(folder / f"{number}.png"), hallway[100:260, 10 * number :][:, :220])
    return folder


@pytest.fixture(params=[*DETECTORS, "added-by-this-test"])
def name(request, monkeypatch):
    """Every name in the table, and one that a row of its own adds."""
    if request.param not in DETECTORS:
        config = DETECTORS["sift"].settings
        row = Detector("corners", f"{OWN}:corner_detector", config, "contrast_threshold")
        monkeypatch.setitem(DETECTORS, request.param, row)
        monkeypatch.setitem(
            GROUPS, request.param, {"title": row.summary, "first": [], "sliders": {}}
        )
    return request.param


def test_a_row_of_the_table_works_wherever_a_detector_is_named(name, photos, run):
    row, path = DETECTORS[name], photos / "0.png"
    image, settings = saccade.read_image(path), row.settings(max_keypoints=COUNT)
    found = resolve_name(row.path)(settings, threads=1)(image)
    if keypoints_of(found).descriptors is None:
        found = saccade.Sift().describe(image, found, orient=True)[:COUNT]
    points = keypoints_of(found)
    assert len(points) >= COUNT
    assert_same(keypoints_of(make_detector(name, settings)(image)), points)

    code, out, _ = run("detect", path, "--detector", name, "--max", COUNT, "--json")
    (printed,) = json.loads(out)["images"]
    assert (code, printed["points"]) == (0, len(points))
    assert looks_like_a_picture(printed["picture"])
    assert_same(exchange.read_npz(printed["arrays"]), points)
    assert ("boxes" in printed) == row.gives_regions
    if row.gives_regions:
        np.testing.assert_allclose(printed["boxes"], found.boxes)
    code, out, _ = run(
        "match", path, photos / "1.png", "--detector", name, "--max", COUNT, "--json"
    )
    assert json.loads(out)["first_points"] == len(points)
    assert "max_keypoints" in run("config", name)[1]

    code, out, _ = run("extract", photos, "--what", name, "--out", "features", "--workers", 1)
    stored = {each.image: each.points for each in read_points("features")}
    default = keypoints_of(make_detector(name)(image))
    np.testing.assert_allclose(stored["0.png"].xy, default.xy, atol=1 / 256)
    np.testing.assert_array_equal(stored["0.png"].descriptors, default.descriptors)

    analyzer = PhotoAnalyzer()
    photo = analyzer.open(path.read_bytes(), "0.png")["photo"]
    request = {"photo": photo, "detector": name, name: {"max_keypoints": COUNT}}
    assert analyzer.detect(request)["count"] == len(points)
    assert name in controls()["detectors"]
    assert name in [group["kind"] for group in controls()["groups"]]

    limited = row.by_number(None, COUNT)
    assert getattr(limited, row.threshold) == row.lowest_threshold
    assert len(find_detector(name, None, COUNT)(image).xy) >= COUNT


def test_the_help_has_every_detector(run):
    for command in (("detect",), ("match",), ("evaluate", "features")):
        _, out, _ = run(*command, "--help")
        assert all(name in out for name in DETECTORS)


@pytest.mark.parametrize("function", [corners, gray_patches])
def test_a_function_works_as_a_detector(function, photos, tmp_path, run):
    """In Python by itself, on the command line by its name; without descriptors SIFT describes."""
    image = saccade.read_image(photos / "0.png")
    points = make_detector(function)(image)
    expected = function(image)
    if function is corners:
        described = saccade.Sift().describe(image, expected, orient=True)
        assert_same(points, described)
    else:
        np.testing.assert_array_equal(points.xy, expected.xy.astype(np.float32))
        np.testing.assert_allclose(points.descriptors, expected.descriptors, rtol=1e-6)
    text = f"{OWN}:{function.__name__}"
    code, out, _ = run("detect", photos / "0.png", "--detector", text, "--json")
    assert_same(exchange.read_npz(json.loads(out)["images"][0]["arrays"]), points)
    runs = [
        match_images(str(photos), tmp_path / str(workers), job=Job(detector), workers=workers)
        for workers, detector in ((1, function), (2, text))[: 1 + (function is gray_patches)]
    ]
    for each in runs:
        (pair,) = each.matched
        np.testing.assert_array_equal(pair.indices, runs[0].matched[0].indices)
        stored = exchange.read_hdf5(each.files["features"])["0.png"]
        np.testing.assert_allclose(stored.descriptors, points.descriptors, atol=1e-5)
    assert len(runs[0].matched[0].indices) > 5
    code, out, _ = run("match", photos, "--detector", text, "--out", "m", "--workers", 1, "--json")
    assert (code, json.loads(out)["matches"]) == (0, len(runs[0].matched[0].indices))


def test_a_function_is_extracted_and_done_again_if_its_source_changes(photos, run, tmp_path):
    for workers, text in ((2, f"{OWN}:gray_patches"), (1, f"{OWN}:brightness")):
        words = "--what", text, "--out", text[-3:], "--workers", workers
        code, out, _ = run("extract", photos, *words, "--json")
        assert (code, json.loads(out)["images"]) == (0, 2)
    (stored, _) = read_points("hes")
    assert stored.points.descriptors.dtype == np.float32
    assert len(list((tmp_path / "ess" / "maps").glob("*.png"))) == 2
    assert Job(corners).fingerprint != Job(gray_patches).fingerprint
    assert Job(corners).fingerprint == Job(f"{OWN}:corners").fingerprint


def test_what_is_no_detector_is_refused(photos, run):
    with pytest.raises(ConfigError, match="one of sift, must, symroid or module:function"):
        make_detector("surf")
    with pytest.raises(ConfigError, match="expected a name or a function"):
        make_detector(3)
    image = saccade.read_image(photos / "0.png")
    for function, words in (
        (brightness, "expected an object with xy"),
        (fails, "failed: RuntimeError: no luck"),
        (lambda image: SimpleNamespace(xy=np.zeros(3)), r"xy: expected shape \(n, 2\)"),
    ):
        with pytest.raises(ConfigError, match=words):
            make_detector(function)(image)
    code, _, err = run("detect", photos, "--detector", f"{OWN}:corners", "--preset", "x")
    assert (code, err.count("\n")) == (2, 1)
    assert "no --preset and --config with a function" in err
    for words in (["detect", photos, "--detector", "surf"], ["extract", photos, "--what", "surf"]):
        code, _, err = run(*words)
        assert code == 2
        assert "expected one of sift, must, symroid" in err


def test_a_mask_holds_for_every_detector(photos):
    image = saccade.read_image(photos / "0.png")
    mask = np.zeros(image.shape[:2], bool)
    mask[:, 100:] = True
    for detector in (*DETECTORS, corners):
        settings = None
        if isinstance(detector, str):
            settings = replace(DETECTORS[detector].settings(), max_keypoints=COUNT)
        found = make_detector(detector, settings)(image, mask)
        assert len(found.xy) >= COUNT - 1
        assert (found.xy[:, 0] > 99).all()
