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
"""Contrast saliency against OpenCV's FineGrained: `uv run benchmarks/saliency.py`.

FineGrained lives in OpenCV's contrib build, which cannot stand beside the plain one: the script
has an environment of its own. The two take turns in one run, so that what else the machine does
meets both; the ratio of their shortest times is what counts, of a photograph of 8 bits and of the
same in floating point, as `read_image` returns it. Then come the cost by size, and the memory that
is used beyond the input. `--json` prints the figures for a machine.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import saccade

PHOTO = Path(saccade.__file__).parent / "data" / "rocket.jpg"
SIZES = ((640, 480), (1024, 768))
MEGAPIXELS = (0.3, 1, 3, 12, 50)
BAR = 0.1
"""Our time at most, by FineGrained's."""


def photograph(width: int, height: int) -> np.ndarray:
    """(height, width, 3) uint8 RGB."""
    pixels = (saccade.read_image(PHOTO) * 255 + 0.5).astype(np.uint8)
    return cv2.resize(pixels, (width, height), interpolation=cv2.INTER_CUBIC)


def seconds(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def against_fine_grained(threads: int, rounds: int) -> list[dict[str, Any]]:
    """Shortest times in milliseconds, and the ratios of ours to FineGrained's."""
    cv2.setNumThreads(threads)
    rows = []
    for width, height in SIZES:
        rgb = photograph(width, height)
        as_float = rgb.astype(np.float32) / 255
        bgr = np.ascontiguousarray(rgb[:, :, ::-1])
        peer = cv2.saliency.StaticSaliencyFineGrained_create()
        maps = saccade.contrast_saliency(rgb)
        actions = {
            "contrast": lambda rgb=rgb: saccade.contrast_saliency(rgb),
            "contrast_float": lambda rgb=as_float: saccade.contrast_saliency(rgb),
            "fine_grained": lambda bgr=bgr, peer=peer: peer.computeSaliency(bgr),
            "scanpath": lambda maps=maps: saccade.scanpath(maps),
        }
        for action in actions.values():
            action()
        times = {name: [] for name in actions}
        for _ in range(rounds):
            for name, action in actions.items():
                times[name].append(seconds(action))
        row = {f"{name}_ms": 1e3 * min(values) for name, values in times.items()}
        row["ratio"] = row["contrast_ms"] / row["fine_grained_ms"]
        row["ratio_float"] = row["contrast_float_ms"] / row["fine_grained_ms"]
        rows.append({"threads": threads, "width": width, "height": height, **row})
    return rows


def by_size(megapixels: float) -> dict[str, float]:
    """Nanoseconds per pixel, and bytes per pixel beyond the input at the highest."""
    width = round((megapixels * 1e6 * 4 / 3) ** 0.5)
    rgb = photograph(width, round(width * 3 / 4))
    pixels = rgb.shape[0] * rgb.shape[1]
    cv2.setNumThreads(1)
    saccade.contrast_saliency(rgb[:256, :256])
    before = _peak_bytes(reset=True)
    first = seconds(lambda: saccade.contrast_saliency(rgb))
    beyond = _peak_bytes() - before
    best = min([first, *(seconds(lambda: saccade.contrast_saliency(rgb)) for _ in range(4))])
    return {
        "megapixels": pixels / 1e6,
        "ns_per_pixel": 1e9 * best / pixels,
        "bytes_per_pixel": beyond / pixels,
    }


def _peak_bytes(*, reset: bool = False) -> int:
    """The most that the process held resident: what OpenCV takes counts too (Linux only)."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    status = Path("/proc/self/status").read_text()
    line = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1024


def in_a_fresh_process(megapixels: float) -> dict[str, float]:
    """`by_size` where no freed memory lies ready."""
    command = [sys.executable, __file__, "--size", str(megapixels)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=40, help="turns of each (40)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--size", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.size:
        print(json.dumps(by_size(options.size)))
        return
    rows = [row for threads in (1, 2) for row in against_fine_grained(threads, options.rounds)]
    sizes = [in_a_fresh_process(size) for size in MEGAPIXELS]
    if options.json:
        print(json.dumps({"against_fine_grained": rows, "by_size": sizes}, indent=2))
        return
    print(
        "threads  size         contrast: 8 bits, float  FineGrained  ratios (bar .1) scanpath of 10"
    )
    for r in rows:
        verdict = "met" if max(r["ratio"], r["ratio_float"]) <= BAR else "MISSED"
        print(
            f"{r['threads']:7d}  {r['width']:4d} x {r['height']:4d}"
            f"  {r['contrast_ms']:7.2f} ms  {r['contrast_float_ms']:7.2f} ms"
            f"  {r['fine_grained_ms']:8.1f} ms  {r['ratio']:.3f}  {r['ratio_float']:.3f}"
            f" {verdict:>6}  {r['scanpath_ms']:9.2f} ms"
        )
    print("\nmegapixels  ns/pixel  bytes/pixel beyond the input")
    for s in sizes:
        print(f"{s['megapixels']:10.1f}  {s['ns_per_pixel']:8.1f}  {s['bytes_per_pixel']:12.1f}")


if __name__ == "__main__":
    main()
