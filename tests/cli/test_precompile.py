"""Compiling in another process while this one works."""

import importlib.util
import subprocess
import sys
from functools import partial

import numba
import numpy as np
import pytest

from saccade import _jit
from saccade._jit import needs_compiling
from saccade.cli import precompile
from saccade.slam import Slam

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
    started, ran = [], []

    class Process:
        def __init__(self, words, **_):
            started.append(words)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def kill(self):
            started.append("killed")

    monkeypatch.setattr(subprocess, "Popen", Process)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr("saccade._jit.needs_compiling", lambda _: cold)
    for name in precompile.TASKS:
        monkeypatch.setitem(precompile.TASKS, name, partial(ran.append, name))
    for tasks in (["points", "association"], ["points"]):
        with precompile.compiled_ahead(*tasks):
            assert len(started) == cold
        if cold:
            (_, _, code, *words), killed = started
            assert killed == "killed"
            monkeypatch.setattr(sys, "argv", ["-c", *words])
            exec(compile(code, "words", "exec"), {})
            assert ran == tasks
        started.clear(), ran.clear()


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_kernels_are_compiled_for_the_types_with_which_the_step_calls_them(monkeypatch):
    slam = Slam()
    slam.step(0.0, z=np.ones((1, 2)), R=np.eye(2)[None], names=np.zeros(1, np.int64))
    parts = []
    monkeypatch.setattr(_jit, "compile_for", lambda *part: parts.append(part))
    precompile.compile_association()
    for part, *arguments in parts:
        cached = {key[0] for key in _jit._cache_file(part)._load_index()}
        assert tuple(map(numba.typeof, arguments)) in cached, part
