# /// script
# requires-python = ">=3.11"
# dependencies = ["pysaccade", "opencv-contrib-python-headless"]
#
# [tool.uv]
# override-dependencies = ["opencv-python-headless; python_version < '0'"]
#
# [tool.uv.sources]
# pysaccade = { path = "..", editable = true }
# ///
"""Contrast saliency against OpenCV's FineGrained (docs/measured.md).

    uv run benchmarks/saliency.py [--json]

FineGrained lives in OpenCV's contrib build, which cannot stand beside the plain one: the script
has an environment of its own. The two take turns; the ratio of their shortest times counts, of a
photograph of 8 bits and of the same in floating point, as `read_image` returns it.
"""

import json
from typing import Any

import cv2
import numpy as np

import saccade
from measuring import DATA, arguments, times_in_turns
from saccade.attention import SaliencyMaps, scanpath

SIZES = ((640, 480), (1024, 768))


def photograph(width: int, height: int) -> np.ndarray:
    """(height, width, 3) uint8 RGB."""
    pixels = (saccade.read_image(DATA / "rocket.jpg") * 255 + 0.5).astype(np.uint8)
    return cv2.resize(pixels, (width, height), interpolation=cv2.INTER_CUBIC)


def against_fine_grained(size: tuple[int, int], threads: int, rounds: int) -> dict[str, Any]:
    """Shortest times in milliseconds, and the ratios of ours to FineGrained's."""
    cv2.setNumThreads(threads)
    rgb = photograph(*size)
    as_float, bgr = rgb.astype(np.float32) / 255, np.ascontiguousarray(rgb[:, :, ::-1])
    peer = cv2.saliency.StaticSaliencyFineGrained_create()
    maps = SaliencyMaps(saccade.contrast_saliency(rgb).saliency, rgb.shape[:2])
    actions = {
        "contrast": lambda: saccade.contrast_saliency(rgb),
        "contrast_float": lambda: saccade.contrast_saliency(as_float),
        "fine_grained": lambda: peer.computeSaliency(bgr),
        "scanpath": lambda: scanpath(maps, fixations=10),
    }
    times = 1e3 * times_in_turns(actions, rounds).min(0)
    row = {"threads": threads, "size": size, **dict(zip(actions, times.tolist(), strict=True))}
    ratios = (times[:2] / times[2]).tolist()
    return row | dict(zip(("ratio", "ratio_float"), ratios, strict=True))


def main() -> None:
    given = arguments(__doc__, rounds=40, json=False)
    rows = [against_fine_grained(s, n, given.rounds) for n in (1, 2) for s in SIZES]
    if given.json:
        print(json.dumps(rows, indent=2))
        return
    for row in rows:
        cells = (f"{k} {v:.3f}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items())
        print("; ".join(cells))


if __name__ == "__main__":
    main()
