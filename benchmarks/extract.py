"""Cost of `saccade extract` beside the work itself (docs/extract.md).

    uv run python benchmarks/extract.py [--only overhead]

- overhead: one worker against a loop that reads and detects, and the bytes of a point
- workers: two workers against one, and two independent loops against one
- memory: peak of a run over 10000 small images, relative to one over 1000
- again: a second run with nothing to do
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from measuring import DATA, arguments, resized, seconds

LOOP = """
import sys, cv2, saccade
cv2.setNumThreads(1)
sift = saccade.Sift(threads=1)
print(sum(len(sift(saccade.read_image(path))) for path in sys.argv[1:]))
"""
PEAK = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def photographs(folder: Path, count: int) -> None:
    """VGA photographs as JPEG, each a little different from all others."""
    found = [cv2.imread(str(path)) for path in sorted(DATA.glob("*.jpg"))]
    folder.mkdir()
    for number in range(count):
        image = resized(found[number % len(found)], (640, 480))
        cv2.imwrite(str(folder / f"{number:05d}.jpg"), np.roll(image, number, axis=1))


def command(source: Path, out: Path, workers: int) -> list[str]:
    program = str(Path(sys.executable).with_name("saccade"))
    return [program, "extract", str(source), "--out", str(out), "--workers", str(workers)]


def run(*commands: list[str]) -> str:
    """Standard output of the first of several commands that run at once."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    jobs = [
        subprocess.Popen(each, env=environment, stdout=subprocess.PIPE, text=True)
        for each in commands
    ]
    outputs = [job.communicate()[0] for job in jobs]
    if any(job.returncode for job in jobs):
        sys.exit(f"failed: {commands}")
    return outputs[0]


def loops(source: Path, count: int) -> list[list[str]]:
    """Commands that detect in parts of the images and discard the results."""
    paths = sorted(map(str, source.iterdir()))
    return [[sys.executable, "-c", LOOP, *paths[k::count]] for k in range(count)]


def overhead(source: Path, out: Path, runs: int) -> None:
    ratios = []
    for number in range(runs + 1):  # the first compiles
        times = []
        for each in (loops(source, 1)[0], command(source, out / f"one{number}", 1)):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            run(each)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        ratios.append(times[1] / times[0])
    points = int(run(*loops(source, 1)))
    size = sum(path.stat().st_size for path in (out / "one0").rglob("*.parquet"))
    print(
        f"overhead: {np.median(ratios[1:]) - 1:.1%} of CPU time, {size / points:.1f} bytes a point"
    )


def workers(source: Path, out: Path, runs: int) -> None:
    gains = []
    for number in range(runs):
        loop1, loop2 = (seconds(lambda n=n: run(*loops(source, n))) for n in (1, 2))
        works = [command(source, out / f"workers{number}-{n}", n) for n in (1, 2)]
        one, two = (seconds(lambda words=words: run(words)) for words in works)
        gains.append((one / two, loop1 / loop2))
    print("two workers {:.2f} times one, two loops {:.2f}".format(*np.median(gains, 0)))


def memory(_: Path, out: Path, __: int) -> None:
    packed = cv2.imencode(".png", cv2.imread(str(DATA / "hallway_1.jpg"))[100:164, 100:196])[1]
    peaks = []
    for count in (1000, 10_000):
        folder = out / f"small{count}"
        folder.mkdir()
        for number in range(count):
            (folder / f"{number:06d}.png").write_bytes(packed.tobytes())
        words = command(folder, out / f"peak{count}", 1)
        peaks.append(int(run([sys.executable, "-c", PEAK, *words])) / 1024)
    print(
        f"memory: {peaks[1]:.0f} MB, {peaks[1] / peaks[0]:.3f} times as much for ten times as many"
    )


def again(source: Path, out: Path, _: int) -> None:
    words = command(source, out / "again", 1)
    run(words)
    empty = seconds(lambda: run([words[0], "extract", "--help"]))
    took = seconds(lambda: run(words)) - empty
    print(f"nothing to do: {1e3 * took / len(list(source.iterdir())):.2f} ms an image")


PARTS = {each.__name__: each for each in (overhead, workers, memory, again)}


def main() -> None:
    given = arguments(__doc__, images=96, runs=5, only={"choices": PARTS})
    with tempfile.TemporaryDirectory() as name:
        source = Path(name, "photographs")
        photographs(source, given.images)
        for part, measure in PARTS.items():
            if given.only in (None, part):
                measure(source, Path(name), given.runs)


if __name__ == "__main__":
    main()
