"""Visual SLAM on real drives: accuracy, consistency and speed (docs/measured.md).

    uv run python benchmarks/drive.py FOLDER            a folder in KITTI's layout with truth
    uv run python benchmarks/drive.py FOLDER --tracks   its stereo tracks instead of its images
    uv run python benchmarks/drive.py FOLDER --frames 160 --seeds 4
    uv run python benchmarks/drive.py FOLDER --max-tracked 80    a map of 500 landmarks
    uv run python benchmarks/drive.py FOLDER --dedicated    with the settings of `saccade drive`

Images are driven out and back with one camera. The peer for speed is OpenCV's SIFT with
brute-force matching from each frame to the next, on the same frames, alternating with ours. Kernels
are loaded beforehand.
"""

from contextlib import nullcontext
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np

from measuring import arguments, seconds
from out_and_back import OutAndBackConfig, out_and_back
from saccade import visual
from saccade.datasets import load_drive
from saccade.evaluation.trajectory import score_drive
from saccade.frames import Drive
from saccade.visual.optical_flow import gray_bytes

WARM = 24
"""Frames that are driven before the first that count."""
FORM = "{:6.3f}  {:8.3f}  {:8.3f}  {:6.3f}  {:7.3f}  {:9.1f}  {:6.1f}  {:4.1f}  {:5.2f}  {:9.0f}"


def errors(result: visual.VisualResult, drive: Drive) -> tuple[float, ...]:
    """ATE of ours, of odometry, of visual odometry; final error; fraction inside 3 sigma."""
    estimates = (result.trajectory, result.odometry, result.visual_odometry)
    ours, odometry, visual_odometry = (score_drive(each, drive.truth) for each in estimates)
    return ours.ate_m, odometry.ate_m, visual_odometry.ate_m, ours.end_m, ours.inside_3sigma


def peer(drive: Drive) -> None:
    """SIFT and brute-force matching by OpenCV."""
    sift, matcher, last = cv2.SIFT_create(400), cv2.BFMatcher(), None
    for number in range(len(drive)):
        _, found = sift.detectAndCompute(gray_bytes(drive.load(number).image), None)
        if last is not None:
            matcher.knnMatch(last, found, 2)
        last = found


def main() -> None:
    given = arguments(
        __doc__,
        folder={"flags": "folder", "type": Path},
        tracks=False,
        frames=160,
        seeds=4,
        max_tracked=visual.VisualConfig.max_tracked,
        detect_interval=visual.VisualConfig.detect_interval,
        dedicated=False,
    )
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
            reference = len(drive) / seconds(lambda drive=drive: peer(drive))
        if seed == 0:
            visual.run(drive.until(min(WARM, len(drive))), config)
        begin = perf_counter()
        with visual.dedicated_process() if given.dedicated else nullcontext():
            result = visual.run(drive, config)
        rate = len(drive) / (perf_counter() - begin)
        median = 1 / float(np.median(result.frame_seconds))
        speed = (rate, median, reference, rate / reference)
        rows.append((*errors(result, drive), *speed, len(result.map)))
        print(f"{seed:4}" + FORM.format(*rows[-1]))
    print("mean" + FORM.format(*np.mean(rows, 0)))


if __name__ == "__main__":
    main()
