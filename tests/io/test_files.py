"""Input is a file of a size that can be read; output appears whole or not at all."""

import os
import socket

import pytest

from saccade.errors import OutputError
from saccade.io.files import LARGEST_FILE, atomic_write, check_file, read_bytes, read_text
from support.error_checks import refuses
from support.limits import limited


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
