"""A failure whose text cannot be encoded is reported, and so are all others."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.limits import TIMEOUT

TESTS = r"""
import sys
import pytest

@pytest.mark.parametrize("word", ["\udcff", "\ud800"])
def test_words(word, record_property):
    record_property("key" + word, "value" + word)
    sys.stdout.write("printed " + word)
    assert word == "expected " + word

@pytest.mark.skip(reason="skipped \ud800")
def test_skipped():
    pass

def test_the_last():
    raise ValueError("raised \ud800")
"""

SETTINGS = {
    "PYTHONPATH": str(Path(__file__).parent),
    "PYTHONUTF8": "1",
    "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
}


@pytest.mark.nightly
def test_a_lone_surrogate_ends_no_run(tmp_path):
    (tmp_path / "test_surrogates.py").write_text(TESTS)
    (tmp_path / "test_broken.py").write_text(r'raise RuntimeError("collected \ud800")')
    words = ["-q", "-n", "1", "-p", "support.encodable_reports", "-p", "xdist", "-rs"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "--continue-on-collection-errors", *words],
        cwd=tmp_path,
        env={**os.environ, **SETTINGS},
        capture_output=True,
        text=True,
        check=False,
        timeout=TIMEOUT,
    )
    assert done.stdout.splitlines()[-1].startswith("3 failed, 1 skipped, 1 error in"), done.stdout
    for told in (
        *("AssertionError: assert '\\udcff' == 'expected \\udcff'", "raised \\ud800"),
        *("collected \\ud800", "skipped \\ud800", "printed ?"),
    ):
        assert told in done.stdout
