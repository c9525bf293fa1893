"""Time of MUST and SymRoID relative to SIFT, descriptors included (docs/measured.md).

    uv run python benchmarks/must.py [FOLDER ...]

Photographs of the package and of folders (of image sequences: the first image of each), at
640 x 480 to 4000 x 3000 pixels, on one thread. The three take turns. "default" is by the defaults,
"equal" with the same number of points of each. Printed are the geometric mean of the ratios of the
least times, and the least and the greatest ratio.
"""

from pathlib import Path

import cv2
import numpy as np

import saccade
from measuring import DATA, arguments, resized, times_in_turns
from saccade.io.image import find_images

SIZES = {(640, 480): 1000, (1920, 1080): 3000, (4000, 3000): 10_000}
"""Equal number of points by width and height."""


def photographs(folders: list[Path]) -> list[Path]:
    """The photographs of the package, and the first image of each folder or sequence."""
    found = sorted(DATA.glob("*.jpg"))
    for folder in folders:
        sequences = sorted(each for each in folder.iterdir() if each.is_dir()) or [folder]
        found += [min(find_images(sequence)) for sequence in sequences]
    return found


def ratios(image: np.ndarray, count: int | None, rounds: int) -> np.ndarray:
    """(2,) least times of MUST and SymRoID over that of SIFT."""
    regions = saccade.SymRoidConfig(max_keypoints=min(count or 50, 50))
    detectors = {
        "SIFT": saccade.Sift(saccade.SiftConfig(max_keypoints=count), threads=1),
        "MUST": saccade.Must(saccade.MustConfig(max_keypoints=count), threads=1),
        "SymRoID": saccade.SymRoid(regions, threads=1),
    }
    actions = {name: (lambda d=detect: d(image)) for name, detect in detectors.items()}
    times = times_in_turns(actions, rounds).min(axis=0)
    return times[1:] / times[0]


def main() -> None:
    given = arguments(
        __doc__,
        folders={"flags": "folders", "nargs": "*", "type": Path},
        rounds=7,
        every=4,
    )
    cv2.setNumThreads(1)
    paths = photographs(given.folders)
    print(f"{'size':12} {'points':8} {'images':>6} {'MUST / SIFT':>20} {'SymRoID / SIFT':>20}")
    for size, count in SIZES.items():
        large = size[0] > 1000
        chosen, rounds = (paths[:: given.every], 2) if large else (paths, given.rounds)
        images = [resized(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), size) for path in chosen]
        for name, points in (("default", None), ("equal", count)):
            table = np.array([ratios(image, points, rounds) for image in images])
            cells = (
                f"{np.exp(np.log(column).mean()):.2f} ({column.min():.2f}-{column.max():.2f})"
                for column in table.T
            )
            text = " ".join(f"{cell:>20}" for cell in cells)
            print(f"{size[0]:4} x {size[1]:4}  {name:8} {len(images):6} {text}", flush=True)


if __name__ == "__main__":
    main()
