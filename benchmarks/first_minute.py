"""The first minute: what a newcomer waits for, `uv run --no-dev benchmarks/first_minute.py`.

Each command runs in an environment of its own, made by `uv sync --no-dev` in a temporary folder, so
that neither kernels nor bytecode nor Matplotlib's fonts are in a cache; then again, `--warm` times,
of which the fastest counts. "CPU" is that of the command and its processes. Installing is not
counted. It uses all cores: run it on an idle machine.

    uv run --no-dev benchmarks/first_minute.py --only look --warm 5
"""

import argparse
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
DATA = ROOT / "src" / "saccade" / "data"
COMMANDS = {
    "look": ["look", str(DATA / "rocket.jpg")],
    "slam": ["slam", str(DATA / "victoria_park.txt")],
    "demo": ["demo"],
}
BARS = {"look": (8.0, 1.5), "slam": (15.0, None), "demo": (40.0, None)}
"""Seconds that the first run and later ones may take."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", choices=[*COMMANDS], nargs="+", default=[*COMMANDS])
    parser.add_argument("--warm", type=int, default=3, metavar="N", help="later runs")
    arguments = parser.parse_args()
    print(f"{'command':8}{'run':8}{'wall [s]':>10}{'CPU [s]':>10}{'bar [s]':>10}")
    for name in arguments.only:
        with tempfile.TemporaryDirectory() as folder:
            home = Path(folder)
            environment = install(home)
            runs = [timed(name, home, environment) for _ in range(1 + arguments.warm)]
        print_row(name, "first", runs[0], BARS[name][0])
        if arguments.warm > 0:
            print_row(name, "later", min(runs[1:]), BARS[name][1])


def install(home: Path) -> dict[str, str]:
    """A fresh environment in a folder; returns the variables of its commands."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("NUMBA_", "PYTHON", "XDG_", "MPL", "VIRTUAL_ENV"))
    }
    place = {"UV_PROJECT_ENVIRONMENT": str(home / "venv")}
    command = ["uv", "sync", "--no-dev", "--no-editable", "--frozen", "--quiet"]
    subprocess.run(command, cwd=ROOT, env=kept | place, check=True)
    return kept | {"HOME": str(home)}


def timed(name: str, home: Path, environment: dict[str, str]) -> tuple[float, float]:
    """Wall and CPU seconds of a command."""
    command = [str(home / "venv" / "bin" / "saccade"), *COMMANDS[name], "--out", str(home / name)]
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=home, env=environment, check=True, capture_output=True)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def print_row(name: str, run: str, seconds: tuple[float, float], bar: float | None) -> None:
    limit = "" if bar is None else f"{bar:.1f}"
    print(f"{name:8}{run:8}{seconds[0]:10.1f}{seconds[1]:10.1f}{limit:>10}", flush=True)


if __name__ == "__main__":
    main()
