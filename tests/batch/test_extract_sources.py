"""Sources of images: folders, patterns, lists, videos and a bucket."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from pyarrow import fs

from saccade import Sift
from saccade.batch import open_source, storage
from saccade.batch.sources import content_reader
from saccade.errors import SaccadeError
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


def contents(source):
    """Every image of a source by its name, which no other has."""
    assert len({item.name for item in source}) == len(source)
    read = content_reader()
    return {item.name: read(item) for item in source}


def on_disk(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.png")}


def test_folders_and_patterns(folder, monkeypatch):
    every = on_disk(folder) | {"deep/000.png": on_disk(folder)["003.png"]}
    assert contents(open_source(str(folder))) == every
    assert contents(open_source(str(folder), without=f"{folder}/deep")) == on_disk(folder)
    few = [item.name for item in open_source(f"{folder}/00[1-3].png")]
    assert few == ["001.png", "002.png", "003.png"]
    found = contents(open_source(f"{folder}/**/*.png"))
    assert found == every
    assert contents(open_source(f"{folder}/**/*")) == found
    monkeypatch.chdir(folder)
    assert contents(open_source("*.png")) == on_disk(folder)
    assert contents(open_source(".")) == every


def test_a_list_keeps_its_order(folder):
    (folder / "some.txt").write_text(f"# two\n004.png\n{folder}/001.png\n\n004.png\n")
    found = contents(open_source(f"{folder}/some.txt"))
    assert list(found.values()) == [on_disk(folder)[name] for name in ("004.png", "001.png")]
    assert list(found) == ["004.png", f"{str(folder)[1:]}/001.png"]


def test_every_third_frame_of_a_video(folder, tmp_path):
    path = tmp_path / "clip.mp4"
    with video_writer(path, 25) as write:
        for number in range(8):
            write(np.ascontiguousarray(cv2.imread(str(folder / f"{number % 7:03d}.png"))))
    found = contents(open_source(str(path), every=3))
    assert list(found) == [f"clip.mp4/{number:08d}" for number in (0, 3, 6)]
    frames = [frame for _, frame in read_video(path, 3)]
    for each, expected in zip(found.values(), frames, strict=True):
        np.testing.assert_array_equal(each, expected)
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
    system = fs.S3FileSystem(endpoint_override=f"http://{host}:{port}", allow_bucket_creation=True)
    system.create_dir("photographs")
    storage._open_bucket.cache_clear()
    yield system
    server.stop()


def upload(system, name, data):
    with system.open_output_stream(f"photographs/{name}") as stream:
        stream.write(data)


def test_from_a_bucket_into_a_bucket(bucket, folder, tmp_path):
    root = "s3://photographs"
    for name, data in on_disk(folder).items():
        upload(bucket, f"my photos/{name}", data)
    upload(bucket, "my photos/deep/broken.png", b"no image")
    upload(bucket, "list.txt", b"my photos/002.png\ns3://photographs/my photos/001.png\n")
    every = on_disk(folder) | {"deep/broken.png": b"no image"}
    assert contents(open_source(f"{root}/my photos")) == every
    assert [item.name for item in open_source(f"{root}/list.txt")] == [
        "my photos/002.png",
        "photographs/my photos/001.png",
    ]
    anonymous = open_source("s3://anonymous@photographs/my photos/00[1-2].png")
    assert contents(anonymous).keys() == {"001.png", "002.png"}
    out = f"{root}/out"
    first = extract_here(f"{root}/my photos/**/*.png", out)
    assert (first.done, list(first.failed), first.images) == (IMAGES, ["deep/broken.png"], IMAGES)
    again = extract_here(f"{root}/my photos/*.png", out)
    assert (again.done, again.unchanged) == (0, IMAGES)
    upload(bucket, "my photos/003.png", on_disk(folder)["004.png"])
    assert extract_here(f"{root}/my photos/*.png", out).done == 1
    fs.copy_files("photographs/out", str(tmp_path / "out"), source_filesystem=bucket)
    photos = tmp_path / "in"
    photos.mkdir()
    for name, data in on_disk(folder).items():
        (photos / name).write_bytes(data)
    (photos / "003.png").write_bytes(on_disk(folder)["004.png"])
    check_complete(photos, tmp_path / "out")


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("", "found an empty name"),
        ("nowhere", "nowhere: cannot be read: No such file"),
        ("empty", r"empty: expected images \(\.bmp.*\), found none"),
        ("*.jpg", r"\*\.jpg: expected images"),
        ("none.txt", r"none\.txt: cannot be read: No such file"),
        ("nonsense://x", "nonsense://x: cannot be opened"),
        ("photos\udcff", r"expected names in UTF-8"),
    ],
)
def test_a_source_that_cannot_be_opened_is_named(source, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    with pytest.raises(SaccadeError, match=words):
        open_source(source)
