"""What share of small changes to a room its tests notice: `uvx nox -s mutation -- slam`.

A sample of the mutants that cosmic-ray knows, the same share of every file. A mutant is met by
the quick tests that run its line, in a process forked from one that has the libraries loaded. A
changed kernel and those that call it are interpreted: to compile them would take a minute, and
what a kernel means is what its Python says. The slow tests may yet notice what survives.
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
TESTS = {
    "attention": (
        *("contrast", "contrast_settings", "channels", "normalize", "scanpath", "symmetry"),
        *("symmetric_pairs", "proto_object", "combined", "saliencytoolbox2", "edges", "limits"),
    ),
    "keypoints": (
        *("descriptor", "extrema", "matching", "must", "selection", "sift", "sift_settings"),
        *("symroid", "verification", "describe", "edges", "limits"),
    ),
    "slam": (
        *("models", "ekf", "association", "run", "compressed", "consistency", "exploring"),
        *("tuning", "odometry_bias", "checkpoint", "hard_logs", "smoothing", "limits"),
    ),
}
"""Of each room."""
LIBRARIES = (
    *("numba", "cv2", "scipy.linalg", "scipy.ndimage", "scipy.optimize", "scipy.spatial"),
    *("scipy.stats", "scipy.sparse.linalg", "scipy.signal", "scipy.io", "matplotlib.pyplot"),
    *("pytest", "hypothesis.strategies", "hypothesis.extra.numpy", "typer", "rich.console"),
)
"""Loaded once; the project itself is loaded by every mutant."""
LIMIT = 2.0
"""Seconds of the processor that a test may take to be asked, with its lines traced."""
START, SLOWER = 20.0, 4.0
"""Seconds of the processor, and times what its tests need, after which a mutant counts as
noticed: it goes round in circles."""
Lines = dict[str, dict[str, float]]
"""By line the tests that run it, and their seconds."""
MEMORY = 8 << 30


def main() -> None:
    """Print how many of a sample were noticed, and list those that were not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("room", choices=TESTS)
    parser.add_argument("--count", type=int, default=150, help="how many mutants are tried")
    parser.add_argument("--seed", type=int, default=1, help="which ones")
    parser.add_argument("--only", default="", help="of these, whose description has this")
    parser.add_argument("--warm", action="store_true", help="all kernels are compiled already")
    asked = parser.parse_args()
    prepare()
    if not asked.warm and forked(partial(meet, ROOT, "", dict.fromkeys(files(asked.room), 1000.0))):
        sys.exit(f"{asked.room}: its tests fail without a change")
    from mutation.mutants import sample

    room = ROOT / "src" / "saccade" / asked.room
    number, chosen = sample(room, asked.count, random.Random(asked.seed))
    chosen = [each for each in chosen if asked.only in each.describe()]
    print(f"{number} mutants in {asked.room}, of which {len(chosen)} are tried", flush=True)
    reached: dict[str, Lines] = {}
    killed = 0
    for count, mutant in enumerate(sorted(chosen, key=lambda each: each.path), 1):
        path = str(mutant.path)
        if path not in reached:
            reached |= reach(mutant.path)
        ours = tests_of(reached[path], mutant.lines()[0])
        noticed = bool(ours) and forked(partial(meet, mutant.path, mutant.source(), ours))
        killed += noticed
        if not noticed:
            print(f"survived {len(ours)} tests: {mutant.describe()}", flush=True)
        print(f"{killed} of {count} killed", end="\r", file=sys.stderr, flush=True)
    low, high = wilson(killed, len(chosen))
    share = f"{killed / len(chosen):.0%} ({low:.0%} to {high:.0%} with 95 % certainty)"
    print(f"{asked.room}: {killed} of {len(chosen)} mutants killed: {share}")


def prepare() -> None:
    """Load what does not change, and keep to one thread."""
    os.environ |= {"CI": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    os.environ |= {"MPLBACKEND": "agg"}
    sys.dont_write_bytecode = True
    sys.path[:0] = [str(ROOT / "src"), str(ROOT / "tests")]
    os.chdir(ROOT)
    for name in LIBRARIES:
        importlib.import_module(name)


def files(room: str) -> list[str]:
    """The tests of a room."""
    named = (Path("tests").rglob(f"test_{name}.py") for name in TESTS[room])
    return [str(path) for paths in named for path in paths]


def reach(path: Path) -> dict[str, Lines]:
    """By file and line the quick tests that run it: of all files of a room that have kernels,
    with these interpreted, or of all that have none, as this one does."""
    room = next(each for each in path.parents if each.parent.name == "saccade")
    has_kernels = {each: "@kernel" in each.read_text() for each in room.rglob("*.py")}
    alike = [each for each in has_kernels if has_kernels[each] == has_kernels[path]]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "reach.json"
        if forked(partial(look, room, alike if has_kernels[path] else [], report)):
            sys.exit(f"{path}: its tests do not run")
        seen: dict[str, Lines] = json.loads(report.read_text())
    return {str(each): seen.get(str(each), {}) for each in alike}


def look(room: Path, interpreted: Collection[Path], report: Path) -> int:
    """Run tests to see which lines they reach; 0 if they ran."""
    import pytest

    from mutation.changed import QUIETLY, interpret
    from mutation.reach import Reach

    seen = Reach(room, LIMIT)
    interpret(interpreted)
    ended = pytest.main([*QUIETLY, *files(room.name)], plugins=[seen])
    report.write_text(json.dumps(seen.seen()))
    return int(ended > 1)


def tests_of(reached: Lines, line: int) -> dict[str, float]:
    """The tests of a line, or for one that runs at import those of all lines."""
    every = {test: took for tests in reached.values() for test, took in tests.items()}
    return reached.get(str(line)) or dict(sorted(every.items(), key=lambda each: each[1]))


def meet(path: Path, source: str, tests: dict[str, float]) -> int:
    """Run tests with a file that says something else; the exit code of pytest."""
    import pytest

    from mutation.changed import QUIETLY, replace

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.setitimer(signal.ITIMER_PROF, START + SLOWER * sum(tests.values()))
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
    """The interval of Wilson for a share."""
    z, share = 1.96, killed / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count)
    half *= (share * (1 - share) / count + z * z / (4 * count * count)) ** 0.5
    return middle - half, middle + half


if __name__ == "__main__":
    main()
