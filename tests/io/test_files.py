"""Input is a file of a size that can be read; output appears whole or not at all."""

import os
import socket

import pytest

from saccade.errors import OutputError
from saccade.io.files import (
    LARGEST_FILE,
    atomic_write,
    check_file,
    natural_order,
    read_bytes,
    read_text,
)
from saccade.io.image import find_images
from support.error_checks import refuses
from support.extras import open_source
from support.limits import limited

PIXEL = b"P5 1 1 255 0"
"""An image of one pixel."""


@pytest.mark.parametrize("kind", ["device", "pipe", "socket"])
def test_what_has_no_end_is_no_file(tmp_path, kind):
    path = tmp_path / "odd"
    if kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(str(path))
    for read in (check_file, read_bytes, read_text):
        with refuses(OSError, f"expected a file, found a {kind}"):
            read(path)
    with refuses(OutputError, f"odd: cannot be written: expected a file, found a {kind}"):
        atomic_write(path).__enter__()
    assert [each.name for each in tmp_path.iterdir()] == ["odd"]


def test_a_file_that_is_too_large_is_not_read(tmp_path):
    path = tmp_path / "holes"
    path.touch()
    os.truncate(path, LARGEST_FILE + 1)
    with limited(memory=100 << 20), refuses(OSError, "at most 2,147,483,648 bytes, found"):
        read_bytes(path)


def test_text_is_read_as_it_is(tmp_path):
    (tmp_path / "a.txt").write_bytes(b"\xef\xbb\xbfone\r\ntwo \xc3\xa9\n")
    assert read_text(tmp_path / "a.txt") == "one\r\ntwo é\n"
    with pytest.raises(IsADirectoryError):
        read_text(tmp_path)


def test_a_finished_file_takes_its_name(tmp_path):
    path = tmp_path / "new" / "folder" / "result.txt"
    with atomic_write(path) as temporary:
        temporary.write_text("whole")
        assert not path.exists()
    assert path.read_text() == "whole"
    assert [each.name for each in path.parent.iterdir()] == ["result.txt"]


def test_an_interrupted_write_keeps_the_old_file(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("old")

    def interrupted():
        with atomic_write(path) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old"
    assert [each.name for each in tmp_path.iterdir()] == ["result.txt"]


@pytest.mark.parametrize(
    "names",
    [
        ["frame0.png", "frame2.png", "frame10.png", "frame13.png"],
        ["2/frame9.jpg", "10/frame1.jpg"],
        ["img_9_left.png", "img_10_left.png", "img_10_right.png"],
        ["frame007.png", "frame7.png", "frame08.png"],
        ["1403636579.25.png", "1403636579.5.png", "1403636580.1.png"],
        ["cam0.9.png", "cam0.10.png", "cam1.2.png"],
        ["9" * 30 + ".png", "1" + "0" * 30 + ".png"],
        ["a.png", "b1.png", "b2.png"],
    ],
)
def test_names_are_sorted_by_their_numbers(tmp_path, names):
    assert sorted(sorted(names), key=natural_order) == names
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(PIXEL)
    pattern = "*/*.jpg" if "/" in names[0] else "*.png"
    expected = [str(tmp_path / name) for name in names]
    assert list(map(str, find_images(tmp_path / pattern))) == expected
    assert [each.location for each in open_source(str(tmp_path / pattern))] == expected


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_text_in_the_encodings_of_other_programs(tmp_path, encoding):
    (tmp_path / "a.txt").write_text("Größe\r\n1 °\n", encoding=encoding, newline="")
    assert read_text(tmp_path / "a.txt") == "Größe\r\n1 °\n"


@pytest.mark.parametrize("data", [b"\xff\xfe1", b"\x811", "1 2".encode("utf-16-le"), bytes(9)])
def test_other_bytes_are_no_text(tmp_path, data):
    (tmp_path / "a.txt").write_bytes(data)
    with refuses(OSError, "expected text in UTF-8", "save it as UTF-8"):
        read_text(tmp_path / "a.txt")
