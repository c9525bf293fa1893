"""Machines without a home, a network, a second core, a place to write to, or much else.

Where the compiler is off, see `test_packaging` and `test_architecture`; where it has no cache,
`test_architecture`.
"""

import json
import os
import re
import sys
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest

from saccade.cli import TRACEBACK
from support import hostile_environments
from support.hostile_environments import COMMANDS, ENVIRONMENTS, EXITS, all_commands
from support.limits import EXAMPLES, TIMEOUT
from support.privileges import without_privileges
from support.processes import run_python

OFFLINE = """
import sys

def refuse(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "socket.gethostbyname"):
        raise RuntimeError(f"{event}: {arguments}")

sys.addaudithook(refuse)
"""
TESTS = Path(__file__).parent
MAIN = "from saccade.cli import main; main()"


@pytest.fixture
def look(run, tmp_path):
    """`look` in a process of its own prints what it prints in this one, and no complaint."""
    pixels = np.random.default_rng(7).integers(0, 256, (24, 32, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "photo.png"), pixels)
    words = ["look", "photo.png", "--json"]
    code, expected, _ = run(*words)
    assert code == 0

    def call(before="", prepare=None, **environment):
        settings = {**os.environ, **environment}
        done = run_python(
            *("-c", f"{before}\n{MAIN}", *words),
            cwd=tmp_path,
            env={name: value for name, value in settings.items() if value is not None},
            prepare=prepare,
        )
        assert done.returncode == 0, done.stderr
        assert not [line for line in done.stderr.splitlines() if "compiling" not in line]
        assert json.loads(done.stdout) == json.loads(expected)

    return call


@pytest.mark.skipif(sys.platform != "linux", reason="cores and permissions as Linux has them")
def test_no_network_one_core_and_a_home_that_cannot_be_written(look, tmp_path):
    (core, *_) = os.sched_getaffinity(0)
    (tmp_path / "home").mkdir(mode=0o555)

    def prepare():
        os.sched_setaffinity(0, {core})
        without_privileges()

    odd = dict.fromkeys(("OPENBLAS_NUM_THREADS", "NUMBA_THREADING_LAYER", "TZ"), "nonsense")
    files = dict.fromkeys(("NUMBA_CACHE_DIR", "MPLCONFIGDIR", "TMPDIR"), tmp_path / "photo.png")
    nowhere = dict.fromkeys(("XDG_CACHE_HOME", "XDG_CONFIG_HOME"))
    home = str(tmp_path / "home" / "missing")
    look(OFFLINE, prepare, OMP_NUM_THREADS="0", HOME=home, **nowhere, **odd, **files)


LIBRARIES = {"no-h5py": ("convert --to",), "no-faiss": ("find",), "no-starlette": ("serve",)}
"""Commands that go by an optional library, by the environment without it."""
OFTEN = {
    "bytes": ("find --in", "slam"),
    "full-disk": ("convert --to", "find --in"),
    "full": ("config", "look"),
}
"""Commands that once did not withstand an environment."""
USUAL = ("look", "slam")
"""Commands of every other environment, in turn."""


def cases():
    """Pairs of an environment and a command: a few of each, or all where many are asked for."""
    if EXAMPLES > 12:
        return list(product(ENVIRONMENTS, COMMANDS))
    machines = [each for each in ENVIRONMENTS if each[:3] != "no-"]
    usual = {each: USUAL[i % 2 :][:1] for i, each in enumerate(machines)}
    found = usual | {"bare": ("extract", "find")} | OFTEN | LIBRARIES
    return [(environment, name) for environment, names in found.items() for name in names]


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A folder with inputs, and by environment and command: exit code, stdout and stderr."""
    folder = tmp_path_factory.mktemp("hostile")
    done = run_python(
        *("-m", hostile_environments.__name__, folder),
        env={
            **os.environ,
            "PYTHONPATH": str(TESTS),
            "OMP_NUM_THREADS": "1",
        },  # forks have one thread
        stdin=json.dumps(cases()),
        timeout=TIMEOUT * max(1, EXAMPLES // 20),
    )
    assert done.returncode == 0, done.stderr
    results = json.loads((folder / "results.json").read_text())
    return folder, dict(zip(cases(), results, strict=True))


def test_no_command_is_forgotten():
    assert set(all_commands()) == {command.split(" --")[0] for command in COMMANDS}


@pytest.mark.parametrize("environment", dict(cases()))
def test_no_environment_ends_in_a_traceback(hostile, environment):
    for (where, command), (code, _, err) in hostile[1].items():
        if where == environment:
            assert code in (0, 1, 2), (command, code, err)
            assert "Traceback" not in err, (command, err)
            assert TRACEBACK not in err, (command, err)  # what nobody foresaw
            assert "Warning" not in err, (command, err)
            told = re.fullmatch(r"saccade: [^\n]+\n", err)
            assert code != 2 or told or environment == "all-closed", (command, err)


def test_a_library_that_is_missing_is_named_with_the_extra_that_brings_it(hostile):
    for environment, commands in LIBRARIES.items():
        for command in commands:
            code, _, err = hostile[1][environment, command]
            library = environment.removeprefix("no-")
            assert code == 2, (environment, command, err)
            assert f": needs {library}, which is not installed; " in err
    for command in ("extract", "find"):
        assert "parquet: needs pyarrow" in hostile[1]["bare", command][2]


def test_what_cannot_be_printed_is_told(hostile):
    full = {command: each for (where, command), each in hostile[1].items() if where == "full"}
    for command, (code, _, err) in full.items():
        if command not in EXITS:
            assert code == 1, command
            assert err.endswith("saccade: standard output: No space left on device\n")


# What is read as the interpreter or a library starts.
ASCII = {"PYTHONIOENCODING": "ascii", "LC_ALL": "C", "PYTHONUTF8": "0"}
STARTS = (
    ("look {in}/photos/a.png", {"NUMBA_NUM_THREADS": "0"}, 2, "NUMBA_NUM_THREADS: Numba cannot"),
    ("match {in}/photos/a.png {in}/photos/b.png -o é", {"MPLBACKEND": "x", **ASCII}, 0, ""),
)
"""Words, variables, exit code, and what is told."""


@pytest.mark.parametrize(("words", "variables", "expected", "told"), STARTS, ids=str)
def test_no_variable_ends_in_a_traceback(hostile, tmp_path, words, variables, expected, told):
    environment = {**os.environ, **variables}
    del environment[TRACEBACK]
    done = run_python(
        *("-m", "saccade"),
        *words.format(**{"in": hostile[0] / "in"}).split(),
        cwd=tmp_path,
        env=environment,
    )
    assert done.returncode == expected, done.stderr
    assert told in done.stderr
    assert len(done.stderr.splitlines()) == (expected > 0), done.stderr


def test_an_error_that_nobody_foresaw_is_one_line(run, monkeypatch):
    def fails(*_):
        raise RuntimeError("several\nlines")

    monkeypatch.setattr("saccade.cli.look.read_image", fails)
    with pytest.raises(RuntimeError, match="several"):
        run("look", "a.png")
    monkeypatch.delenv(TRACEBACK)
    told = f"saccade: RuntimeError: several lines; set {TRACEBACK}=1 for a traceback\n"
    assert run("look", "a.png") == (1, "", told)
