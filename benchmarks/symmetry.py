# /// script
# requires-python = ">=3.11"
# dependencies = ["saccade", "opencv-contrib-python-headless"]
#
# [tool.uv]
# override-dependencies = ["opencv-python-headless; python_version < '0'"]
#
# [tool.uv.sources]
# saccade = { path = "..", editable = true }
# ///
"""How long symmetry takes, and that speed costs no exactness.

Run with `uv run benchmarks/symmetry.py`. The figures are in milliseconds on one thread, medians
in turn with OpenCV's FineGrained saliency (of its contrib build, hence an environment of its own),
so that a loaded machine shows. The plain twin of the tests, a loop over pixels and pairs in Python,
says whether the map is the same: on a crop, since it takes seconds. `--json` prints the figures for
a machine. benchmarks/must.py has the detectors.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np

import saccade

PHOTO = Path(saccade.__file__).parent / "data" / "rocket.jpg"
SOURCE = replace(saccade.SymmetryConfig.kootstra2010(), levels=(0, 1, 2), map_level=0)
BARS = {"isotropic, levels 0-2": 40.0, "attention, default": 60.0}
"""Milliseconds at most."""
EXACT = 1e-4
"""Greatest difference from the twin, of maps in [0, 1]."""


def photograph() -> np.ndarray:
    """(480, 640, 3) uint8 RGB."""
    pixels = (saccade.read_image(PHOTO) * 255 + 0.5).astype(np.uint8)
    return cv2.resize(pixels, (640, 480), interpolation=cv2.INTER_CUBIC)


def milliseconds(rgb: np.ndarray, rounds: int) -> dict[str, float]:
    """Medians of each, measured in turn."""
    bgr = np.ascontiguousarray(rgb[:, :, ::-1])
    peer = cv2.saliency.StaticSaliencyFineGrained_create()
    radial = replace(SOURCE, kind="radial")
    actions: dict[str, Callable[[], Any]] = {
        "isotropic, levels 0-2": lambda: saccade.symmetry_saliency(rgb, SOURCE),
        "radial, levels 0-2": lambda: saccade.symmetry_saliency(rgb, radial),
        "symmetry, default": lambda: saccade.symmetry_saliency(rgb),
        "contrast, default": lambda: saccade.contrast_saliency(rgb),
        "attention, default": lambda: saccade.attention_saliency(rgb),
        "FineGrained": lambda: peer.computeSaliency(bgr),
    }
    times: dict[str, list[float]] = {name: [] for name in actions}
    for number in range(rounds + 1):
        for name, action in actions.items():
            start = time.perf_counter()
            action()
            if number > 0:  # the first compiles
                times[name].append(1e3 * (time.perf_counter() - start))
    return {name: median(values) for name, values in times.items()}


def difference(rgb: np.ndarray) -> dict[str, float]:
    """The greatest difference from the twin, for both kinds, on a crop of the grey photograph."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    from support import oracles_symmetry

    gray = cv2.cvtColor(rgb[330:400, 150:230], cv2.COLOR_RGB2GRAY)
    return {
        kind: float(
            np.abs(
                saccade.symmetry_saliency(gray, replace(SOURCE, kind=kind)).saliency
                - oracles_symmetry.kootstra2010(gray, kind, SOURCE.levels)
            ).max()
        )
        for kind in ("isotropic", "radial")
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15, help="turns of each (15)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rgb = photograph()
    times, gaps = milliseconds(rgb, options.rounds), difference(rgb)
    if options.json:
        print(json.dumps({"milliseconds": times, "difference": gaps}, indent=2))
        return
    print("640 x 480, one thread")
    for name, value in times.items():
        bar = BARS.get(name)
        verdict = "" if bar is None else f"  bar {bar:.0f} {'met' if value < bar else 'MISSED'}"
        print(f"{name:22} {value:7.1f} ms{verdict}")
    for kind, gap in gaps.items():
        verdict = "met" if gap <= EXACT else "MISSED"
        print(f"{kind:22} {gap:.1e} from the plain twin  bar {EXACT:.0e} {verdict}")


if __name__ == "__main__":
    main()
