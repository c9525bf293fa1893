"""Odd words on the command line, and odd things where files are expected: one line, and soon."""

import os
from itertools import product

import cv2
import pytest

from fuzz.targets import TARGETS, a_picture
from support.limits import EXAMPLES, limited

READS = {
    "look {}": ("png", "mp4"),
    "look a.png --config {}": ("toml",),
    "detect {}": ("png",),
    "match {} a.png": ("png",),
    "match {} --workers 1": ("png", "txt"),
    "match . --workers 1 --pairs {}": ("txt",),
    "slam {}": ("csv", "npz", "mat", "g2o", "bag"),
    "merge {0} {0} --out there.npz": ("npz",),
    "convert {} there.csv": ("csv", "g2o", "bag"),
    "check {}": ("bag", "npz", "mp4"),
    "check {} --kind rosbag": ("bag",),
    "drive {}": ("npz", "mp4"),
    "extract {} --workers 1": ("png", "txt", "mp4"),
    "convert {} x.h5": ("db",),
    "config {}": ("toml",),
    "evaluate fixations --images . --fixations {}": ("csv", "mat"),
    "evaluate fixations --images {} --fixations fixations.csv": ("png",),
    "evaluate fixations --images . --model {} --fixations fixations.csv": ("npy", "mat"),
    "fit --images . --fixations {}": ("csv", "mat"),
    "look a.png --model {}": ("toml",),
    "evaluate scanpaths --images . --fixations {}": ("csv", "mat"),
    "evaluate scanpaths --images . --fixations fixations.csv --paths-config {}": ("toml",),
    "evaluate features --pairs {}": ("png",),
    "simulate world --config {}": ("toml",),
    "simulate drive --config {}": ("toml",),
}
"""Commands, each with how the names end of what it takes."""
KINDS = ("endless", "nothing", "pipe", "folder", "empty", "holes", "loop")
WRITES = (
    *("detect a.png -o", "match a.png a.png -o", "slam log.csv -o", "convert log.csv", "demo -o"),
    *("simulate world -o", "simulate drive --frames 2 -o"),
)
"""Commands that lack what is to be made."""


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """A folder with something of everything that is no file, under every ending."""
    folder = tmp_path_factory.mktemp("odd")
    cv2.imwrite(str(folder / "a.png"), a_picture())
    TARGETS["log-csv"].make(folder)
    TARGETS["fixations"].make(folder)
    for ending in sorted({each for endings in READS.values() for each in endings}):
        (folder / f"endless.{ending}").symlink_to("/dev/zero")
        (folder / f"nothing.{ending}").symlink_to("/dev/null")
        os.mkfifo(folder / f"pipe.{ending}")
        (folder / f"folder.{ending}").mkdir()
        (folder / f"empty.{ending}").touch()
        (folder / f"holes.{ending}").touch()
        os.truncate(folder / f"holes.{ending}", 1 << 42)
        (folder / f"loop.{ending}").symlink_to(f"loop.{ending}")
    return folder


def ends_well_or_in_one_line(run, *words):
    with limited():
        code, _, err = run(*words)
    assert "Traceback" not in err
    assert code in (0, 1, 2), (words, code, err)
    told = [line for line in err.splitlines() if line.strip()]
    found_problems = code == 1 and words[0] == "check"
    assert code == 0 or found_problems or told[-1].startswith("saccade: "), (words, err)
    assert code != 2 or len(told) == 1, (words, err)
    return code


@pytest.mark.parametrize("number", range(len(READS)), ids=[*READS])
def test_what_is_no_file_is_refused(run, monkeypatch, here, number):
    """Two kinds for each command, each kind for several; all of them where one searches."""
    monkeypatch.chdir(here)
    command, endings = list(READS.items())[number]
    cases = [*product(endings, KINDS)]
    first = number % len(KINDS)
    for ending, kind in cases if EXAMPLES > 12 else cases[first : first + 4 : 3]:
        if (kind, ending) == ("empty", "toml"):
            continue  # all is as it is by default
        code = ends_well_or_in_one_line(run, *command.format(f"{kind}.{ending}").split())
        assert code == 2 or kind == "empty" or command.startswith("extract"), (kind, ending)


@pytest.mark.parametrize("command", WRITES)
def test_a_result_takes_the_place_of_no_pipe(run, monkeypatch, here, command):
    monkeypatch.chdir(here)
    assert ends_well_or_in_one_line(run, *command.split(), "pipe.csv") == 1
    assert (here / "pipe.csv").is_fifo()
