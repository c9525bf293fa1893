"""Machines without a home, a network, a second core, or a place to write to.

Where the compiler is off, see `test_packaging` and `test_architecture`; where it has no cache,
`test_architecture`.
"""

import ctypes
import json
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest

DROP_FROM_BOUNDING_SET = 24
MAY_WRITE_ANYWHERE, MAY_READ_ANYWHERE = 1, 2
"""Of Linux: what lets an administrator ignore permissions, and the call that takes it away."""
OFFLINE = """
import sys

def refuse(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "socket.gethostbyname"):
        raise RuntimeError(f"{event}: {arguments}")

sys.addaudithook(refuse)
"""
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
        done = subprocess.run(
            [sys.executable, "-c", f"{before}\n{MAIN}", *words],
            cwd=tmp_path,
            env={name: value for name, value in settings.items() if value is not None},
            preexec_fn=prepare,
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
        assert not [line for line in done.stderr.splitlines() if "compiling" not in line]
        assert json.loads(done.stdout) == json.loads(expected)

    return call


def test_no_network(look):
    look(OFFLINE)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no way to take cores away here")
def test_one_core(look):
    (core, *_) = os.sched_getaffinity(0)
    look(prepare=lambda: os.sched_setaffinity(0, {core}))


@pytest.mark.skipif(sys.platform != "linux", reason="permissions as Linux has them")
def test_a_home_that_cannot_be_written(look, tmp_path):
    (tmp_path / "home").mkdir(mode=0o555)
    nowhere = dict.fromkeys(("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR"))
    look(prepare=without_privileges, HOME=str(tmp_path / "home" / "missing"), **nowhere)


def without_privileges():
    """Let permissions count for an administrator too, as whom containers run tests."""
    for each in (MAY_WRITE_ANYWHERE, MAY_READ_ANYWHERE):
        ctypes.CDLL(None).prctl(DROP_FROM_BOUNDING_SET, each, 0, 0, 0)
