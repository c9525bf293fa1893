"""SIFT against OpenCV's in the same process (docs/measured.md).

    uv run python benchmarks/sift.py [--pairs DIR] [--threads 1] [--sizes VGA XGA]

Ours and OpenCV's take turns on the same photographs; printed are the median of the ratios of
neighboring runs, and the peak memory per pixel in a fresh process. "equal" has the contrast
threshold at which the default finds as many points as OpenCV in each photograph. The last lines
have the fraction of points found again after a turn of the photograph by 90 degrees.
"""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

from measuring import DATA, arguments, peak_bytes, resized, times_in_turns
from saccade import Sift, SiftConfig
from saccade.settings import load_settings

SIZES = {
    "VGA": (640, 480),
    "XGA": (1024, 768),
    "HD": (1920, 1080),
    "12 MP": (4000, 3000),
    "100 MP": (11547, 8660),
}
CONTESTS = ("default", "equal", "opencv")
SAME = 0.1
"""Pixels within which two points are the same."""
PARITY = 0.03
"""Fraction by which equal numbers of points may differ."""


def photographs(pairs: Path | None) -> list[np.ndarray]:
    paths = [DATA / "rocket.jpg"] if pairs is None else sorted(pairs.rglob("1.png"))
    return [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]


def config_of(contest: str, image: np.ndarray) -> SiftConfig:
    """The configuration of a contest on an image."""
    if contest != "equal":
        return load_settings("sift", contest)
    wanted, low, high = len(cv2.SIFT.create().detect(image)), 1e-4, 0.1
    config = SiftConfig()
    for _ in range(12):
        config = replace(config, contrast_threshold=(low * high) ** 0.5)
        found = len(Sift(config)(image, describe=False))
        if abs(found / wanted - 1) < PARITY / 3:
            break
        if found > wanted:
            low = config.contrast_threshold
        else:
            high = config.contrast_threshold
    return config


def contend(image: np.ndarray, contest: str, threads: int, runs: int) -> list[float]:
    """Milliseconds of both, OpenCV's time over ours, and the points of both."""
    cv2.setNumThreads(threads)
    theirs, ours = cv2.SIFT.create(), Sift(config_of(contest, image), threads=threads)
    actions = {
        "OpenCV": lambda: theirs.detectAndCompute(image, None),
        "saccade": lambda: ours(image),
    }
    times = 1e3 * times_in_turns(actions, runs)
    opencv, saccade = np.median(times, 0)
    ratio = np.median(times[:, 0] / times[:, 1])
    return [saccade, opencv, ratio, len(ours(image)), len(theirs.detect(image))]


def memory(image: np.ndarray, contest: str) -> float:
    """Peak bytes per pixel that detection and description add."""
    peer = cv2.SIFT.create()
    sift = Sift(SiftConfig()) if contest == "saccade" else None
    detect = sift or (lambda picture: peer.detectAndCompute(picture, None))
    detect(image[:200, :200].copy())
    before = peak_bytes(reset=True)
    detect(image)
    return (peak_bytes() - before) / image.size


def found_again(detect: Callable[[np.ndarray], np.ndarray], image: np.ndarray) -> float:
    """Fraction of the points of an image found within `SAME` after a turn by 90 degrees."""
    x, y = detect(image).T
    turned = np.stack([y, image.shape[1] - 1 - x], axis=1)
    distance, _ = cKDTree(detect(np.rot90(image).copy())).query(turned)
    return float((distance < SAME).mean())


def main() -> None:
    given = arguments(
        __doc__,
        pairs={"type": Path, "help": "folder of sequences with 1.png"},
        runs=9,
        threads=[1, 2],
        sizes={"nargs": "+", "choices": SIZES, "default": [*SIZES][:4]},
        photographs=8,
        memory={"choices": ("saccade", "OpenCV"), "help": "print bytes per pixel alone"},
    )
    images = photographs(given.pairs)[: given.photographs]
    if given.memory:
        print(memory(resized(images[0], SIZES[given.sizes[0]]), given.memory))
        return
    print("size    threads  preset        ours ms  OpenCV ms  ratio  points  of OpenCV's")
    for name in given.sizes:
        for threads in given.threads:
            for contest in CONTESTS:
                rows = [
                    contend(resized(image, SIZES[name]), contest, threads, given.runs)
                    for image in images
                ]
                ours, theirs, _, points, wanted = np.mean(rows, axis=0)
                ratio = np.median([row[2] for row in rows])
                print(
                    f"{name:7} {threads:7}  {contest:12} {ours:8.1f} {theirs:10.1f} {ratio:6.2f} "
                    f"{points:7.0f} {points / wanted:7.3f}",
                    flush=True,
                )
        for peer in ("saccade", "OpenCV"):
            command = [sys.executable, __file__, "--memory", peer, "--sizes", name]
            command += ["--pairs", str(given.pairs)] if given.pairs else []
            print(f"{name}: {peer} {float(subprocess.check_output(command)):.0f} bytes per pixel")
    peer, sift = cv2.SIFT.create(), Sift()
    detectors = {
        "saccade": lambda picture: sift(picture, describe=False).xy,
        "OpenCV": lambda picture: cv2.KeyPoint.convert(peer.detect(picture)),
    }
    for name, detect in detectors.items():
        fractions = [found_again(detect, resized(image, SIZES["VGA"])) for image in images]
        print(f"{name}: {np.mean(fractions):.3f} found again after a turn by 90 degrees")


if __name__ == "__main__":
    main()
