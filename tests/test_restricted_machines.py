"""Machines without a home, a network, a second core, a place to write to, or much else.

Where the compiler has no cache, see `test_architecture`.
"""

import os
import re
import resource
import signal
import socket
import sys
from pathlib import Path

import pytest

from saccade.cli import TRACEBACK
from support.commands import COMMANDS, EXITS, all_commands, make_inputs, words_of
from support.limits import EXAMPLES
from support.privileges import without_privileges
from support.processes import run_python

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="machines as Linux has them")
MAIN = "from saccade.cli import main; main()"
OFFLINE = """
import sys

def refuse(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "socket.gethostbyname"):
        raise RuntimeError(f"{event}: {arguments}")

sys.addaudithook(refuse)
"""
OPTIONAL = (
    *("pyarrow", "h5py", "gtsam", "rosbags", "starlette", "uvicorn"),
    *("rerun", "distributed", "dask", "pycolmap"),
)


def without(*libraries):
    """Code that lets imports of libraries fail."""
    return f"import sys; sys.modules.update(dict.fromkeys({libraries!r}))"


def with_one_core():
    """On a processor of one core, for a user who may not write at home."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    without_privileges()


def with_closed_streams():
    """As with <&- >&- 2>&- in a shell."""
    for stream in (0, 1, 2):
        os.close(stream)


def with_full_stdout():
    """Nothing can be printed."""
    os.dup2(os.open("/dev/full", os.O_WRONLY), 1)


def with_full_disk():
    """No file can grow over 500 bytes."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))


FILE = "{in}/log.csv"
"""In the place of a folder."""
NOWHERE = {
    **dict.fromkeys(("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"), FILE),
    **dict.fromkeys(("NUMBA_CACHE_DIR", "MPLCONFIGDIR"), FILE),
    **dict.fromkeys(("TMPDIR", "TEMP", "TMP"), "{in}/nowhere"),
}
ASCII = {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
NONSENSE = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "NUMBA_THREADING_LAYER", "TZ", "COLUMNS", "TERM", "MPLBACKEND"),
    "nonsense",
)
ENVIRONMENTS = {
    "offline": (OFFLINE, with_one_core, {"OMP_NUM_THREADS": "0", **NOWHERE}),
    "ascii": ("", None, ASCII),
    "nonsense": ("", None, {**NONSENSE, "FORCE_COLOR": "1"}),
    "closed": ("", lambda: os.close(1), {}),
    "all-closed": ("", with_closed_streams, {}),
    "full": ("", with_full_stdout, {}),
    "full-disk": ("", with_full_disk, {}),
    "gone-folder": ("", lambda: Path.cwd().rmdir(), {}),
    "bare": (without(*OPTIONAL), None, {}),
    **{f"no-{library}": (without(library), None, {}) for library in OPTIONAL},
}
"""By name: code before the command, what is done to its process, and variables."""
HARMLESS = {"offline", "ascii", "nonsense", "closed"}
"""Environments in which every command does its work."""
MISSING = {
    ("no-h5py", "convert --to"): "needs h5py",
    ("no-starlette", "serve"): "needs starlette",
    ("bare", "extract"): "parquet: needs pyarrow",
}
"""What is told of a library that is missing."""
USUAL = {
    "offline": "look",
    **dict.fromkeys(("ascii", "all-closed", "gone-folder"), "convert"),
    **dict.fromkeys(("closed", "full-disk"), "detect"),
}
"""A command that is run in an environment, if not `config`."""
ONCE = {("full-disk", "convert --to"), ("full", "config"), *MISSING}
"""Commands that once did not withstand an environment, beside one or several of each."""


def cases():
    """Pairs of an environment and a command: a few of each, more where many are asked for."""
    for i, environment in enumerate(ENVIRONMENTS):
        for j, name in enumerate(COMMANDS):
            usual = USUAL.get(environment, "config") == name and environment[:3] != "no-"
            if usual or (environment, name) in ONCE or (EXAMPLES > 12 and (i + j) % 6 == 0):
                yield environment, name


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """A folder with what commands read, and a port that is taken."""
    folder = tmp_path_factory.mktemp("hostile")
    (folder / "in").mkdir()
    make_inputs(folder / "in")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        yield folder / "in", taken.getsockname()[1]


def test_no_command_is_forgotten():
    assert {name for name, _ in all_commands()} == {command.split(" --")[0] for command in COMMANDS}


@pytest.mark.parametrize(("environment", "command"), [*cases()])
def test_no_environment_ends_in_a_traceback(inputs, tmp_path, environment, command):
    folder, port = inputs
    before, prepare, variables = ENVIRONMENTS[environment]
    words = words_of(command, folder, port)
    settings = {name: each.format(**{"in": folder}) for name, each in variables.items()}
    environ = {**os.environ, "OMP_NUM_THREADS": "1", **settings}
    del environ[TRACEBACK]
    done = run_python("-c", f"{before}\n{MAIN}", *words, cwd=tmp_path, env=environ, prepare=prepare)
    code, err = done.returncode, done.stderr
    assert code in (0, 1, 2), err
    for word in ("Traceback", TRACEBACK, "Warning"):  # an error that nobody foresaw names TRACEBACK
        assert word not in err, err
    assert code != 2 or re.fullmatch(r"saccade: [^\n]+\n", err) or environment == "all-closed", err
    if environment in HARMLESS:
        assert code == EXITS.get(command, 0), err
    if (environment, command) in MISSING:
        assert code == 2, err
        assert MISSING[environment, command] in err
    if environment == "full" and command not in EXITS:
        assert code == 1, err
        assert err.endswith("saccade: standard output: No space left on device\n")


def test_an_error_that_nobody_foresaw_is_one_line(run, monkeypatch):
    def fails(*_):
        raise RuntimeError("several\nlines")

    monkeypatch.setattr("saccade.cli.look_image.read_image", fails)
    with pytest.raises(RuntimeError, match="several"):
        run("look", "a.png")
    monkeypatch.delenv(TRACEBACK)
    told = f"saccade: RuntimeError: several lines; set {TRACEBACK}=1 for a traceback\n"
    assert run("look", "a.png") == (1, "", told)
