"""How long MUST and SymRoID take by what our SIFT takes, descriptors included.

Run with `uv run benchmarks/must.py [FOLDER ...]`: over the photographs of the package, and of
folders (of image sequences: the first image of each), at 640 x 480 to 4000 x 3000 pixels, on
one thread. The times are the least of some turns in which the three alternate. "default" is what
each finds by its defaults: the number of SIFT's points varies more from photograph to photograph.
"equal" is the same number of points of each. Given are the geometric mean of the ratios, and the
least and the greatest.
"""

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

import saccade

DATA = Path(saccade.__file__).parent / "data"
SIZES = {(640, 480): 1000, (1920, 1080): 3000, (4000, 3000): 10_000}
"""Width and height of the images, and the equal number of points."""
BAR = 1.5
"""What MUST may take at most, by what SIFT takes."""


def photographs(folders: list[Path]) -> list[Path]:
    """The photographs of the package, and the first image of each folder or sequence."""
    found = sorted(DATA.glob("*.jpg"))
    for folder in folders:
        sequences = sorted(each for each in folder.iterdir() if each.is_dir()) or [folder]
        for sequence in sequences:
            images = [each for each in sequence.iterdir() if each.suffix in (".png", ".jpg")]
            found.append(min(images))
    return found


def least_times(image: np.ndarray, count: int | None, rounds: int) -> np.ndarray:
    """(3,) seconds of SIFT, MUST and SymRoID."""
    regions = min(count or 50, 50)
    detectors = [
        saccade.Sift(saccade.SiftConfig(max_keypoints=count), threads=1),
        saccade.Must(saccade.MustConfig(max_keypoints=count), threads=1),
        saccade.SymRoid(saccade.SymRoidConfig(max_keypoints=regions), threads=1),
    ]
    times = np.full((rounds + 1, len(detectors)), np.inf)
    for turn in range(rounds + 1):  # the first compiles
        for i, detect in enumerate(detectors):
            start = time.process_time()
            detect(image)
            times[turn, i] = time.process_time() - start
    return times[1:].min(axis=0)


def main() -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path, help="more images")
    parser.add_argument("--rounds", type=int, default=7, help="turns at 640 x 480 (7)")
    parser.add_argument("--every", type=int, default=4, help="every n-th image at 4000 x 3000 (4)")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    paths = photographs(options.folders)
    print(f"{'size':12} {'points':8} {'images':>6} {'MUST / SIFT':>20} {'SymRoID / SIFT':>20}")
    for size, count in SIZES.items():
        large = size[0] > 1000
        chosen, rounds = (paths[:: options.every], 2) if large else (paths, options.rounds)
        grays = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in chosen]
        images = [cv2.resize(gray, size, interpolation=cv2.INTER_CUBIC) for gray in grays]
        for name, points in (("default", None), ("equal", count)):
            times = np.array([least_times(image, points, rounds) for image in images])
            ratios = times[:, 1:] / times[:, :1]
            cells = [
                f"{np.exp(np.log(column).mean()):.2f} ({column.min():.2f}-{column.max():.2f})"
                for column in ratios.T
            ]
            met = "met" if np.exp(np.log(ratios[:, 0]).mean()) <= BAR else "MISSED"
            text = " ".join(f"{cell:>20}" for cell in cells)
            label = f"{size[0]} x {size[1]}"
            print(f"{label:12} {name:8} {len(images):6} {text}  bar {BAR} {met}", flush=True)


if __name__ == "__main__":
    main()
