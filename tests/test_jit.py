"""When a compiled kernel is taken from the disk, and when it is compiled again."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from saccade import _jit
from support.limits import TIMEOUT

SOURCE = Path(_jit.__file__).parent
KERNELS = """
from typing import NamedTuple

from saccade._jit import kernel
from saccade.probe._other_kernels import doubled


class Pair(NamedTuple):
    first: float
    second: float


@kernel()
def difference(pair: Pair) -> float:
    return doubled(pair.first - pair.second)
"""
OTHER = """
from saccade._jit import kernel


@kernel()
def doubled(x: float) -> float:
    return 2 * x
"""
SCRIPT = """
from saccade._jit import needs_compiling
from saccade.probe._kernels import Pair, difference
print(needs_compiling(difference), difference(Pair(first=3.0, second=1.0)))
print(*difference.stats.cache_misses.values())
"""


@pytest.fixture
def probe(tmp_path_factory):
    """A copy of what kernels need, with a package of two kernel files and another file."""
    home = tmp_path_factory.mktemp("copied")
    package = home / "saccade"
    (package / "probe").mkdir(parents=True)
    for name in ("_jit.py", "errors.py"):
        shutil.copy(SOURCE / name, package / name)
    for name in ("__init__.py", "probe/__init__.py", "probe/words.py"):
        (package / name).write_text("")
    (package / "probe" / "_kernels.py").write_text(KERNELS)
    (package / "probe" / "_other_kernels.py").write_text(OTHER)
    return package / "probe"


def run(probe, **variables):
    """Whether the kernel was to be compiled, and its value."""
    (found,) = run_at_once(1, probe, **variables)
    return found[0] == "True", float(found[1])


def run_at_once(count, probe, **variables):
    """What the script prints in so many processes."""
    environment = {
        **{name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")},
        **{"PYTHONPATH": str(probe.parents[1]), **variables},
    }
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", SCRIPT],
            env=environment,
            cwd=probe,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(count)
    ]
    found = []
    for process in processes:
        out, err = process.communicate(timeout=TIMEOUT)
        assert process.returncode == 0, err
        found.append(out.split())
    return found


def test_only_a_changed_kernel_file_makes_the_cache_stale(probe):
    assert run(probe) == (True, 4.0)
    (probe / "words.py").write_text("'''Other words.'''\n")
    (probe.parent / "errors.py").write_text((probe.parent / "errors.py").read_text() + "\n")
    assert run(probe) == (False, 4.0)
    file = probe / "_other_kernels.py"  # of the kernel that is called
    file.write_text(OTHER.replace("2 * x", "5 * x"))
    assert run(probe) == (True, 10.0)


@pytest.mark.nightly
def test_a_kernel_at_the_top_level_makes_the_cache_stale(probe):
    run(probe)
    (probe.parent / "_shared_kernels.py").write_text("")
    assert run(probe)[0] is False  # an empty file has nothing to hash
    (probe.parent / "_shared_kernels.py").write_text("FACTOR = 2\n")
    assert run(probe)[0] is True


@pytest.mark.nightly
def test_of_processes_that_need_a_kernel_at_once_one_compiles_it(probe, tmp_path):
    found = run_at_once(3, probe, NUMBA_CACHE_DIR=str(tmp_path))
    assert [values[1] for values in found] == ["4.0"] * 3
    assert sum(len(values[2:]) for values in found) == 1
    assert not list(tmp_path.rglob("*.lock"))


@pytest.mark.skipif(not _jit._runs_shipped(), reason="a wheel's kernels are for other processors")
def test_a_kernel_that_is_shipped_is_not_compiled(probe, tmp_path):
    source = probe / "_kernels.py"
    cpu = {"NUMBA_CPU_NAME": _jit.SHIPPED_CPU, "NUMBA_CPU_FEATURES": ""}
    assert run(probe, NUMBA_CACHE_DIR=str(tmp_path / "built"), **cpu)[0] is True
    (built,) = (tmp_path / "built").iterdir()
    shutil.copytree(built, probe.parent / "_compiled" / "probe")
    assert run(probe, NUMBA_CACHE_DIR=str(tmp_path / "used")) == (False, 4.0)
    assert not list((tmp_path / "used").rglob("*.nbc"))
    source.write_text(KERNELS.replace("first - pair.second", "first + pair.second"))
    assert run(probe, NUMBA_CACHE_DIR=str(tmp_path / "used")) == (True, 8.0)


@pytest.mark.parametrize("missing", ["_cache", "_cache_file", "_source_stamp", "_load_index"])
def test_without_numbas_private_attributes_kernels_are_cached_plainly(missing, monkeypatch):
    class File:
        _source_stamp = "plain"

        def _load_index(self):
            return {}

    class Cache:
        _cache_file = File()

    class Dispatcher:
        _cache = Cache()

    owner = {"_cache": Dispatcher, "_cache_file": Cache}.get(missing, File)
    assert _jit.needs_compiling(Dispatcher())
    monkeypatch.delattr(owner, missing)
    _jit._stamp_cache(Dispatcher(), "stamp")
    assert getattr(File, "_source_stamp", "plain") == "plain"
    assert not _jit.needs_compiling(Dispatcher())


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="there is no cache without the compiler")
def test_this_numba_has_the_attributes():
    """Where it fails, `_jit` is to learn those of a new version of Numba."""

    @_jit.kernel()
    def same(x):
        return x

    assert _jit._cache_file(same) is not None
    stamp = _jit._hash_kernels(_jit._package(Path(__file__)))
    assert stamp in same._cache._cache_file._source_stamp
