"""Compiling in another process while this one works."""

import importlib.util
import subprocess
import sys
from importlib.resources import files

import pytest

from saccade._jit import needs_compiling
from saccade.cli import precompile

LOG = files("saccade") / "data" / "victoria_park.txt"
SOURCE = """
from saccade._jit import kernel

@kernel()
def doubled(x):
    return 2 * x
"""


def test_a_kernel_is_to_compile_until_it_was_called(tmp_path):
    file = tmp_path / "fresh.py"
    file.write_text(SOURCE)
    for was in (True, False):  # the second time it comes from the cache
        spec = importlib.util.spec_from_file_location("fresh", file)
        module = importlib.util.module_from_spec(spec)
        sys.modules["fresh"] = module
        spec.loader.exec_module(module)
        assert needs_compiling(module.doubled) is was
        assert module.doubled(3) == 6
        assert not needs_compiling(module.doubled)
    assert not needs_compiling(module.doubled.py_func)


@pytest.mark.parametrize("cold", [True, False])
def test_another_process_is_started_only_where_there_is_something_to_compile(cold, monkeypatch):
    started = []

    class Process:
        def __init__(self, words, **_):
            started.append(words)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def wait(self, seconds):
            raise subprocess.TimeoutExpired("it", seconds)

        def kill(self):
            started.append("killed")

    monkeypatch.setattr(subprocess, "Popen", Process)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr("saccade._jit.needs_compiling", lambda _: cold)
    with precompile.filter_compiled_ahead(LOG) as wait:
        wait()
    assert len(started) == (3 if cold else 0)
    if cold:
        code = compile(started[0][2], "words", "exec")
        assert started[0][3] == str(LOG)
        monkeypatch.setattr(sys, "argv", ["-c", str(LOG)])
        with pytest.raises(SystemExit):
            exec(code, {})
