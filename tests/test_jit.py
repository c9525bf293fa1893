"""The cache of compiled kernels: stale when a kernel file of the package changes, and only then."""

import os
import shutil
from pathlib import Path

import numba
import pytest

from saccade import _jit
from support.processes import run_python

SOURCE = Path(_jit.__file__).parent
KERNELS = """
from saccade._jit import kernel
from saccade.probe._other_kernels import doubled


@kernel()
def difference(first: float, second: float) -> float:
    return doubled(first - second)
"""
OTHER = """
from saccade._jit import kernel


@kernel()
def doubled(x: float) -> float:
    return 2 * x
"""
SCRIPT = """
from saccade.probe._kernels import difference
print(difference(3.0, 1.0), bool(difference.stats.cache_hits))
"""
pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


@pytest.fixture
def probe(tmp_path):
    """A copy of `saccade` of one package, with two kernel files and another file."""
    package = tmp_path / "saccade"
    (package / "probe").mkdir(parents=True)
    for name in ("_jit.py", "_compiler.py", "errors.py"):
        shutil.copy(SOURCE / name, package / name)
    for name in ("__init__.py", "probe/__init__.py", "probe/words.py"):
        (package / name).write_text("")
    (package / "probe" / "_kernels.py").write_text(KERNELS)
    (package / "probe" / "_other_kernels.py").write_text(OTHER)
    return package / "probe"


def run(probe):
    """The value of the kernel, and whether it came from the cache."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    done = run_python(
        "-c", SCRIPT, cwd=probe, env={**kept, "PYTHONPATH": str(probe.parents[1])}, check=True
    )
    value, cached = done.stdout.split()
    said = [] if cached == "True" else ["compiling for this machine (once; the result is cached)"]
    assert done.stderr.splitlines() == said
    return [value, cached]


def test_only_a_changed_kernel_file_makes_the_cache_stale(probe):
    assert run(probe) == ["4.0", "False"]
    (probe / "words.py").write_text("'''Other words.'''\n")
    assert run(probe) == ["4.0", "True"]
    file = probe / "_other_kernels.py"  # of the kernel that is called
    file.write_text(OTHER.replace("2 * x", "5 * x"))
    assert run(probe) == ["10.0", "False"]


def test_a_kernel_travels_to_another_process_by_its_name():
    code = (
        "import copy, pickle, sys; from saccade.scale import _pair_sums_kernels as k; "
        "made = k.add_radial; again = pickle.loads(pickle.dumps(made)); "
        "assert again is made is copy.deepcopy(made); assert not hasattr(made, '__array__'); "
        "assert 'numba' not in sys.modules"
    )
    run_python("-c", code, check=True)
