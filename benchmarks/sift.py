"""SIFT against OpenCV's in the same process: `uv run python benchmarks/sift.py [--pairs DIR]`.

Ours and OpenCV's run in turns on the same photographs; what is printed is the median of
the ratios of neighboring runs, so that a machine that slows down slows down both.
"""

import argparse
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np

from saccade import Sift, SiftConfig

SIZES = {"VGA": (640, 480), "XGA": (1024, 768), "HD": (1920, 1080), "12 MP": (4000, 3000)}
PRESETS = ("recommended", "opencv")
CONTESTS = {"recommended": False, "equal": True, "opencv": False}
"""Name of each row, and whether the contrast threshold of `recommended` is chosen for every
photograph so that there are as many points as OpenCV finds."""
PARITY = 0.03  # share by which the numbers of points may differ


@dataclass(frozen=True)
class Timing:
    """Ours and OpenCV's on some photographs of one size."""

    ours_ms: float
    opencv_ms: float
    ratio: float
    points: int
    opencv_points: int


def photographs(pairs: Path | None) -> list[np.ndarray]:
    if pairs is None:
        rocket = files("saccade") / "data" / "rocket.jpg"
        return [cv2.imread(str(rocket), cv2.IMREAD_GRAYSCALE)]
    found = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted(pairs.rglob("1.png"))]
    if not found:
        sys.exit(f"{pairs}: expected folders with 1.png")
    return found


def resized(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    smaller = size[0] < image.shape[1]
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC)


def with_as_many(image: np.ndarray, wanted: int) -> SiftConfig:
    """`recommended` with the contrast threshold at which it finds about `wanted` points."""
    low, high = 1e-4, 0.1
    config = SiftConfig.recommended()
    for _ in range(12):
        config = replace(config, contrast_threshold=(low * high) ** 0.5)
        found = len(Sift(config)(image, describe=False))
        if abs(found / wanted - 1) < PARITY / 3:
            break
        low, high = (
            (config.contrast_threshold, high)
            if found > wanted
            else (low, config.contrast_threshold)
        )
    return config


def timing(image: np.ndarray, contest: str, threads: int, runs: int, describe: bool) -> Timing:
    """Detection, with description unless told otherwise, by both in turns."""
    cv2.setNumThreads(threads)
    theirs = cv2.SIFT.create()
    if CONTESTS[contest]:
        config = with_as_many(image, len(theirs.detect(image)))
    else:
        config = getattr(SiftConfig, contest)()
    run_theirs = (
        (lambda: theirs.detectAndCompute(image, None)[0])
        if describe
        else (lambda: theirs.detect(image))
    )
    sift = Sift(config, threads=threads)
    wanted, found = len(run_theirs()), len(sift(image, describe=describe))
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        run_theirs()
        middle = time.perf_counter()
        sift(image, describe=describe)
        times.append((middle - start, time.perf_counter() - middle))
    opencv_time, our_time = np.array(times).T * 1e3
    return Timing(
        float(np.median(our_time)),
        float(np.median(opencv_time)),
        float(np.median(opencv_time / our_time)),
        found,
        wanted,
    )


def peak_bytes_per_pixel(size: tuple[int, int], preset: str, pairs: Path | None) -> float:
    """What detection adds to the most memory a fresh process has had."""
    script = [sys.executable, __file__, "--memory", preset, "--size", *map(str, size)]
    if pairs is not None:
        script += ["--pairs", str(pairs)]
    printed = subprocess.run(script, capture_output=True, text=True, check=True).stdout
    return float(printed) / (size[0] * size[1])


def print_memory(preset: str, size: tuple[int, int], pairs: Path | None) -> None:
    image = resized(photographs(pairs)[0], size)
    small = image[:200, :200].copy()
    detect = cv2.SIFT.create().detectAndCompute if preset == "peer" else None
    sift = None if preset == "peer" else Sift(getattr(SiftConfig, preset)())

    def run(picture: np.ndarray) -> None:
        if sift is None:
            detect(picture, None)
        else:
            sift(picture)

    run(small)
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak of the imports
    before = peak_kilobytes()
    run(image)
    print((peak_kilobytes() - before) * 1024)


def peak_kilobytes() -> int:
    """The most memory this process had since the peak was last forgotten; Linux only."""
    status = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=Path, help="folder of sequences with 1.png")
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--sizes", nargs="+", choices=SIZES, default=list(SIZES))
    parser.add_argument("--photographs", type=int, default=8, help="at most")
    parser.add_argument("--detect-only", action="store_true")
    parser.add_argument("--memory", help=argparse.SUPPRESS)
    parser.add_argument("--size", type=int, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.memory:
        print_memory(options.memory, tuple(options.size), options.pairs)
        return
    images = photographs(options.pairs)[: options.photographs]
    print("size   threads  preset        ours ms  OpenCV ms  ratio  us/point  points  of OpenCV's")
    for name in options.sizes:
        for threads in options.threads:
            for contest in CONTESTS:
                found = [
                    timing(
                        resized(image, SIZES[name]),
                        contest,
                        threads,
                        options.runs,
                        not options.detect_only,
                    )
                    for image in images
                ]
                ours, theirs = (
                    np.mean([getattr(each, field) for each in found])
                    for field in ("ours_ms", "opencv_ms")
                )
                points = sum(each.points for each in found)
                share = points / sum(each.opencv_points for each in found)
                ratio = np.median([each.ratio for each in found])
                print(
                    f"{name:6} {threads:7}  {contest:12} {ours:8.1f} {theirs:10.1f} {ratio:6.2f} "
                    f"{1e3 * ours * len(found) / points:9.1f} {points // len(found):7} "
                    f"{share:7.3f}{'' if abs(share - 1) <= PARITY else ' (not within 3 %)'}",
                    flush=True,
                )
    for name in options.sizes:
        memory = [
            peak_bytes_per_pixel(SIZES[name], preset, options.pairs)
            for preset in (*PRESETS, "peer")
        ]
        print(
            f"{name}: peak bytes per pixel: "
            + ", ".join(
                f"{preset} {each:.0f}"
                for preset, each in zip((*PRESETS, "OpenCV"), memory, strict=True)
            )
        )


if __name__ == "__main__":
    main()
