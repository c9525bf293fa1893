"""Where the default of SIFT departs from the print: what that does to places and directions.

`uv run python benchmarks/textbook.py`; the figures are in `docs/appendices.md`.
"""

from importlib.resources import files

import numpy as np

import saccade
from saccade.textbook import sift

PHOTOGRAPHS = ("coffee", "chelsea", "rocket", "astronaut", "hallway_1")


def main() -> None:
    fast = saccade.Sift()
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:64, :64]
    errors = []
    for sigma in np.repeat([2.0, 2.5, 3.0, 4.0], 10):
        center = 31 + rng.random(2)
        blob = 0.1 + 0.8 * np.exp(-((x - center[0]) ** 2 + (y - center[1]) ** 2) / (2 * sigma**2))
        found = sift(blob).keypoints, fast(blob.astype(np.float32))
        errors.append([np.linalg.norm(each.xy - center, axis=1).min() for each in found])
    textbook, default = np.mean(errors, axis=0)
    print(f"40 blobs, mean error of the center: textbook {textbook:.3f}, default {default:.4f} px")
    counts = []
    for name in PHOTOGRAPHS:
        image = saccade.read_image(str(files("saccade") / "data" / f"{name}.jpg"))
        printed, ours = sift(image), fast(image)
        kept = sum(each.fate == "kept" for each in printed.candidates)
        counts.append([len(printed.keypoints) / kept, len(ours) / len(np.unique(ours.xy, axis=0))])
    textbook, default = np.mean(counts, axis=0)
    print(f"orientations a point, mean of five: textbook {textbook:.2f}, default {default:.2f}")


if __name__ == "__main__":
    main()
