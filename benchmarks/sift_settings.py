"""What settings of SIFT do: `uv run python benchmarks/sift_settings.py --pairs DIR`.

Prints the tables of docs/keypoints.md: scores on pairs of images of one plane, the time as a
share of the default's in the same run, and what roll leaves of upright points.
"""

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

from saccade import Sift, SiftConfig, match
from saccade.datasets.homography_pairs import homography_pairs
from saccade.evaluation.features import score_detector

SETTINGS = {
    "default": {},
    '`descriptor="sift"`': {"descriptor": "sift"},
    "`first_octave=0`": {"first_octave": 0},
    "`upright=True`": {"upright": True},
    "`max_keypoints=1000`": {"max_keypoints": 1000},
    '`max_keypoints=1000, ranking="response"`': {"max_keypoints": 1000, "ranking": "response"},
    "`max_keypoints=1000, spread=True`": {"max_keypoints": 1000, "spread": True},
}
SCORES = ("repeatability", "mma_3", "ratio_3", "auc_5")


def scores(sift: Sift, pairs: list) -> list[float]:
    """Points, and the mean of each score."""
    mean = score_detector(sift, pairs).mean()
    return [mean.keypoints, *(getattr(mean, name) for name in SCORES)]


def time_shares(detectors: dict[str, Sift], image: np.ndarray, runs: int) -> dict[str, float]:
    """The time of each as a share of the first's, all in turns."""
    times = {name: [] for name in detectors}
    for _ in range(runs + 1):  # the first compiles
        for name, sift in detectors.items():
            start = time.perf_counter()
            sift(image)
            times[name].append(time.perf_counter() - start)
    first = np.array(next(iter(times.values()))[1:])
    return {name: float(np.median(np.array(each[1:]) / first)) for name, each in times.items()}


def right_matches(sift: Sift, image: np.ndarray, degrees: float) -> int:
    """Matches between an image and itself rolled that are right to 3 px."""
    height, width = image.shape
    turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, 1)
    rolled = cv2.warpAffine(image, turn, (width, height), flags=cv2.INTER_LANCZOS4)
    here, there = sift(image), sift(rolled)
    pairs = match(here, there)
    expected = here.xy[pairs[:, 0]] @ turn[:, :2].T + turn[:, 2]
    return int((np.hypot(*(expected - there.xy[pairs[:, 1]]).T) < 3).sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=Path, required=True, help="folder of sequences")
    parser.add_argument("--runs", type=int, default=9)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    pairs = homography_pairs(options.pairs)
    image = cv2.imread(str(pairs[0].first), cv2.IMREAD_GRAYSCALE)
    detectors = {name: Sift(SiftConfig(**each), threads=1) for name, each in SETTINGS.items()}
    shares = time_shares(detectors, image, options.runs)
    print("| | points | repeatability | matches right | with ratio test | homography | time |")
    print("|---|---|---|---|---|---|---|")
    for name, sift in detectors.items():
        points, *values = scores(sift, pairs)
        cells = [f"{value:.3f}".removeprefix("0") for value in values]
        print(f"| {name} | {points:.0f} | {' | '.join(cells)} | {shares[name]:.2f} |", flush=True)
    for degrees in (5, 10, 15, 20, 25):
        upright, default = (
            right_matches(detectors[name], image, degrees) for name in ("`upright=True`", "default")
        )
        print(f"roll {degrees} degrees: {upright} right upright, {default} by default")


if __name__ == "__main__":
    main()
