"""The whole system on real drives: how far off, how sure, how fast.

    python benchmarks/drive.py FOLDER            a folder in KITTI's layout with truth
    python benchmarks/drive.py FOLDER --tracks   its stereo tracks instead of its images
    python benchmarks/drive.py FOLDER --frames 160 --seeds 4

Images are driven as a palindrome with one camera. The peer for speed is OpenCV's SIFT with
brute-force matching from each frame to the next, on the same frames, alternating with ours.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np

from saccade import visual
from saccade.datasets.drive_kitti import read_kitti_drive
from saccade.datasets.drive_tracks import read_tracks_drive
from saccade.evaluation.drives import score_drive
from saccade.evaluation.palindrome import PalindromeConfig, palindrome
from saccade.frames import Drive
from saccade.visual.following import ByteArray, gray_bytes


def table(result: visual.VisualResult, drive: Drive) -> tuple[float, ...]:
    """ATE of ours, of odometry, of visual odometry; error at the end; share inside 3 sigma."""
    ways = (result.trajectory, result.odometry, result.visual_odometry)
    ours, odometry, seen = (score_drive(way, drive.truth) for way in ways)
    return ours.ate_m, odometry.ate_m, seen.ate_m, ours.end_m, ours.inside_3sigma


def peer(images: list[ByteArray]) -> float:
    """Milliseconds a frame of SIFT and brute-force matching by OpenCV."""
    sift, matcher, last = cv2.SIFT_create(400), cv2.BFMatcher(), None
    begin = perf_counter()
    for image in images:
        _, found = sift.detectAndCompute(image, None)
        if last is not None:
            matcher.knnMatch(last, found, 2)
        last = found
    return 1000 * (perf_counter() - begin) / len(images)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tracks", action="store_true")
    parser.add_argument("--frames", type=int, default=160)
    parser.add_argument("--seeds", type=int, default=4)
    given = parser.parse_args()
    print("seed    ATE   odometry  visual odometry  return  in 3 sigma  ms/frame  peer ms/frame")
    rows = []
    for seed in range(1 if given.tracks else given.seeds):
        config = visual.VisualConfig(every=1 if given.tracks else 4)
        if given.tracks:
            drive, reference = read_tracks_drive(given.folder), float("nan")
        else:
            drive = read_kitti_drive(given.folder)
            drive = palindrome(drive, PalindromeConfig(frames=given.frames), seed)
            frames = [drive.load(i) for i in range(len(drive))]
            drive = replace(drive, load=frames.__getitem__)
            reference = peer([gray_bytes(frame.image) for frame in frames])
        begin = perf_counter()
        result = visual.run(drive, config)
        took = 1000 * (perf_counter() - begin) / len(drive)
        rows.append((*table(result, drive), took, reference))
        print(f"{seed:4}" + " ".join(f"{each:9.3f}" for each in rows[-1]))
        print("     ", {k: round(1000 * v / len(drive), 1) for k, v in result.seconds.items()})
    print("mean" + " ".join(f"{each:9.3f}" for each in np.mean(rows, 0)))


if __name__ == "__main__":
    main()
