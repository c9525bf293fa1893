"""Mutation testing: which fraction of small changes to a package its tests notice.

`uvx nox -s mutation -- slam` draws a sample of cosmic-ray's mutants, the same fraction of every
file. A mutant is given to the quick tests that run its line, in a process forked from one that has
the libraries loaded. A changed kernel and those that call it are interpreted: to compile them would
take a minute, and what a kernel means is what its Python says. The slow tests may still notice what
survives.
"""

import argparse
import contextlib
import importlib
import json
import os
import random
import resource
import signal
import sys
import tempfile
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("attention", "keypoints", "slam")
LIMITS = "tests/test_limits.py"
"""The test of every package, beside those in its own folder."""
LIBRARIES = (
    *("numba", "cv2", "scipy.linalg", "scipy.ndimage", "scipy.optimize", "scipy.spatial"),
    *("scipy.stats", "scipy.sparse.linalg", "scipy.signal", "scipy.io", "matplotlib.pyplot"),
    *("pytest", "hypothesis.strategies", "hypothesis.extra.numpy", "typer", "rich.console"),
)
"""Loaded once; the project itself is loaded by every mutant."""
LIMIT = 2.0
"""CPU seconds that a quick test may take, with its lines traced."""
STARTUP, SLOWDOWN = 20.0, 4.0
"""CPU seconds, and multiple of what its tests need, after which a mutant counts as noticed: it
loops."""
Lines = dict[str, dict[str, float]]
"""By line, the tests that run it and their seconds."""
MEMORY = 8 << 30


def main() -> None:
    """Print how many mutants of a sample were noticed, and list the survivors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("package", choices=PACKAGES)
    parser.add_argument("--count", type=int, default=150, help="number of mutants")
    parser.add_argument("--seed", type=int, default=1, help="seed of the sample")
    parser.add_argument("--only", default="", help="only mutants whose description contains this")
    parser.add_argument("--warm", action="store_true", help="kernels are compiled already")
    asked = parser.parse_args()
    prepare()
    if not asked.warm and forked(
        partial(run_tests, ROOT, "", dict.fromkeys(test_files(asked.package), 1000.0))
    ):
        sys.exit(f"{asked.package}: its tests fail without a change")
    from mutation.mutants import sample

    package = ROOT / "src" / "saccade" / asked.package
    number, chosen = sample(package, asked.count, random.Random(asked.seed))
    chosen = [each for each in chosen if asked.only in each.describe()]
    print(f"{number} mutants in {asked.package}, of which {len(chosen)} are tried", flush=True)
    reached: dict[str, Lines] = {}
    killed = 0
    for count, mutant in enumerate(sorted(chosen, key=lambda each: each.path), 1):
        path = str(mutant.path)
        if path not in reached:
            reached |= reach(mutant.path)
        ours = tests_of(reached[path], mutant.lines()[0])
        noticed = bool(ours) and forked(partial(run_tests, mutant.path, mutant.source(), ours))
        killed += noticed
        if not noticed:
            print(f"survived {len(ours)} tests: {mutant.describe()}", flush=True)
        print(f"{killed} of {count} killed", end="\r", file=sys.stderr, flush=True)
    low, high = wilson(killed, len(chosen))
    rate = f"{killed / len(chosen):.0%} ({low:.0%} to {high:.0%} with 95 % confidence)"
    print(f"{asked.package}: {killed} of {len(chosen)} mutants killed: {rate}")


def prepare() -> None:
    """Load what does not change, and keep to one thread."""
    os.environ |= {"CI": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    os.environ |= {"MPLBACKEND": "agg"}
    sys.dont_write_bytecode = True
    sys.path[:0] = [str(ROOT / "src"), str(ROOT / "tests")]
    os.chdir(ROOT)
    for name in LIBRARIES:
        importlib.import_module(name)


def test_files(package: str) -> list[str]:
    """The tests of a package."""
    return [*sorted(map(str, Path("tests", package).glob("test_*.py"))), LIMITS]


def reach(path: Path) -> dict[str, Lines]:
    """By file and line, the quick tests that run it.

    Of all files of a package that have kernels, with these interpreted, if this one has; of all
    that have none otherwise.
    """
    package = next(each for each in path.parents if each.parent.name == "saccade")
    has_kernels = {each: "@kernel" in each.read_text() for each in package.rglob("*.py")}
    alike = [each for each in has_kernels if has_kernels[each] == has_kernels[path]]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "reach.json"
        if forked(partial(trace_tests, package, alike if has_kernels[path] else [], report)):
            sys.exit(f"{path}: its tests do not run")
        traced: dict[str, Lines] = json.loads(report.read_text())
    return {str(each): traced.get(str(each), {}) for each in alike}


def trace_tests(package: Path, interpreted: Collection[Path], report: Path) -> int:
    """Trace the lines that every quick test runs; gives 0 if the tests ran."""
    import pytest

    from mutation.changed import QUIETLY, interpret
    from mutation.reach import Reach

    traced = Reach(package, LIMIT)
    interpret(interpreted)
    ended = pytest.main([*QUIETLY, *test_files(package.name)], plugins=[traced])
    report.write_text(json.dumps(traced.lines()))
    return int(ended > 1)


def tests_of(reached: Lines, line: int) -> dict[str, float]:
    """The tests of a line, or for one that runs at import those of all lines."""
    every = {test: took for tests in reached.values() for test, took in tests.items()}
    return reached.get(str(line)) or dict(sorted(every.items(), key=lambda each: each[1]))


def run_tests(path: Path, source: str, tests: dict[str, float]) -> int:
    """Run tests with another source in place of a file; gives the exit code of pytest."""
    import pytest

    from mutation.changed import QUIETLY, replace

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.setitimer(signal.ITIMER_PROF, STARTUP + SLOWDOWN * sum(tests.values()))
    replace(path, source)
    return int(pytest.main([*QUIETLY, "-x", *tests]))


def forked(work: Callable[[], int]) -> bool:
    """Whether work fails, or takes too long, in a silent process of its own."""
    child = os.fork()
    if not child:
        code = 1
        try:
            os.setsid()
            nowhere = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1, 2):
                os.dup2(nowhere, stream)
            code = work()
        finally:
            os._exit(code)
    failed = os.waitpid(child, 0)[1] != 0
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    return failed


def wilson(killed: int, count: int) -> tuple[float, float]:
    """The Wilson score interval of a proportion."""
    z, rate = 1.96, killed / count
    middle = (rate + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count)
    half *= (rate * (1 - rate) / count + z * z / (4 * count * count)) ** 0.5
    return middle - half, middle + half


if __name__ == "__main__":
    main()
