"""Time of the first and later runs of commands (docs/robustness.md).

    uv run --no-dev benchmarks/first_minute.py --only look --warm 5

Each command runs in an environment of its own, made by `uv sync --no-dev` in a temporary folder, so
that neither kernels nor bytecode nor Matplotlib's fonts are in a cache; then again, `--warm` times,
of which the fastest counts. "CPU" is that of the command and its processes. Installing is not
counted. It uses all cores: run it on an idle machine.
"""

import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path

from measuring import DATA, arguments

ROOT = Path(__file__).parents[1]
COMMANDS = {
    "look": ["look", str(DATA / "rocket.jpg")],
    "slam": ["slam", str(DATA / "victoria_park.txt")],
    "demo": ["demo"],
}


def main() -> None:
    given = arguments(
        __doc__,
        only={"choices": COMMANDS, "nargs": "+", "default": list(COMMANDS)},
        warm={"type": int, "default": 3, "help": "number of later runs"},
    )
    print(f"{'command':8}{'run':8}{'wall [s]':>10}{'CPU [s]':>10}")
    for name in given.only:
        with tempfile.TemporaryDirectory() as folder:
            home = Path(folder)
            environment = install(home)
            runs = [timed(name, home, environment) for _ in range(1 + given.warm)]
        for run, times in (("first", runs[:1]), ("later", runs[1:])):
            if times:
                wall, cpu = min(times)
                print(f"{name:8}{run:8}{wall:10.1f}{cpu:10.1f}", flush=True)


def install(home: Path) -> dict[str, str]:
    """A fresh environment in a folder; returns the variables of its commands."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("NUMBA_", "PYTHON", "XDG_", "MPL", "VIRTUAL_ENV"))
    }
    place = {"UV_PROJECT_ENVIRONMENT": str(home / "venv")}
    command = ["uv", "sync", "--no-dev", "--no-editable", "--frozen", "--quiet"]
    command += ["--refresh-package", "pysaccade"]  # or uv installs what it built before
    subprocess.run(command, cwd=ROOT, env=kept | place, check=True)
    return kept | {"HOME": str(home)}


def timed(name: str, home: Path, environment: dict[str, str]) -> tuple[float, float]:
    """Wall and CPU seconds of a command."""
    command = [str(home / "venv" / "bin" / "saccade"), *COMMANDS[name], "--out", str(home / name)]
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=home, env=environment, check=True, capture_output=True)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
