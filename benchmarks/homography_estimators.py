"""Homographies from the same matches by `verify`, OpenCV's MAGSAC and COLMAP's LO-RANSAC.

    uv run python benchmarks/homography_estimators.py PAIRS --detector sift --points 1000

Quoted in docs/keypoints.md. PAIRS is a folder of sequences, see benchmarks/synthetic_pairs.py.
Printed is the area under the cumulative curve of the corner error up to 1, 3, 5 and 10 px. MAGSAC
and COLMAP draw samples from a fixed sequence of indices: each of `RUNS` orders of the matches is
another draw, and theirs are means over these.
"""

from pathlib import Path

import numpy as np

from measuring import arguments
from saccade.datasets.homography_pairs import HomographyPair, homography_pairs
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
from saccade.types import FloatArray

RUNS = 5
LIMITS = (1, 3, 5, 10)


def by_colmap(rows: FloatArray) -> FloatArray | None:
    """(3, 3) homography of matches (m, 4)."""
    pycolmap = import_pycolmap()
    options = pycolmap.RANSACOptions()
    options.max_error, options.random_seed = INLIER_PX, 0
    found = pycolmap.estimate_homography_matrix(rows[:, :2], rows[:, 2:], options)
    return None if found is None else np.asarray(found["H"], np.float64)


PEERS = {
    "magsac": lambda rows: sample_consensus(rows, "homography", INLIER_PX)[0],
    "colmap": by_colmap,
}


def areas(detect: Detector, pair: HomographyPair, estimators: list[str]) -> FloatArray:
    """(estimators, limits) areas under the curve."""
    images = (read_image(pair.first), read_image(pair.second))
    first, second = (Features.of(detect(image), image.shape[:2]) for image in images)
    _, kept, index = mutual_matches(first, second, pair.homography, 0.8)
    i, j = index[kept].T
    matched = np.hstack([first.xy[i], second.xy[j]])
    sigma = np.stack([first.position_sigma[i], second.position_sigma[j]], axis=1)
    orders = [matched[np.random.default_rng(k).permutation(len(i))] for k in range(RUNS)]
    found = {name: map(PEERS[name], orders) for name in estimators if name in PEERS}
    ours = verify_positions(matched, sigma, "homography", INLIER_PX, min_inliers=4)
    found["verify"] = iter([ours.H])
    rows = []
    for name in estimators:
        errors = [corner_error(each, pair.homography, first.shape) for each in found[name]]
        rows.append([mean_precision(np.array(errors), limit) for limit in LIMITS])
    return np.array(rows)


def main() -> None:
    given = arguments(
        __doc__,
        pairs={"flags": "pairs", "type": Path},
        detector=["sift"],
        estimator={"nargs": "+", "choices": ["verify", *PEERS], "default": ["verify", "magsac"]},
        points={"type": int},
    )
    for name in given.detector:
        detect = find_detector(name, None, given.points)
        rows = [areas(detect, pair, given.estimator) for pair in homography_pairs(given.pairs)]
        for estimator, row in zip(given.estimator, np.mean(rows, axis=0), strict=True):
            print(f"{name:16}{estimator:10}", *(f"{area:.3f}" for area in row))


if __name__ == "__main__":
    main()
