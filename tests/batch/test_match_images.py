"""Matching of many images."""

import csv
import json
import shutil
from importlib.resources import files
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image

import saccade
from saccade import exchange
from saccade.batch import Job, MatchConfig, extraction, match_images
from saccade.batch.pairs import read_pairs, write_pairs
from saccade.errors import ConfigError
from saccade.exchange.colmap import import_pycolmap
from saccade.exchange.hdf5 import group_of
from support.nightly import nightly

HALLWAY = [str(files("saccade") / "data" / f"hallway_{n}.jpg") for n in (1, 2)]
JOB = Job("sift", saccade.SiftConfig(max_keypoints=200))


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Two photographs of a hallway, one of them in a subfolder, and parts of both."""
    root = tmp_path_factory.mktemp("photos")
    (root / "b").mkdir()
    one, two = (cv2.imread(path)[::2, ::2] for path in HALLWAY)
    images = {"one.png": one, "b/two.png": two, "part.png": one[:, 30:], "b/turned.png": two[::-1]}
    for name, image in images.items():
        cv2.imwrite(str(root / name), image)
    return root


@pytest.fixture(scope="module")
def expected(photos):
    """What `match` and `verify` give, pair by pair."""
    sift = saccade.Sift(JOB.settings)
    points = {
        path.relative_to(photos).as_posix(): sift(saccade.read_image(path))
        for path in sorted(photos.rglob("*.png"))
    }
    found = {}
    for pair in combinations(points, 2):
        indices = saccade.match(*(points[name] for name in pair))
        found[pair] = indices, saccade.verify(*(points[name] for name in pair), indices)
    return points, found


def as_expected(run, expected, pairs=None):
    points, found = expected
    pairs = list(found) if pairs is None else pairs
    assert [each.pair for each in run.matched] == pairs
    for each in run.matched:
        indices, verified = found[each.pair]
        np.testing.assert_array_equal(each.indices, indices)
        np.testing.assert_array_equal(each.verification.inliers, verified.inliers)
        np.testing.assert_equal(each.verification.matrix, verified.matrix)
        first, second = (
            points[name].descriptors[column].astype(float)
            for name, column in zip(each.pair, indices.T, strict=True)
        )
        cosine = (first * second).sum(1) / np.linalg.norm(first, axis=1)
        cosine /= np.linalg.norm(second, axis=1)
        np.testing.assert_allclose(each.similarity, (1 + cosine) / 2, atol=1e-6)
    return True


@pytest.mark.parametrize("workers", [1, *nightly(2)])
def test_all_pairs_are_those_of_match_and_verify(photos, expected, tmp_path, workers, monkeypatch):
    """The images of a pair may be in two blocks."""
    monkeypatch.setattr(extraction, "MIN_BLOCK", 3)
    run = match_images(f"{photos}/**/*", tmp_path, job=JOB, workers=workers)
    assert as_expected(run, expected)
    assert (run.done, run.unchanged, run.complete) == (6, 0, True)
    points = exchange.read_hdf5(run.files["features"])
    assert {name: len(each) for name, each in points.items()} == {
        name: len(each) for name, each in expected[0].items()
    }
    matches = exchange.read_hloc_matches(run.files["matches"])
    for pair, (indices, _) in expected[1].items():
        np.testing.assert_array_equal(matches[group_of(*pair)][0], indices)
    rows = list(csv.DictReader(run.files["table"].read_text().splitlines()))
    assert [(row["first"], row["second"]) for row in rows] == list(expected[1])
    assert [int(row["inliers"]) for row in rows] == [
        each.inliers.sum() for _, each in expected[1].values()
    ]


@pytest.fixture
def listed(tmp_path):
    """A list of two pairs."""
    path = tmp_path / "listed.txt"
    path.write_text("# seen together\nb/two.png one.png\n\none.png part.png\none.png b/two.png\n")
    return path


@pytest.mark.parametrize(
    "file", ["features.h5", pytest.param("database.db", marks=pytest.mark.peer)]
)
def test_features_of_a_file_are_matched_as_those_of_a_detector(run, photos, tmp_path, file):
    """Also for a turned image: stored pixels become upright ones."""
    folder = tmp_path / "photos"
    shutil.copytree(photos, folder)
    upright = Image.open(photos / "one.png")
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    upright.rotate(90, expand=True).save(folder / "turned.jpg", exif=exif, quality=95)
    kind = "hdf5" if file.endswith("h5") else "colmap"
    if kind == "colmap":
        pytest.importorskip("pycolmap", reason="needs pycolmap, of the group `peers`")
    words = ("match", folder, "--max", "200", "--format", kind, "--workers", "1")
    first = json.loads(run(*words, "--json", "--out", tmp_path / "first")[1])
    path = tmp_path / "first" / file
    words = ("match", folder, "--features", path, "--guided", "--workers", "1", "--json", "--out")
    again, third = (json.loads(run(*words, tmp_path / "second")[1]) for _ in range(2))
    assert (again["images"], again["done"], third["done"]) == (5, 10, 0)
    assert again["inliers"] >= first["inliers"]
    matches = exchange.read_hloc_matches(again["files"]["matches"])
    assert len(matches[group_of("one.png", "turned.jpg")][0]) > 100
    if kind == "colmap":
        return
    points = exchange.read_hdf5(path)
    for name, each in exchange.read_hdf5(again["files"]["features"]).items():
        for field, values in vars(each).items():
            np.testing.assert_allclose(values, getattr(points[name], field), atol=1e-6)
    points["b/two.png"].xy[0] = 9999
    del points["one.png"]
    exchange.write_hdf5(tmp_path / "broken.h5", points)
    words = ("match", folder, "--features", tmp_path / "broken.h5", "--workers", "1", "--out")
    code, _, said = run(*words, tmp_path / "third")
    assert code == 1
    assert "2 images failed" in said
    assert "one.png: expected keypoints in the file of features, found none" in said
    assert "b/two.png: expected keypoints in " in said


def test_a_list_is_matched_in_its_order_and_only_that(photos, listed, tmp_path):
    run = match_images(str(photos), tmp_path / "out", pairs=listed, job=JOB)
    pairs = [("b/two.png", "one.png"), ("one.png", "part.png")]
    assert [each.pair for each in run.matched] == read_pairs(run.files["pairs"]) == pairs
    assert run.extraction.images == 3
    (one, two) = (saccade.read_image(photos / name) for name in pairs[0])
    sift = saccade.Sift(JOB.settings)
    np.testing.assert_array_equal(run.matched[0].indices, saccade.match(sift(one), sift(two)))


def test_what_is_done_is_not_done_again(photos, listed, tmp_path):
    """A block of pairs is, where it has other pairs, other settings or other images."""
    folder, out = tmp_path / "photos", tmp_path / "out"
    for path in photos.rglob("*.png"):
        (folder / path.relative_to(photos)).parent.mkdir(parents=True, exist_ok=True)
        (folder / path.relative_to(photos)).write_bytes(path.read_bytes())

    def counts(**options):
        run = match_images(str(folder), out, job=JOB, **{"pairs": listed, **options})
        return run.extraction.done, run.done, run.unchanged

    assert counts() == (3, 2, 0)
    assert counts() == (0, 0, 2)
    more = tmp_path / "more.txt"
    write_pairs(more, [("part.png", "b/two.png"), ("one.png", "part.png")])
    assert counts(pairs=more) == (0, 2, 0)
    assert counts(config=MatchConfig(ratio=0.7)) == (0, 2, 0)
    assert counts() == (0, 0, 2)
    part = cv2.imread(str(folder / "part.png"))
    cv2.imwrite(str(folder / "part.png"), part[:, ::-1])
    assert counts() == (1, 2, 0)
    with pytest.raises(ConfigError, match="made with max_keypoints"):
        match_images(str(folder), out, pairs=listed)


def test_the_command_leaves_out_images_that_fail(run, photos, tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for name in ("one.png", "part.png"):
        (folder / name).write_bytes((photos / name).read_bytes())
    (folder / "bad.png").write_text("no image")
    words = ["match", folder, "--max", 200, "--geometry", "homography", "--workers", 1]
    code, out, err = run(*words, "--json")
    assert code == 1
    assert "1 images failed, and 2 pairs are left out" in err
    row = json.loads(out)
    assert (row["images"], row["pairs"], row["done"], row["verified_pairs"]) == (2, 3, 1, 1)
    assert row["inliers"] > 50
    assert Path(row["files"]["pairs"]).read_text() == "one.png part.png\n"
    code, out, _ = run(*words, "--geometry", "none")
    assert "inliers" not in out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["one.png"], "one.png: expected two images or more, found one"),
        (["absent"], "absent: cannot be read: No such file"),
        (["."], ".: expected images"),
        (["one.png", "--format", "svg"], "expected hdf5 or colmap for many images, found 'svg'"),
        (["one.png", "one.png", "--format", "hdf5"], "expected png or svg or pdf for two images"),
        (["one.png", "one.png", "--pairs", "x"], "--camera-mode and --workers"),
        ([".", "--features", "gone.h5"], "gone.h5: cannot be read"),
        ([".", "--features", "x.h5", "--max", 5], "features: expected no --detector, --preset"),
        (["b", "--guided", "--geometry", "none"], "guided: expected --geometry fundamental"),
        (["b", "--pairs", "absent.txt"], "absent.txt: cannot be read"),
        (["b", "--pairs", "one.txt"], "one.txt, line 2: expected two images, found 'one.png'"),
        (
            ["b", "--pairs", "same.txt"],
            "same.txt, line 1: expected two images, found 'a a'",
        ),
        (["b", "--pairs", "empty.txt"], "empty.txt: expected pairs of images, found none"),
        ([".", "--pairs", "gone.txt"], "gone.txt: expected images of ., found 'x.png', which is"),
    ],
)
def test_what_cannot_be_matched_is_named(run, photos, tmp_path, words, told):
    (tmp_path / "one.png").write_bytes((photos / "one.png").read_bytes())
    (tmp_path / "b").mkdir()
    lists = {
        "one": "a.png b.png\none.png\n",
        "same": "a a",
        "empty": "#",
        "gone": "x.png y.png",
    }
    for name, text in lists.items():
        (tmp_path / f"{name}.txt").write_text(text)
    if words == ["."]:
        (tmp_path / "one.png").unlink()
    code, out, err = run("match", *words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert told in err


def test_names_with_blanks_are_told_apart_by_a_tab(photos, tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "a b.png").write_bytes((photos / "one.png").read_bytes())
    (folder / "c.png").write_bytes((photos / "part.png").read_bytes())
    run = match_images(str(folder), tmp_path / "out", job=JOB)
    assert read_pairs(run.files["pairs"]) == [("a b.png", "c.png")]


def residual(geometry, matrix, first, second):
    """Distance in pixels from the moved point, or from the epipolar line."""
    one, two = (np.c_[xy, np.ones(len(xy))].astype(float) for xy in (first, second))
    moved = one @ matrix.T
    if geometry == "homography":
        return np.linalg.norm(moved[:, :2] / moved[:, 2:] - two[:, :2], axis=1)
    return np.abs((moved * two).sum(1)) / np.hypot(*moved[:, :2].T)


@pytest.mark.peer
@pytest.mark.parametrize("geometry", ["fundamental", "homography"])
def test_colmap_opens_matches_and_two_view_geometries(photos, tmp_path, geometry):
    """In its own pixels, the geometry fits the inliers as in ours."""
    pycolmap = pytest.importorskip("pycolmap") and import_pycolmap()
    config = MatchConfig(geometry=geometry)
    run = match_images(f"{photos}/**/*", tmp_path, job=JOB, config=config, formats=["colmap"])
    assert "features" not in run.files
    points = exchange.read_colmap(run.files["database"]).keypoints
    database = pycolmap.Database.open(run.files["database"])
    verified = 0
    for each in run.matched:
        ids = [database.read_image_with_name(name).image_id for name in each.pair]
        np.testing.assert_array_equal(database.read_matches(*ids), each.indices)
        views = database.read_two_view_geometry(*ids)
        inliers = each.indices[each.verification.inliers]
        np.testing.assert_array_equal(views.inlier_matches.reshape(-1, 2), inliers)
        kinds = pycolmap.TwoViewGeometryConfiguration
        if each.verification.matrix is None:
            assert views.config == kinds.DEGENERATE
            continue
        verified += 1
        theirs = [database.read_keypoints(i)[:, :2] for i in ids]
        ours = [points[name].xy for name in each.pair]
        if geometry == "homography":
            assert views.config in (kinds.PLANAR, kinds.PANORAMIC, kinds.PLANAR_OR_PANORAMIC)
            matrix = views.H
        else:
            assert views.config in (kinds.UNCALIBRATED, kinds.PLANAR, kinds.PANORAMIC)
            matrix = views.F
        residuals = [
            residual(geometry, M, *(xy[k] for xy, k in zip(xys, inliers.T, strict=True)))
            for M, xys in ((matrix, theirs), (each.verification.matrix, ours))
        ]
        np.testing.assert_allclose(*residuals, atol=2e-3)
        assert residuals[0].max() < 10
    database.close()
    assert verified >= 2
