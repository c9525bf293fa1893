"""`saccade detect` and `saccade match` as a person runs them."""

import csv
import json
from importlib.resources import files
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

import saccade
from saccade import exchange
from support.keypoint_files import assert_same
from support.pictures import looks_like_a_picture

DATA = Path(str(files("saccade") / "data"))
HALLWAY = (DATA / "hallway_1.jpg", DATA / "hallway_2.jpg")


def rows_of(table):
    with Path(table).open() as lines:
        return list(csv.DictReader(lines))


@pytest.mark.parametrize("command", ["detect", "look"])
def test_a_name_that_is_too_long_for_results_loses_that_image_alone(run, tmp_path, command):
    (tmp_path / "in").mkdir()
    small = cv2.resize(cv2.imread(str(HALLWAY[0])), (160, 120), interpolation=cv2.INTER_AREA)
    for name in ("x" * 250, "z"):
        cv2.imwrite(str(tmp_path / "in" / f"{name}.jpg"), small)
    code, _, err = run(command, tmp_path / "in", "--out", tmp_path / "out")
    assert code == 1
    assert "File name too long" in err
    assert "1 of 2 images left out" in err
    assert {path.name[:2] for path in (tmp_path / "out").iterdir()} >= {"z."}


def test_detect_writes_every_format(run):
    words = [word for each in ("npz", "csv", "hdf5") for word in ("--format", each)]
    code, out, _ = run("detect", *HALLWAY, *words, "--max", 40, "--json")
    assert code == 0
    result = json.loads(out)
    sift = saccade.Sift(saccade.SiftConfig(max_keypoints=40))
    expected = {path.name: sift(saccade.read_image(path)) for path in HALLWAY}
    hdf5 = exchange.read_hdf5(result["files"]["hdf5"])
    for row, (name, points) in zip(result["images"], expected.items(), strict=True):
        assert_same(hdf5[name], points)
        assert_same(exchange.read_npz(row["arrays"]), points)
        assert [np.float32(each["x"]) for each in rows_of(row["table"])] == list(points.xy[:, 0])
    with h5py.File(result["files"]["hdf5"]) as file:
        np.testing.assert_array_equal(
            file["hallway_1.jpg/image_size"], cv2.imread(str(HALLWAY[0])).shape[1::-1]
        )


def test_images_are_named_from_the_folder_that_holds_them_all(run, tmp_path):
    for place in ("photos/a/photo.png", "photos/b/photo.png"):
        (tmp_path / place).parent.mkdir(parents=True)
        cv2.imwrite(str(tmp_path / place), np.eye(64, dtype=np.uint8) * 255)
    run("detect", "photos/a", "photos/b", "--format", "hdf5", "--out", "out")
    assert list(exchange.read_hdf5("out/keypoints.h5")) == ["a/photo.png", "b/photo.png"]


def test_nothing_is_written_where_the_only_image_is_bad(run, tmp_path):
    (tmp_path / "bad.jpg").write_text("no image")
    assert run("detect", "bad.jpg", "--format", "hdf5", "--out", "out")[0] == 2
    assert not (tmp_path / "out").exists()


def test_match_lists_inliers_of_the_epipolar_geometry(run):
    code, out, _ = run("match", *HALLWAY, "--json")
    assert code == 0
    result = json.loads(out)
    assert looks_like_a_picture(result["picture"])
    rows = rows_of(result["table"])
    assert len(rows) == result["matches"] > 30
    places = np.array([[float(row[k]) for k in ("x1", "y1", "x2", "y2")] for row in rows])
    inlier = np.array([row["inlier"] == "1" for row in rows])
    assert inlier.sum() == result["inliers"] > 0.6 * len(rows)
    assert result["geometry"] == "fundamental"
    first, second = (np.c_[each, np.ones(len(rows))] for each in (places[:, :2], places[:, 2:]))
    lines = first @ np.array(result["matrix"]).T
    miss = np.abs((lines * second).sum(axis=1)) / np.hypot(lines[:, 0], lines[:, 1])
    assert np.percentile(miss[inlier], 95) < 2.5
    assert np.median(miss[~inlier]) > 3
    # A plain RANSAC of another make tells them apart alike.
    _, theirs = cv2.findFundamentalMat(places[:, :2], places[:, 2:], cv2.FM_RANSAC, 2.0, 0.999)
    assert ((theirs.ravel() != 0) == inlier).mean() > 0.85


def test_images_that_share_nothing(run, tmp_path):
    for number in (1, 2):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((50, 60), 77, np.uint8))
    code, out, _ = run("match", "1.png", "2.png", "--json")
    assert code == 0
    result = json.loads(out)
    assert result["matches"] == result["inliers"] == 0
    assert result["matrix"] is None
    assert "inlier" in Path(result["table"]).read_text()
    result = json.loads(run("match", "1.png", "2.png", "--geometry", "none", "--json")[1])
    assert "inliers" not in result
    assert "inlier" not in Path(result["table"]).read_text()
