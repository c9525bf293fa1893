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
from fuzz.targets import TARGETS
from support.error_checks import result_or_refusal
from support.limits import EXAMPLES, TIMEOUT, limited
from support.processes import run_python

RUN = Path(__file__).parent / "fuzz" / "run.py"


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
