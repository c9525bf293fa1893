"""Whatever a file holds, it is read or refused in one line: soon, and in little memory.

The files are the same in every run; `FUZZ_EXAMPLES=1000 uv run pytest --hypothesis-profile random
tests/test_fuzz.py` looks longer, and at others. `tests/fuzz/run.py` lets what the code does with
a file guide how it is broken.
"""

from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fuzz.mutations import broken
from fuzz.run import QUICK
from fuzz.targets import TARGETS
from support.error_checks import result_or_refusal
from support.limits import EXAMPLES, TIMEOUT, limited
from support.processes import run_python

RUN = Path(__file__).parent / "fuzz" / "run.py"
COMMANDS = {
    "look": ("bmp", "look {0}/a.bmp --json"),
    "detect": ("jpeg", "detect {0}/a.jpg -f npz -f csv"),
    "match": ("tiff", "match {0}/a.tif {0}/a.tif"),
    "match-pairs": ("pairs", "match {0} --pairs {0}/pairs.txt --workers 1"),
    "slam": ("log-csv", "slam {0}/log.csv --json"),
    "convert": ("g2o", "convert {0}/log.g2o there.csv"),
    "check": ("kitti-odometry", "check {0}"),
    "drive": ("folder-times", "drive {0}"),
    "extract": ("list", "extract {0}/photos.txt --what sift --out there --workers 1"),
    "manifest": ("manifest", "convert {0}/out there --to csv"),
    "export": ("points-table", "convert {0}/out there --to csv"),
    "settings": ("settings", "look {0}/sift.toml --config {0}/sift.toml"),
    "fixations": ("fixations", "evaluate fixations --images {0} --fixations {0}/fixations.csv"),
    "scanpaths": ("fixations", "evaluate scanpaths --images {0} --fixations {0}/fixations.csv"),
    "features": ("homography", "evaluate features --pairs {0} --detector opencv"),
    "trajectory": ("tum-poses", "evaluate trajectory {0}/poses.txt --truth {0}/poses.txt"),
    "world": ("world", "simulate world --config {0}/world.toml"),
    "simulate": ("drive-settings", "simulate drive --config {0}/drive.toml --frames 2"),
    "bag": ("rosbag1", "check {0}/way.bag"),
}
"""By name: the target whose file is broken, and a command that reads it."""


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    """A folder with a good input for every target."""
    folder = tmp_path_factory.mktemp("seeds")
    for name, target in TARGETS.items():
        (folder / name).mkdir()
        target.make(folder / name)
    return folder


@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck))
@given(chance=st.randoms(use_true_random=True))
def test_a_broken_file_is_read_or_refused(seeds, name, chance):
    target, folder = TARGETS[name], seeds / name
    good = (folder / target.file).read_bytes()
    bad = broken(target.file, good, Random(chance.random()))
    (folder / target.file).write_bytes(bad)
    try:
        with limited():
            result_or_refusal(lambda: target.read(folder))
    finally:
        (folder / target.file).write_bytes(good)


@pytest.mark.parametrize("name", COMMANDS)
@settings(max_examples=max(EXAMPLES // 6, 1), suppress_health_check=list(HealthCheck))
@given(chance=st.randoms(use_true_random=True))
def test_a_command_ends_well_or_in_one_line(run, seeds, name, chance):
    target, words = TARGETS[COMMANDS[name][0]], COMMANDS[name][1]
    folder = seeds / COMMANDS[name][0]
    good = (folder / target.file).read_bytes()
    (folder / target.file).write_bytes(broken(target.file, good, Random(chance.random())))
    try:
        with limited():
            code, _, err = run(*words.format(folder).split())
    finally:
        (folder / target.file).write_bytes(good)
    assert code in (0, 1, 2), err
    assert code != 2 or "saccade: " in err
    assert "Traceback" not in err


def test_the_targets_of_the_search_exist():
    assert set(QUICK) <= set(TARGETS)


@pytest.mark.nightly
def test_files_broken_as_coverage_guides():
    pytest.importorskip("atheris")
    words = ["--seconds", TIMEOUT, "--runs", 240, "--seed", 1]
    done = run_python(RUN, "npz", "camera-toml", *words, timeout=2 * TIMEOUT)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("\nDone ") == 2


@pytest.mark.parametrize("name", TARGETS)
def test_what_is_broken_was_whole(seeds, name):
    TARGETS[name].read(seeds / name)
