"""Bombs, loops, names, and disks that are full or closed: one clear line, and nothing half done."""

import os
import resource
import signal
import struct
import zipfile
from importlib.resources import files
from io import BytesIO

import cv2
import h5py
import numpy as np
import pytest

from fuzz.targets import TARGETS
from saccade import exchange, read_image
from saccade.datasets import load
from saccade.errors import ImageError, KeypointsError, LogError, OutputError
from saccade.io.video import video_writer
from support.error_checks import refuses
from support.limits import limited
from support.pictures import png
from support.privileges import without_privileges
from support.processes import run_python

NAME = "no text \"quo'te\n[b]Ünï-漢字-العربية[i]%s{0}<script>"
HUGE = 65_000
MAIN = "from saccade.cli import main; main()"


def jpeg(side):
    """A small one that says it is large."""
    data = bytearray(cv2.imencode(".jpg", np.zeros((16, 16, 3), np.uint8))[1].tobytes())
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = struct.pack(">HH", side, side)
    return bytes(data)


def tiff(side):
    """A small one that says it is large."""
    data = bytearray(cv2.imencode(".tif", np.zeros((16, 16), np.uint8))[1].tobytes())
    (start,) = struct.unpack("<I", data[4:8])
    (entries,) = struct.unpack("<H", data[start : start + 2])
    for at in range(start + 2, start + 2 + 12 * entries, 12):
        if struct.unpack("<H", data[at : at + 2])[0] in (256, 257, 278):
            data[at + 2 : at + 12] = struct.pack("<HII", 4, 1, side)
    return bytes(data)


@pytest.mark.parametrize(
    ("name", "data"),
    [("a.png", png(HUGE, 3)), ("a.jpg", jpeg(HUGE)), ("a.tif", tiff(HUGE))],
)
def test_an_image_that_says_it_is_huge(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    with limited(memory=100 << 20), pytest.raises(ImageError, match=name):
        read_image(tmp_path / name)


def test_a_chunk_that_says_it_is_huge(tmp_path):
    """OpenCV would take 2 GB for it."""
    whole = png(16, 16)
    cut = whole.index(b"IDAT") - 4
    (tmp_path / "a.png").write_bytes(whole[:cut] + b"\x7f\xff\xff\xf0" + whole[cut + 4 :])
    with limited(memory=100 << 20), refuses(ImageError, "a.png: the image is cut short"):
        read_image(tmp_path / "a.png")


def test_an_image_that_is_huge_is_not_unpacked(tmp_path):
    """289 million pixels in 1.3 MB: OpenCV alone would unpack them to find out."""
    (tmp_path / "bomb.png").write_bytes(png(17_000, 17_000))
    done = run_python(
        *("-c", MAIN, "look", "bomb.png"),
        cwd=tmp_path,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        prepare=lambda: resource.setrlimit(resource.RLIMIT_DATA, (1 << 29, 1 << 29)),
    )
    assert done.returncode == 2
    assert "bomb.png: expected at most 268,435,456 pixels" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def npz(path, shape, content=b"", size=0):
    """An .npz whose array says its shape and holds some bytes, or so many zeros."""
    header = BytesIO()
    told = {"descr": "<f4", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, told)
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("xy.npy", "w") as f,
    ):
        f.write(header.getvalue() + content)
        for _ in range(size >> 24):
            f.write(b"\0" * (1 << 24))


@pytest.mark.parametrize("shape", [(HUGE, HUGE), (1 << 62, 2), (1 << 40, 1 << 40)])
def test_an_array_that_says_it_is_huge(tmp_path, shape):
    npz(tmp_path / "a.npz", shape, b"\0" * 100)
    with limited(memory=100 << 20):
        with refuses(KeypointsError, "a.npz: expected a NumPy .npz file"):
            exchange.read_npz(tmp_path / "a.npz")
        with refuses(LogError, "a.npz: expected an .npz of tables"):
            load("mrclam", tmp_path / "a.npz")


def test_an_archive_that_unpacks_to_too_much(tmp_path, monkeypatch):
    monkeypatch.setattr("saccade.io.npz.MAX_UNPACKED", 1 << 20)
    npz(tmp_path / "a.npz", (1 << 22, 2), size=1 << 25)
    with limited(memory=100 << 20), refuses(KeypointsError, "a.npz", "bytes that unpack to"):
        exchange.read_npz(tmp_path / "a.npz")


