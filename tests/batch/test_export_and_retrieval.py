"""Export of extracted points, and image retrieval."""

import json
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from saccade import Sift, SiftConfig, exchange, read_image
from saccade.batch import Job, index
from saccade.batch.dataset import read_points
from saccade.batch.index import Index, build_index
from saccade.types import Keypoints
from support.extraction import extract_here, photographs
from support.keypoint_files import assert_same

LAP = 40
NEAR = 2
"""Photographs before and after the right one that show the same place."""


@pytest.fixture(scope="module")
def extracted(tmp_path_factory):
    """Some photographs, and a data set of their points."""
    root = tmp_path_factory.mktemp("lookup")
    paths = photographs(root / "photos", 8)
    extract_here(root / "photos", root / "out", Job("sift", SiftConfig(), exact=True))
    return paths, root / "out"


def test_a_data_set_gives_the_points_back(extracted):
    paths, out = extracted
    for path, found in zip(paths, read_points(str(out)), strict=True):
        assert (found.image, found.shape) == (path.name, (64, 96))
        assert_same(found.points, Sift()(read_image(path)))
    whole = exchange.read_parquet(out / "sift")
    assert_same(whole[paths[4].name], Sift()(read_image(paths[4])))


def test_hdf5_and_csv(extracted, run, tmp_path):
    paths, out = extracted
    assert run("convert", out, "x.h5")[0] == 0
    code, printed, _ = run("convert", out, "tables", "--to", "csv", "--json")
    assert (code, json.loads(printed)["images"]) == (0, len(paths))
    for name, points in exchange.read_hdf5(tmp_path / "x.h5").items():
        expected = Sift()(read_image(paths[0].parent / name))
        assert_same(points, expected)
        table = exchange.read_csv(tmp_path / "tables" / f"{name}.csv")
        assert_same(table, expected, ("xy", "size", "angle", "response"))
    with h5py.File(tmp_path / "x.h5") as file:
        np.testing.assert_array_equal(file["000.png/image_size"], [96, 64])


def test_what_holds_no_points_is_named(run, tmp_path):
    code, _, err = run("find", "--in", tmp_path)
    assert code == 2
    assert "expected extracted points, found no manifest.json" in err


def test_a_format_of_keypoints_is_known(extracted, run):
    code, _, err = run("convert", extracted[1], "x.g2o")
    assert code == 2
    assert "--to: expected one of colmap, hdf5, opencv, csv for keypoints, found 'x.g2o'" in err


@pytest.mark.parametrize("small", [True, False])
def test_neighbors_are_those_of_a_search_through_all(rng, tmp_path, monkeypatch, small):
    """With cells, nearly always."""
    if not small:
        monkeypatch.setattr(index, "EXHAUSTIVE_BELOW", 0)
    images = {
        f"{number}.png": Keypoints(
            *rng.random((1, 100, 2), np.float32),
            *rng.random((3, 100), np.float32),
            np.zeros(100, np.int32),
            rng.integers(0, 256, (100, 128)).astype(np.uint8),
        )
        for number in range(30)
    }
    write_data_set(tmp_path, images)
    assert build_index(tmp_path) == {"images": 30, "points": 3000}
    retrieval = Index(tmp_path)
    assert retrieval.images == list(images)
    for number, points in enumerate(images.values()):
        np.testing.assert_array_equal(retrieval.points_of(number).descriptors, points.descriptors)
        np.testing.assert_array_equal(retrieval.points_of(number).xy, points.xy)
    changed = rng.integers(-4, 5, (100, 128)) + images["17.png"].descriptors
    query = images["17.png"][:]
    query = Keypoints(*list(vars(query).values())[:5], np.clip(changed, 0, 255).astype(np.uint8))
    best = retrieval.find(query, candidates=3)[0]
    assert best.image == "17.png"
    assert best.inliers > 90
    assert retrieval.find(query, candidates=3, exclude="17.png")[0].inliers is None


def write_data_set(folder, images):
    """Points as `extract` would have written them."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from saccade.batch.tables import RECORD_SCHEMA, point_rows

    job = Job("sift", SiftConfig())
    for name in ("sift", "images"):
        (folder / name).mkdir()
    batches = [point_rows(name, points, exact=True) for name, points in images.items()]
    pq.write_table(pa.Table.from_batches(batches), folder / "sift" / "part-0.parquet")
    rows = [
        {"image": name, "rows": len(points), "width": 1, "height": 1}
        for name, points in images.items()
    ]
    pq.write_table(pa.Table.from_pylist(rows, RECORD_SCHEMA), folder / "images" / "part-0.parquet")
    told = {"what": "sift", "configuration": job.describe()}
    (folder / "manifest.json").write_text(json.dumps(told))


def test_find_as_a_person_runs_it(run, tmp_path):
    from importlib.resources import files

    data = files("saccade") / "data"
    (tmp_path / "photos").mkdir()
    for name in ("hallway_2.jpg", "coffee.jpg", "chelsea.jpg", "rocket.jpg"):
        (tmp_path / "photos" / name).write_bytes((data / name).read_bytes())
    assert run("extract", "photos", "--out", "set", "--workers", 1)[0] == 0
    code, printed, err = run("find", data / "hallway_1.jpg", "--in", "set", "--json")
    assert code == 0
    assert "index of 4 images -> set/index" in err
    (found,) = json.loads(printed)["found"]
    assert found["image"] == "hallway_2.jpg"
    assert found["inliers"] > 30
    code, _, err = run("find", data / "camera.jpg", "--in", "set")
    assert code == 1
    assert "none of 4 images shows the same scene" in err
    (tmp_path / "photos" / "camera.jpg").write_bytes((data / "camera.jpg").read_bytes())
    assert run("extract", "photos", "--out", "set", "--workers", 1)[0] == 0
    code, _, err = run("find", data / "camera.jpg", "--in", "set")
    assert code == 2
    assert "expected an index of its 5 images, found one of another state" in err
    assert run("find", "--in", "set", "--json")[1].split()[:3] == ["{", '"images":', "5,"]
    code, printed, _ = run("find", data / "camera.jpg", "--in", "set", "--json")
    assert code == 0
    assert json.loads(printed)["found"][0]["image"] == "camera.jpg"


@pytest.mark.shared
def test_the_hallway_is_recognized_on_the_second_lap(shared, tmp_path):
    """Every second photograph, at half its size; `benchmarks/extract.py` asks for all of them."""
    hallway, photos = shared / "data" / "drives" / "rtabmap_samples_loop", tmp_path / "photos"
    photos.mkdir()
    for path in sorted(hallway.glob("*.jpg"), key=lambda path: int(path.stem))[::2]:
        half = cv2.resize(cv2.imread(str(path)), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(photos / f"{path.stem}.png"), half)
    extract_here(photos, tmp_path / "set")
    build_index(tmp_path / "set")
    retrieval = Index(tmp_path / "set")
    asked = list(read_points(str(tmp_path / "set")))[::2]
    right = sum(is_again(each.image, retrieval.find(each.points, candidates=8)) for each in asked)
    print(f"\n{right} of {len(asked)} photographs of the hallway")
    assert right >= 0.95 * len(asked)


def is_again(name, found):
    """Whether the first image of another lap shows the same place."""
    number = int(Path(name).stem)
    apart = [abs(int(Path(each.image).stem) - number) for each in found if each.inliers]
    others = [each for each in apart if each > LAP / 2]
    return bool(others) and min(others[0] % LAP, -others[0] % LAP) <= NEAR
