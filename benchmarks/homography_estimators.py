"""Homographies from the same matches by `verify`, OpenCV's MAGSAC and COLMAP's LO-RANSAC.

    uv run python benchmarks/homography_estimators.py PAIRS --detector sift --points 1000

PAIRS is a folder of sequences, see benchmarks/synthetic_pairs.py. Printed is the area under the
cumulative curve of the corner error up to 1, 3, 5 and 10 px. MAGSAC and COLMAP draw samples from a
fixed sequence of indices: each of `RUNS` orders of the matches is another draw, and theirs are
means over these.
"""

import argparse
from pathlib import Path

import numpy as np

from saccade.datasets.homography_pairs import homography_pairs
from saccade.evaluation.detectors import Detector, find_detector
from saccade.evaluation.features import (
    INLIER_PX,
    Features,
    corner_error,
    mean_precision,
    mutual_matches,
)
from saccade.exchange.colmap import import_pycolmap
from saccade.io.image import read_image
from saccade.keypoints.verification import sample_consensus, verify_positions

RUNS = 5
LIMITS = (1, 3, 5, 10)


def verified(matched: np.ndarray, sigma: np.ndarray) -> list[np.ndarray | None]:
    found = verify_positions(matched, sigma, "homography", INLIER_PX, min_inliers=4)
    return [found.H]


def magsac(matched: np.ndarray, _: np.ndarray) -> list[np.ndarray | None]:
    return [sample_consensus(rows, "homography", INLIER_PX)[0] for rows in orders(matched)]


def colmap(matched: np.ndarray, _: np.ndarray) -> list[np.ndarray | None]:
    pycolmap = import_pycolmap()
    options = pycolmap.RANSACOptions()
    options.max_error, options.random_seed = INLIER_PX, 0
    found = [
        pycolmap.estimate_homography_matrix(rows[:, :2], rows[:, 2:], options)
        for rows in orders(matched)
    ]
    return [None if each is None else np.asarray(each["H"], np.float64) for each in found]


def orders(matched: np.ndarray) -> list[np.ndarray]:
    return [matched[np.random.default_rng(run).permutation(len(matched))] for run in range(RUNS)]


ESTIMATORS = {"verify": verified, "magsac": magsac, "colmap": colmap}


def areas(detect: Detector, pairs: list, estimators: list[str]) -> dict[str, np.ndarray]:
    """By estimator, (pairs, limits) areas under the curve."""
    found: dict[str, list] = {name: [] for name in estimators}
    for pair in pairs:
        images = (read_image(pair.first), read_image(pair.second))
        first, second = (Features.of(detect(image), image.shape[:2]) for image in images)
        _, kept, index = mutual_matches(first, second, pair.homography, 0.8)
        i, j = index[kept].T
        matched = np.hstack([first.xy[i], second.xy[j]])
        sigma = np.stack([first.position_sigma[i], second.position_sigma[j]], axis=1)
        for name, rows in found.items():
            estimates = ESTIMATORS[name](matched, sigma)
            errors = [corner_error(each, pair.homography, first.shape) for each in estimates]
            rows.append([mean_precision(np.array(errors), limit) for limit in LIMITS])
    return {name: np.array(rows) for name, rows in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pairs", type=Path)
    parser.add_argument("--detector", action="append", help="as of saccade evaluate features")
    parser.add_argument("--estimator", action="append", choices=ESTIMATORS)
    parser.add_argument("--points", type=int)
    options = parser.parse_args()
    pairs = homography_pairs(options.pairs)
    estimators = options.estimator or ["verify", "magsac"]
    for name in options.detector or ["sift"]:
        detect = find_detector(name, None, options.points)
        for estimator, rows in areas(detect, pairs, estimators).items():
            print(f"{name:16}{estimator:10}", *(f"{area:.3f}" for area in rows.mean(axis=0)))


if __name__ == "__main__":
    main()
