"""Models of two views and the consistency of their poses, on pairs of known model.

    uv run python benchmarks/two_view_models.py

Points in space, on a plane, seen by a camera that turns, or by one that stands still; 0 to 60 % of
the matches are wrong. Quoted in docs/matching.md.
"""

import time
from dataclasses import dataclass

import cv2
import numpy as np

from measuring import arguments
from saccade import Keypoints, verify
from saccade.keypoints.verification import Verification
from saccade.types import FloatArray

K = np.array([[800.0, 0, 640], [0, 800, 360], [0, 0, 1]])
SIZE = np.array([1280, 720])
NOISE = 0.3
"""Standard deviation of a position in pixels."""
KEYPOINT_SIZE = 3.0


@dataclass(frozen=True)
class Pair:
    """Matches of a known motion."""

    matched: FloatArray
    """(m, 4) exact rows x1, y1, x2, y2."""
    rotation: FloatArray
    translation: FloatArray
    """Of length 1; 0 without motion."""


def pixels(points: FloatArray) -> FloatArray:
    """(m, 2) pixels of (m, 3) points in the frame of the camera."""
    projected = points @ K.T
    return projected[:, :2] / projected[:, 2:]


def pair_of(model: str, rng: np.random.Generator, count: int) -> Pair:
    """A pair with both images of every point inside the images."""
    R = cv2.Rodrigues(rng.normal(0, 0.08, 3))[0].astype(np.float64)
    t = rng.normal(size=3) * [1, 0.6, 1]
    t *= rng.uniform(0.2, 1.0) / np.linalg.norm(t)
    if model in ("panoramic", "still"):
        t = np.zeros(3)
    if model == "still":
        R = np.eye(3)
    n = rng.normal(size=3) * [0.5, 0.5, 0] + [0, 0, 1]
    found = np.zeros((0, 4))
    while len(found) < count:
        xy = rng.uniform([0, 0], SIZE, (4 * count, 2))
        rays = np.c_[xy, np.ones(len(xy))] @ np.linalg.inv(K).T
        depth = rng.uniform(3, 12, len(xy))
        if model == "planar":
            depth = 6 * n[2] / np.maximum(rays @ n, 0.1)
        moved = depth[:, None] * rays @ R.T + t
        seen = pixels(moved)
        inside = (moved[:, 2] > 0.5) & (seen >= 0).all(1) & (seen < SIZE).all(1)
        found = np.r_[found, np.c_[xy, seen][inside]][:count]
    length = np.linalg.norm(t)
    return Pair(found, R, t / length if length else t)


def verified(
    pair: Pair, wrong: float, calibrated: bool, rng: np.random.Generator
) -> tuple[Verification, float]:
    """The verification of noisy matches, a fraction of them wrong, and its CPU milliseconds."""
    noisy = pair.matched + rng.normal(0, NOISE, pair.matched.shape)
    count = round(wrong * len(noisy))
    noisy[:count, 2:] = rng.uniform([0, 0], SIZE, (count, 2))
    points = [Keypoints.at(noisy[:, part], KEYPOINT_SIZE) for part in (slice(2), slice(2, 4))]
    index = np.stack([np.arange(len(noisy))] * 2, 1)
    start = time.process_time()
    found = (
        verify(*points, index, "essential", intrinsics=K)
        if calibrated
        else verify(*points, index, "fundamental")
    )
    return found, 1e3 * (time.process_time() - start)


def normalized_error(found: Verification, pair: Pair, rows: slice) -> tuple[float, int]:
    """Normalized squared error of a pose, or of a part of it, and its degrees of freedom."""
    pose = found.pose
    if (
        pose is None
        or pose.covariance is None
        or not np.isfinite(pose.covariance[rows, rows]).all()
    ):
        return np.nan, 0
    turn = cv2.Rodrigues(pair.rotation @ pose.rotation.T)[0].ravel()
    error = np.concatenate([turn, pair.translation - pose.translation])[rows]
    values, vectors = np.linalg.eigh(pose.covariance[rows, rows])
    free = values > 1e-9 * values[-1]
    return float(((vectors[:, free].T @ error) ** 2 / values[free]).sum()), int(free.sum())


def main() -> None:
    given = arguments(__doc__, pairs=50, matches=300, wrong=[0.0, 0.2, 0.4, 0.6])
    print("model      calibrated  wrong   right  direction NEES/2 (n)  rotation NEES/3  ms")
    for model in ("general", "planar", "panoramic", "still"):
        for calibrated in (True, False):
            for wrong in given.wrong:
                right, times = 0, []
                errors: dict[str, list[float]] = {"direction": [], "rotation": []}
                for seed in range(given.pairs):
                    rng = np.random.default_rng((seed, len(model), round(100 * wrong)))
                    pair = pair_of(model, rng, given.matches)
                    found, ms = verified(pair, wrong, calibrated, rng)
                    right += found.model == model
                    times.append(ms)
                    for name, rows in (("direction", slice(3, 6)), ("rotation", slice(3))):
                        value, free = normalized_error(found, pair, rows)
                        if free:
                            errors[name].append(value / free)
                cells = [f"{np.mean(e):.2f} ({len(e)})" if e else "-" for e in errors.values()]
                print(
                    f"{model:10} {calibrated!s:10} {wrong:6.1f} {right / given.pairs:7.2f} "
                    f"{cells[0]:>20} {cells[1]:>16} {np.median(times):6.1f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
