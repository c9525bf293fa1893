"""What share of small changes to a room its tests notice: `uvx nox -s mutation -- slam`.

A sample of the mutants that cosmic-ray knows, the same share of every file, each in a copy of the
tree. The compiler is off: a changed kernel would take a minute to compile, and what a kernel means
is what its Python says. So only tests that are quick without it are asked; a mutant that survives
them is one that the whole suite may yet notice.
"""

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

ROOT = Path(__file__).parents[2]
TESTS = {
    "attention": (
        *("contrast", "contrast_settings", "channels", "normalize", "scanpath", "symmetry"),
        *("symmetric_pairs", "proto_object", "combined", "saliencytoolbox2"),
    ),
    "keypoints": (
        *("descriptor", "extrema", "matching", "must", "selection", "sift", "sift_settings"),
        *("symroid", "verification", "describe", "edges"),
    ),
    "slam": (
        *("models", "ekf", "association", "run", "compressed", "consistency", "exploring"),
        *("tuning", "wheels", "checkpoint", "hard_logs", "smoothing"),
    ),
}
"""Of each room."""
LEFT_OUT = ("BitOr", "ExceptionReplacer", "RemoveDecorator", "Variable")
"""Operators whose changes say little: most of them break what is said of types, or an import."""
LIMIT = 0.5
"""Seconds that a test may take to be asked."""
SLOWEST = 90
"""Seconds after which a mutant counts as noticed: it goes round in circles."""


def main() -> None:
    """Print how many of a sample were noticed, and list those that were not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("room", choices=TESTS)
    parser.add_argument("--count", type=int, default=150)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        ignored = shutil.ignore_patterns(".*", "__pycache__", "docs", "dist", "benchmarks")
        shutil.copytree(ROOT, tree, ignore=ignored)
        quick = quick_tests(tree, asked.room)
        print(f"{len(quick)} tests take under {LIMIT} s without the compiler", flush=True)
        chosen = sample(tree, asked.room, asked.count, random.Random(asked.seed))
        killed = 0
        for number, (path, operator, occurrence) in enumerate(chosen, 1):
            noticed = try_mutant(tree, path, operator, occurrence, quick)
            killed += noticed
            if not noticed:
                print(f"survived: {describe(tree, path, operator, occurrence)}", flush=True)
            print(f"{killed} of {number} killed", end="\r", file=sys.stderr, flush=True)
        low, high = wilson(killed, len(chosen))
        share = f"{killed / len(chosen):.0%} ({low:.0%} to {high:.0%} with 95 % certainty)"
        print(f"{asked.room}: {killed} of {len(chosen)} mutants killed: {share}")


def quick_tests(tree: Path, room: str) -> list[str]:
    """Those that pass in time, the quickest first."""
    report = tree / "quick.json"
    files = [f"tests/test_{name}.py" for name in TESTS[room]]
    pytest(tree, [*files, "-p", "mutation.quick"], QUICK_REPORT=str(report), QUICK_LIMIT=str(LIMIT))
    took: dict[str, float] = json.loads(report.read_text())
    return sorted(took, key=took.__getitem__)


def sample(tree: Path, room: str, count: int, chance: random.Random) -> list[tuple[Path, str, int]]:
    """Mutants of every file in proportion to how many it has."""
    every = []
    for path in sorted((tree / "src" / "saccade" / room).glob("*.py")):
        nodes = list(ast_nodes(get_ast_from_path(path)))
        for name in operator_names():
            if not any(word in name for word in LEFT_OUT):
                operator = get_operator(name)()
                places = sum(len(list(operator.mutation_positions(node))) for node in nodes)
                every += [(path, name, place) for place in range(places)]
    print(f"{len(every)} mutants in {room}", flush=True)
    step, start = len(every) / count, chance.random()
    systematic = [every[int((start + k) * step)] for k in range(min(count, len(every)))]
    chance.shuffle(systematic)
    return systematic


def try_mutant(tree: Path, path: Path, operator: str, occurrence: int, quick: list[str]) -> bool:
    """Whether a test fails with it."""
    code = path.read_text()
    path.write_text(mutate_code(code, get_operator(operator)(), occurrence))
    try:
        words = path.stem.split("_")
        first = sorted(quick, key=lambda test: not any(word in test for word in words))
        return pytest(tree, ["-x", *first]) != 0
    except subprocess.TimeoutExpired:
        return True
    finally:
        path.write_text(code)


def pytest(tree: Path, words: list[str], **settings: str) -> int:
    """The exit code of the tests of a tree."""
    places = f"{tree / 'src'}{os.pathsep}{tree / 'tests'}"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": places, **settings}
    environment |= {"PYTHONDONTWRITEBYTECODE": "1", "CI": "1"}
    asked = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *words]
    limit = None if settings else SLOWEST
    return subprocess.run(
        asked, cwd=tree, env=environment, capture_output=True, check=False, timeout=limit
    ).returncode


def describe(tree: Path, path: Path, operator: str, occurrence: int) -> str:
    """Where it is, what was there and what is."""
    code = path.read_text().splitlines()
    changed = mutate_code(path.read_text(), get_operator(operator)(), occurrence).splitlines()
    pairs = enumerate(zip(code, changed, strict=False), 1)
    line, (old, new) = next(each for each in pairs if each[1][0] != each[1][1])
    place = path.relative_to(tree / "src" / "saccade")
    return f"{place}:{line}: {old.strip()}  ->  {new.strip()}"


def wilson(killed: int, count: int) -> tuple[float, float]:
    """The interval of Wilson for a share."""
    z, share = 1.96, killed / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count)
    half *= (share * (1 - share) / count + z * z / (4 * count * count)) ** 0.5
    return middle - half, middle + half


if __name__ == "__main__":
    main()
