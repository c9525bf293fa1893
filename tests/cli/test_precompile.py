"""Compiling in another process while this one works."""

import subprocess
import sys
from functools import partial

import numba
import numpy as np
import pytest

from saccade import _jit
from saccade.cli import precompile
from saccade.slam import Slam


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
