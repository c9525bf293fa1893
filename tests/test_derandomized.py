"""Derandomized examples are the same whatever else a test worker has imported."""

import importlib.util
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


def _draw():
    drawn = []

    @settings(max_examples=200)
    @given(st.integers(0, 10**9))
    def record(number):
        drawn.append(number)

    record()
    return drawn


def test_examples_do_not_depend_on_the_modules_that_are_loaded(tmp_path, monkeypatch):
    if not settings.default.derandomize:
        pytest.skip("examples are drawn at random")
    before = _draw()
    path = tmp_path / "local_module.py"
    path.write_text("\n".join(f"number_{i} = {731_000_003 + i}" for i in range(50)))
    spec = importlib.util.spec_from_file_location("local_module", path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "local_module", module)
    spec.loader.exec_module(module)
    assert _draw() == before