def test_an_array_of_objects_is_not_unpickled(tmp_path):
    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "sprung"),)

    np.savez(tmp_path / "a.npz", xy=np.array([Trap()], object))
    for read in (exchange.read_npz, lambda path: load("mrclam", path)):
        with pytest.raises((KeypointsError, LogError), match="Object arrays"):
            read(tmp_path / "a.npz")
    assert not (tmp_path / "sprung").exists()


def test_features_that_unpack_to_too_much(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        shape = (1 << 28, 2)
        file.create_dataset("a.png/keypoints", shape, "f4", compression="gzip", fillvalue=0)
    with limited(memory=100 << 20), refuses(KeypointsError, "a.h5", "bytes that unpack to"):
        exchange.read_hdf5(tmp_path / "a.h5")


def test_a_view_in_the_place_of_a_table(tmp_path):
    import sqlite3

    TARGETS["colmap"].make(tmp_path)
    with sqlite3.connect(tmp_path / "points.db") as database:
        database.execute("DROP TABLE keypoints")
        database.execute(
            "CREATE VIEW keypoints AS WITH RECURSIVE n(image_id) AS (SELECT 1 UNION ALL "
            "SELECT image_id + 1 FROM n) SELECT image_id, 0 AS rows, 1 AS cols, NULL AS data FROM n"
        )
    database.close()
    with limited(), refuses(KeypointsError, "points.db", "expected the table keypoints"):
        exchange.read_colmap(tmp_path / "points.db")


@pytest.fixture
def photo():
    hallway = cv2.imread(str(files("saccade") / "data" / "hallway_1.jpg"))
    return cv2.resize(hallway, (160, 120))


def test_any_name_will_do(run, tmp_path, photo):
    folder = tmp_path / NAME
    folder.mkdir()
    image, log = folder / f"{NAME}.png", folder / f"{NAME}.csv"
    cv2.imencode(".png", photo)[1].tofile(image)
    TARGETS["log-csv"].make(folder)
    (folder / "log.csv").rename(log)
    for words in (
        ["look", image, "-o", folder / "out", "--json"],
        ["detect", image, "-o", folder / "out", "-f", "npz", "-f", "hdf5"],
        ["match", image, image, "-o", folder / "out"],
        ["slam", log, "-o", folder / "out"],
        ["convert", log, folder / f"{NAME}.g2o"],
    ):
        code, _, err = run(*words)
        assert code == 0, err
    assert len(exchange.read_npz(folder / "out" / f"{NAME}.keypoints.npz")) > 20
    code, _, err = run("look", folder / "missing.png")
    assert code == 2
    assert "missing.png" in err


WORLD = ["simulate", "world", "-o", "out"]
EXTRACT = ["extract", "photos", "--what", "sift", "--out", "out", "--workers", "1"]


@pytest.mark.parametrize(("what", "words"), [("full", EXTRACT), ("closed", WORLD)], ids=str)
def test_a_disk_that_takes_nothing(tmp_path, photo, what, words):
    (tmp_path / "photos").mkdir()
    cv2.imwrite(str(tmp_path / "photos" / "a.png"), photo)
    out = tmp_path / "out"
    out.mkdir(mode=0o555 if what == "closed" else 0o755)
    prepare = without_privileges if what == "closed" else full
    done = run_python("-c", MAIN, *words, cwd=tmp_path, prepare=prepare)
    err = done.stderr
    assert done.returncode == 1, err
    assert "out" in err.splitlines()[-1]
    assert "Traceback" not in err
    written = [path for path in out.rglob("*") if path.is_file() and path.stat().st_size > 0]
    assert not [path for path in written if path.name.startswith(".saccade")]


def full():
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))


def test_a_video_on_a_full_disk(tmp_path):
    """OpenCV says nothing."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    noise = np.random.default_rng(5).integers(0, 256, (3, 240, 320, 3)).astype(np.uint8)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        with (
            refuses(OutputError, "film.mp4: cannot be written: the video is cut short"),
            video_writer(tmp_path / "film.mp4", 10) as write,
        ):
            for frame in noise:
                write(frame)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
