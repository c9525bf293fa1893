"""Drives in the layout of TUM RGB-D, from a hand-held camera.

rgb.txt                  lines of `time file`, the color images
depth.txt                the same for the depth images, 16 bit, 5000 steps per meter
groundtruth.txt          optional: `time x y z qx qy qz qw` of the color camera
camera.toml              optional, see `calibration`; not required where the header of
rgb.txt or the folder's name has freiburg1, 2 or 3
odometry.csv             optional, see `odometry`; without it the motion is unknown
"""

import re
from pathlib import Path

import numpy as np

from saccade.datasets.drives.calibration import CAMERA_FILE, Calibration, read_calibration
from saccade.datasets.drives.frames import FrameTimes, associate, frame_reader, image_files
from saccade.datasets.drives.sidecar_files import (
    assemble_drive,
    camera_truth,
    read_tum_poses,
)
from saccade.datasets.formats import first_lines
from saccade.datasets.tables import read_rows
from saccade.errors import DriveError
from saccade.frames import Camera, Drive
from saccade.types import FloatArray

DEPTH_UNIT = 1 / 5000
"""Meters per step of a depth image."""
MAX_DEPTH_TIME_DIFFERENCE = 0.02
"""Seconds between a color image and its depth image."""
CAMERAS = {
    1: ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    2: ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    3: ((535.4, 539.2, 320.1, 247.6), ()),
}
"""fx, fy, cx, cy and distortion of the benchmark's three cameras, from its page on file formats;
images of the third camera are undistorted."""


def read_tum_drive(path: Path) -> Drive:
    """A drive from a folder."""
    recorded, files = _read_list(path / "rgb.txt")
    frames = FrameTimes.sort(recorded, str(path / "rgb.txt"))
    calibration = _tum_calibration(path)
    depth = None
    if (path / "depth.txt").exists():
        depth_time, depth_files = _read_list(path / "depth.txt")
        nearest = associate(recorded, depth_time, MAX_DEPTH_TIME_DIFFERENCE)
        beside = [depth_files[i] if i >= 0 else None for i in nearest.tolist()]
        depth = image_files(beside.__getitem__)
    truth = None
    if (path / "groundtruth.txt").exists():
        poses = read_tum_poses(path / "groundtruth.txt")
        truth = camera_truth(poses, calibration.camera, float(frames.time[0]))
    left = image_files(files.__getitem__)
    read = frame_reader(calibration, recorded, left, depth=depth)
    return assemble_drive(path.resolve().name, path, calibration, frames, read, truth=truth)


def _read_list(path: Path) -> tuple[FloatArray, list[Path]]:
    """Times (n,) and files of a list of images."""
    rows = [row.require_cells(2, "cells (time, file)") for row in read_rows(path)]
    if not rows:
        raise DriveError(f"{path}: expected times and files, found none")
    time = [row.numbers(slice(1))[0] for row in rows]
    return np.array(time), [path.parent / row.cells[1] for row in rows]


def _tum_calibration(path: Path) -> Calibration:
    if (path / CAMERA_FILE).exists():
        return read_calibration(path / CAMERA_FILE)
    header = " ".join(line for line in first_lines(path / "rgb.txt", 5) if line.startswith("#"))
    number = re.search(r"(?:freiburg|fr)([123])", f"{header} {path.resolve().name}")
    if number is None:
        raise DriveError(
            f"{path}: expected {CAMERA_FILE}, or freiburg1, 2 or 3 in the header of rgb.txt or in "
            "the folder's name, found neither"
        )
    (fx, fy, cx, cy), distortion = CAMERAS[int(number[1])]
    camera = Camera(width=640, height=480, fx=fx, fy=fy, cx=cx, cy=cy, distortion=distortion)
    return Calibration(camera, depth_unit=DEPTH_UNIT)
