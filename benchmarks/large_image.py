"""SIFT on one large image: `uv run python benchmarks/large_image.py [--megapixels 100]`.

Prints the time and the most memory that detection and description add to a process. The
image is a photograph, mirrored into tiles, so that it has as many points to the pixel.
"""

import argparse
import time
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np

from saccade import Sift, SiftConfig


def large_image(megapixels: float) -> np.ndarray:
    photo = cv2.imread(str(files("saccade") / "data" / "rocket.jpg"), cv2.IMREAD_GRAYSCALE)
    height = round((megapixels * 1e6 * 3 / 4) ** 0.5)
    width = round(megapixels * 1e6 / height)
    rows, columns = -(-height // photo.shape[0]), -(-width // photo.shape[1])
    tile = np.block([[photo, photo[:, ::-1]], [photo[::-1], photo[::-1, ::-1]]])
    return np.tile(tile, (-(-rows // 2), -(-columns // 2)))[:height, :width].copy()


def peak_bytes() -> int:
    """The most memory this process had since the peak was last forgotten; Linux only."""
    status = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megapixels", type=float, default=100)
    parser.add_argument("--preset", default="recommended")
    parser.add_argument("--threads", type=int, help="one per core unless given")
    parser.add_argument("--detect-only", action="store_true")
    options = parser.parse_args()
    cv2.setNumThreads(options.threads or cv2.getNumberOfCPUs())
    config = getattr(SiftConfig, options.preset)()
    image = large_image(options.megapixels)
    Sift(config)(image[:500, :500])  # compiles
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak of what came before
    before, start = peak_bytes(), time.perf_counter()
    found = Sift(config, threads=options.threads)(image, describe=not options.detect_only)
    seconds, peak = time.perf_counter() - start, peak_bytes() - before
    height, width = image.shape
    print(
        f"{width} x {height}, {options.preset}: {len(found)} points in {seconds:.1f} s, "
        f"{peak / 1e9:.2f} GB more than before, {peak / image.size:.0f} bytes per pixel"
    )


if __name__ == "__main__":
    main()
