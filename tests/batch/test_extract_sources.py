"""Where images may be: folders, patterns, lists, tars, videos, memory and a bucket."""

import json
import tarfile
from pathlib import Path

import cv2
import fsspec
import numpy as np
import pyarrow.parquet as pq
import pytest

from saccade import Sift
from saccade.batch import open_source
from saccade.batch.sources import read_content
from saccade.errors import ImageError
from saccade.io.video import read_video, video_writer
from support.extraction import check_complete, check_whole, extract_here, photographs

IMAGES = 7


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("sources") / "photos"
    photographs(path, IMAGES)
    (path / "deep").mkdir()
    (path / "deep" / "000.png").write_bytes((path / "003.png").read_bytes())
    (path / "notes.md").write_text("no image")
    return path


def names(source):
    return [source[number].name for number in range(len(source))]


def contents(source):
    """Every image of a source by its name, which no other has."""
    assert len(set(names(source))) == len(source)
    return {name: read_content(source[n]) for n, name in enumerate(names(source))}


def on_disk(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.png")}


def test_a_folder(folder):
    assert contents(open_source(str(folder))) == on_disk(folder)


def test_a_pattern_goes_as_deep_as_it_says(folder, monkeypatch):
    assert names(open_source(f"{folder}/00[1-3].png")) == ["001.png", "002.png", "003.png"]
    found = contents(open_source(f"{folder}/**/*.png"))
    assert found == on_disk(folder) | {"deep/000.png": on_disk(folder)["003.png"]}
    assert contents(open_source(f"{folder}/**/*")) == found
    monkeypatch.chdir(folder)
    assert contents(open_source("*.png")) == on_disk(folder)


def test_a_list_keeps_its_order(folder, tmp_path):
    (folder / "some.txt").write_text(f"# two\n004.png\n{folder}/001.png\n\n004.png\n")
    found = contents(open_source(f"{folder}/some.txt"))
    assert list(found.values()) == [on_disk(folder)[name] for name in ("004.png", "001.png")]
    assert list(found) == ["004.png", f"{str(folder)[1:]}/001.png"]


@pytest.mark.parametrize("scheme", ["", "memory://"])
def test_tars_are_read_where_they_lie(folder, tmp_path, scheme):
    expected = {}
    for number in range(2):
        path = tmp_path / f"train-{number}.tar"
        with tarfile.open(path, "w") as archive:
            for name in ("005.png", "002.png"):
                archive.add(folder / name, f"./{number}{name}")
                archive.add(folder / "notes.md", f"{number}{name}.txt")
                expected[f"{path.name}/{number}{name}"] = on_disk(folder)[name]
        fsspec.filesystem("memory").pipe(f"/tars/{path.name}", path.read_bytes())
    root = "memory://tars" if scheme else tmp_path
    assert contents(open_source(f"{root}/train-*.tar")) == expected
    (tmp_path / "notes.tar").write_bytes((folder / "notes.md").read_bytes() * 200)
    with pytest.raises(ImageError, match=r"notes\.tar: expected a tar"):
        open_source(str(tmp_path / "notes.tar"))


def test_every_third_frame_of_a_video(folder, tmp_path):
    path = tmp_path / "clip.mp4"
    with video_writer(path, 25) as write:
        for number in range(8):
            write(np.ascontiguousarray(cv2.imread(str(folder / f"{number % 7:03d}.png"))))
    source = open_source(str(path), every=3)
    assert names(source) == [f"clip.mp4/{number:08d}" for number in (0, 3, 6)]
    frames = [frame for _, frame in read_video(path, 3)]
    for found, expected in zip(contents(source).values(), frames, strict=True):
        np.testing.assert_array_equal(found, expected)
    out = tmp_path / "out"
    extract_here(path, out)
    rows = check_whole(out)
    assert len(rows) == 8
    assert len(rows["clip.mp4/00000003"]) == len(Sift()(frames[1]))


@pytest.fixture
def bucket(monkeypatch):
    """A bucket of a server that speaks S3, on this machine."""
    server = pytest.importorskip("moto.server").ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():
        monkeypatch.setenv(name, value)
    system = fsspec.filesystem("s3", skip_instance_cache=True)
    system.mkdir("photographs")
    yield "s3://photographs"
    server.stop()


@pytest.mark.parametrize("kind", ["memory", "s3"])
def test_from_a_bucket_into_a_bucket(kind, folder, tmp_path, request):
    root = request.getfixturevalue("bucket") if kind == "s3" else "memory://photographs"
    system, path = fsspec.url_to_fs(root)
    for name, data in on_disk(folder).items():
        system.pipe(f"{path}/in/{name}", data)
    system.pipe(f"{path}/in/broken.png", b"no image")
    assert contents(open_source(f"{root}/in/*.png")).keys() == {*on_disk(folder), "broken.png"}
    first = extract_here(f"{root}/in", f"{root}/out")
    assert (first.done, first.failed, first.totals.errors) == (IMAGES, 1, 1)
    system.rm(f"{path}/in/broken.png")
    again = extract_here(f"{root}/in", f"{root}/out")
    assert (again.done, again.unchanged) == (0, IMAGES)
    system.get(f"{path}/out/", f"{tmp_path}/out/", recursive=True)
    (tmp_path / "in").mkdir()
    for name, data in on_disk(folder).items():
        (tmp_path / "in" / name).write_bytes(data)
    check_complete(tmp_path / "in", tmp_path / "out")


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("", "found an empty name"),
        ("nowhere", "nowhere: cannot be read: No such file"),
        ("empty", r"empty: expected images .*; for those of its folders: 'empty/\*\*/\*\.jpg'"),
        ("*.jpg", r"\*\.jpg: expected images"),
        ("nonsense://x", "nonsense://x: cannot be opened"),
        ("memory://none", "memory://none: cannot be read"),
    ],
)
def test_a_source_that_is_none_is_named(source, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    with pytest.raises(ImageError, match=words):
        open_source(source)


ODD = "bild-\udcff.png"
"""What Python calls a file whose name ends in a byte that is not UTF-8."""


def column(path, name):
    with path.open("rb") as file:  # Arrow's paths are text
        return pq.read_table(file)[name].to_pylist()


def test_a_name_that_is_no_text_ends_nothing(run, tmp_path):
    source = "photos\udcfe/*.png"
    folder = tmp_path / source.partition("/")[0]
    photographs(tmp_path / "made", 3)
    (tmp_path / "made").rename(folder)
    (folder / "001.png").rename(folder / ODD)
    words = ("extract", source, "--out", "out\udcfd", "--workers", 1, "--json")
    code, printed, err = run(*words)
    assert (code, err) == (0, "")
    assert json.loads(printed)["done"] == 3
    out = tmp_path / "out\udcfd"
    assert sorted(column(next((out / "images").iterdir()), "image")) == [
        "000.png",
        "002.png",
        r"bild-\xff.png",
    ]
    code, printed, _ = run(*words)
    assert (code, json.loads(printed)["already_done"]) == (0, 3)
    (folder / ODD).write_text("no image")
    code, printed, err = run(*words)
    assert (code, json.loads(printed)["errors"]) == (1, 1)
    (told,) = column(out / "errors.parquet", "error")
    assert r"bild-\xff.png: expected an image" in told


def test_names_that_would_be_one_are_refused(run, tmp_path):
    photos = photographs(tmp_path / "photos", 2)
    photos[0].rename(photos[0].with_name(ODD))
    photos[1].rename(photos[1].with_name(r"bild-\xff.png"))
    code, _, err = run("extract", "photos", "--workers", 1)
    assert (code, len(err.splitlines())) == (2, 1)
    assert r"photos/bild-\xff.png: expected one file of this name" in err
