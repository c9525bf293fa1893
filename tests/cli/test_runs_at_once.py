"""Two runs do not write to one folder, and one that is killed leaves what was there before."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

import saccade
from saccade.io.files import atomic_write, results_in
from support.limits import TIMEOUT

DATA = Path(saccade.__file__).parent / "data"
PHOTOS = DATA / "hallway_1.jpg", DATA / "hallway_2.jpg"
WRITER = """
import sys
from pathlib import Path
from saccade.io.files import atomic_write, results_in
out = Path(sys.argv[1])
with results_in(out):
    with atomic_write(out / "log.csv") as file:
        file.write_text("new")
    with atomic_write(out / "truth.tum") as file:
        print("ready", flush=True)
        sys.stdin.read()
"""
"""A run that has written one file and a half, and waits."""


def begin(path):
    """A process in the middle of writing its results."""
    command = [sys.executable, "-c", WRITER, str(path)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout.readline().strip() == b"ready"
    return process


@pytest.fixture(scope="module")
def busy(tmp_path_factory):
    """A folder that another process writes to."""
    out = tmp_path_factory.mktemp("busy") / "out"
    process = begin(out)
    yield out
    process.kill()
    process.communicate(timeout=TIMEOUT)


@pytest.mark.parametrize(
    "words",
    [
        ("look", PHOTOS[0]),
        ("extract", PHOTOS[0], "--workers", 1),
        ("match", *PHOTOS),
        ("slam", DATA / "victoria_park.txt"),
        ("drive", "frames"),
        ("simulate", "world"),
    ],
    ids=lambda words: words[0],
)
def test_a_folder_that_another_run_writes_to_is_refused(run, tmp_path, busy, words):
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "0.jpg").write_bytes(PHOTOS[0].read_bytes())
    code, out, err = run(*words, "--out", busy)
    assert (code, out) == (2, "")
    expected = "another run writes to it; wait until it has ended, or choose another output"
    assert err.splitlines()[-1] == f"saccade: {busy}: {expected}"
    assert {path.name for path in busy.iterdir()} == {".partial", ".saccade-lock"}


def test_a_killed_run_leaves_what_was_there_and_the_next_one_removes_its_rest(tmp_path):
    out = tmp_path / "out"
    with results_in(out):
        for name in ("log.csv", "truth.tum"):
            with atomic_write(out / name) as file:
                file.write_text("old")
            assert not (out / name).exists()
    before = sorted(tmp_path.rglob("*"))
    process = begin(out)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=TIMEOUT)
    assert {path.read_text() for path in before if path.is_file()} == {"old"}
    assert len(list(tmp_path.rglob("*"))) > len(before)
    with results_in(out):
        pass
    assert sorted(tmp_path.rglob("*")) == before


def test_a_failed_run_leaves_nothing(tmp_path):
    def fail():
        with results_in(tmp_path / "out"):
            with atomic_write(tmp_path / "out" / "first.txt") as file:
                file.write_text("whole")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert not list(tmp_path.iterdir())
