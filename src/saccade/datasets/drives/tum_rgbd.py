"""Drives in the layout of the TUM RGB-D benchmark.

    rgb.txt                  lines of `time file`, the colour images
    depth.txt                the same for the depth images, 16 bit, a metre in 5000 steps
    groundtruth.txt          optional: `time x y z qx qy qz qw` of the colour camera
    camera.toml              optional, see `camera_file`; not needed where the folder's name says
                             freiburg1, 2 or 3
    odometry.csv             optional, see `odometry_csv`

Whoever carries such a camera has no wheels: without odometry.csv nothing is known of the way but
how fast a person may walk (see `unknown_steps`).
"""

import re
from pathlib import Path

import numpy as np

from saccade.datasets.drives.camera_file import CAMERA_FILE, Calibration, read_calibration
from saccade.datasets.drives.camera_poses import read_tum_poses
from saccade.datasets.drives.image_files import ImageFiles, in_time
from saccade.datasets.drives.sidecar_files import Truth, assemble_drive, read_increments_or_unknown
from saccade.datasets.drives.undistortion import Lens
from saccade.datasets.text import fields, numbers, read_lines
from saccade.errors import DriveError
from saccade.frames import Camera, Drive
from saccade.types import FloatArray, IntArray

DEPTH_UNIT = 1 / 5000
"""Metres of one step in a depth image."""
TOGETHER = 0.02
"""Seconds by which a colour image and its depth may be apart."""
KNOWN = {
    1: ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    2: ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    3: ((535.4, 539.2, 320.1, 247.6), ()),
}
"""fx, fy, cx, cy and the distortion of the benchmark's three cameras, by its page on file formats;
images of the third are straight."""


def read_tum_drive(path: Path) -> Drive:
    """A drive from a folder.

    Raises:
        DriveError, LogError: a file is missing, broken or does not fit the others; names it.
    """
    clock, files = read_list(path / "rgb.txt")
    number, remarks = in_time(clock, str(path / "rgb.txt"))
    time, left = clock[number], [path / files[i] for i in number.tolist()]
    calibration = _calibration(path)
    depth: list[Path | None] = []
    if (path / "depth.txt").exists():
        depth_clock, depth_files = read_list(path / "depth.txt")
        nearest = associated(time, depth_clock, TOGETHER)
        depth = [path / depth_files[i] if i >= 0 else None for i in nearest.tolist()]
    truth = Truth()
    if (path / "groundtruth.txt").exists():
        poses = read_tum_poses(path / "groundtruth.txt")
        truth = Truth.of_camera(poses, calibration.camera, time[0])
    steps = read_increments_or_unknown(path, time, number)
    load = ImageFiles(
        calibration.camera,
        time,
        left=left,
        depth=depth,
        depth_unit=calibration.depth_unit,
        lens=Lens.of(calibration.camera, calibration.distortion),
    )
    return assemble_drive(path.resolve().name, calibration, time, load, steps, truth, remarks)


def read_list(path: Path) -> tuple[FloatArray, list[str]]:
    """Times (n,) and files of a list of images.

    Raises:
        LogError, DriveError: the list is missing, empty, or a line has something else.
    """
    time, files = [], []
    for line, words in fields(read_lines(path)):
        if len(words) != 2:
            found = " ".join(words)[:80]
            raise DriveError(f"{path}, line {line}: expected a time and a file, found {found!r}")
        time.append(numbers(path, line, words[:1])[0])
        files.append(words[1])
    if not files:
        raise DriveError(f"{path}: expected times and files, found none")
    return np.array(time), files


def associated(time: FloatArray, others: FloatArray, within: float) -> IntArray:
    """For each time (n,) the number of the nearest of the others (m,), or -1.

    There is none where the nearest is not `within` so many seconds, or nearer to another time.
    """
    if len(others) == 0:
        return np.full(len(time), -1)
    there, apart = _nearest(time, others)
    back, _ = _nearest(others, time)
    mutual = time[back[there]] == time
    return np.asarray(np.where(mutual & (apart <= within), there, -1), np.int64)


def _nearest(time: FloatArray, others: FloatArray) -> tuple[IntArray, FloatArray]:
    """For each time (n,) the number of the nearest of the others (m,), and how far it is."""
    order = np.argsort(others, kind="stable")
    after = np.searchsorted(others[order], time)
    sides = order[np.stack([after - 1, after]).clip(0, len(others) - 1)]  # (2, n)
    apart = np.abs(others[sides] - time)
    nearer = apart.argmin(0), np.arange(len(time))
    return np.asarray(sides[nearer], np.int64), np.asarray(apart[nearer])


def _calibration(path: Path) -> Calibration:
    if (path / CAMERA_FILE).exists():
        return read_calibration(path / CAMERA_FILE)
    named = re.search(r"(?:freiburg|fr)([123])", path.resolve().name)
    if named is None:
        raise DriveError(
            f"{path}: expected {CAMERA_FILE}, or freiburg1, 2 or 3 in the folder's name, "
            "found neither"
        )
    (fx, fy, cx, cy), distortion = KNOWN[int(named[1])]
    camera = Camera(width=640, height=480, fx=fx, fy=fy, cx=cx, cy=cy)
    return Calibration(camera, distortion, depth_unit=DEPTH_UNIT)
