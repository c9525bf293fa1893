"""Visual SLAM on real drives: accuracy, consistency and speed.

    uv run python benchmarks/drive.py FOLDER            a folder in KITTI's layout with truth
    uv run python benchmarks/drive.py FOLDER --tracks   its stereo tracks instead of its images
    uv run python benchmarks/drive.py FOLDER --tracks --detect-interval 1    not by the defaults
    uv run python benchmarks/drive.py FOLDER --frames 160 --seeds 4
    uv run python benchmarks/drive.py FOLDER --max-tracked 80    a map of 500 landmarks
    uv run python benchmarks/drive.py FOLDER --dedicated    with the settings of `saccade drive`

Images are driven out and back with one camera. The peer for speed is OpenCV's SIFT with
brute-force matching from each frame to the next, on the same frames, alternating with ours.
Both read the files. What is compiled, or read from the cache of what was, is so beforehand.
"""

import argparse
from collections.abc import Iterable
from contextlib import nullcontext
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np

from out_and_back import OutAndBackConfig, out_and_back
from saccade import visual
from saccade.datasets import load_drive
from saccade.evaluation.trajectory import score_drive
from saccade.frames import Drive
from saccade.visual.optical_flow import gray_bytes

WARM = 24
"""Frames that are driven before the first that count."""
FORM = "{:6.3f}  {:8.3f}  {:8.3f}  {:6.3f}  {:7.3f}  {:9.1f}  {:6.1f}  {:4.1f}  {:5.2f}  {:9.0f}"


def line(row: Iterable[float]) -> str:
    """A row of the table."""
    return FORM.format(*row)


def table(result: visual.VisualResult, drive: Drive) -> tuple[float, ...]:
    """ATE of ours, of odometry, of visual odometry; final error; fraction inside 3 sigma."""
    estimates = (result.trajectory, result.odometry, result.visual_odometry)
    ours, odometry, visual_odometry = (score_drive(each, drive.truth) for each in estimates)
    return ours.ate_m, odometry.ate_m, visual_odometry.ate_m, ours.end_m, ours.inside_3sigma


def peer(drive: Drive) -> float:
    """Frames a second of SIFT and brute-force matching by OpenCV."""
    sift, matcher, last = cv2.SIFT_create(400), cv2.BFMatcher(), None
    begin = perf_counter()
    for number in range(len(drive)):
        image = drive.load(number).image
        assert image is not None
        _, found = sift.detectAndCompute(gray_bytes(image), None)
        if last is not None:
            matcher.knnMatch(last, found, 2)
        last = found
    return len(drive) / (perf_counter() - begin)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tracks", action="store_true")
    parser.add_argument("--frames", type=int, default=160)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--max-tracked", type=int, default=visual.VisualConfig.max_tracked)
    parser.add_argument("--detect-interval", type=int, default=visual.VisualConfig.detect_interval)
    parser.add_argument("--dedicated", action="store_true")
    given = parser.parse_args()
    print("                 visual            inside           frames a second                 map")
    print(
        "seed   ATE  odometry  odometry  return  3 sigma  whole run  median  peer  ratio  landmarks"
    )
    config = visual.VisualConfig(
        detect_interval=given.detect_interval, max_tracked=given.max_tracked
    )
    recorded = load_drive("tracks" if given.tracks else "kitti", given.folder)
    rows = []
    for seed in range(1 if given.tracks else given.seeds):
        drive, reference = recorded, float("nan")
        if not given.tracks:
            drive = out_and_back(recorded, OutAndBackConfig(frames=given.frames), seed)
            reference = peer(drive)
        if seed == 0:
            visual.run(drive.until(min(WARM, len(drive))), config)
        begin = perf_counter()
        with visual.dedicated_process() if given.dedicated else nullcontext():
            result = visual.run(drive, config)
        rate = len(drive) / (perf_counter() - begin)
        median = 1 / float(np.median(result.frame_seconds))
        rows.append(
            (*table(result, drive), rate, median, reference, rate / reference, len(result.map))
        )
        print(f"{seed:4}" + line(rows[-1]))
    print("mean" + line(np.mean(rows, 0)))


if __name__ == "__main__":
    main()
