"""Drives in the layout of KITTI's odometry benchmark.

    calib.txt                P0 and, for stereo, P1: (3, 4) projections of the rectified cameras
    times.txt                seconds, one line a frame
    image_0/, image_1/       left and right, grey, named by the number of the frame; image_2/ and
                             image_3/ (with P2, P3) are taken where there is no image_0
    depth/                   optional: 16-bit images of the left camera's depth
    camera.toml              optional, see `camera_file`: instead of calib.txt
    calib.npz                optional: `cam_T_imu`, see `read_extrinsics`

and odometry and truth as `sidecar_files` tells. There may be fewer images than times.
"""

from pathlib import Path

import numpy as np

from saccade.datasets.archive import Archive
from saccade.datasets.drives.camera_file import CAMERA_FILE, Calibration, read_calibration
from saccade.datasets.drives.image_files import ImageFiles, images_of, in_time, numbered, size_of
from saccade.datasets.drives.sidecar_files import (
    assemble_drive,
    read_increments_or_unknown,
    read_truth,
)
from saccade.datasets.drives.undistortion import Lens
from saccade.datasets.text import fields, numbers, read_columns, read_lines
from saccade.errors import DriveError
from saccade.frames import AHEAD, Camera, Drive
from saccade.types import FloatArray, IntArray

KITTI_HEIGHT = 1.65
"""Metres of KITTI's cameras above the road."""
PAIRS = (("image_0", "image_1", "P0", "P1"), ("image_2", "image_3", "P2", "P3"))
"""Folders and projections of the grey and of the colour cameras."""


def read_kitti_drive(path: Path) -> Drive:
    """A drive from a folder.

    Raises:
        DriveError, LogError: a file is missing, broken or does not fit the others; names it.
    """
    pair = next((each for each in PAIRS if (path / each[0]).is_dir()), PAIRS[0])
    clock = read_columns(path / "times.txt", ("seconds",))[:, 0]
    left = numbered(images_of(path / pair[0]), len(clock))
    right, depth = (
        numbered(images_of(folder), len(clock)) if folder.is_dir() else {}
        for folder in (path / pair[1], path / "depth")
    )
    there = np.array(sorted(left), np.int64)
    order, remarks = in_time(clock[there], str(path / "times.txt"))
    number, time = there[order], clock[there[order]]
    calibration = _calibration(path, pair, size_of(left[int(number[0])]), stereo=bool(right))
    steps = read_increments_or_unknown(path, time, number)
    truth = read_truth(path, clock, calibration.camera, time[0])
    load = ImageFiles(
        calibration.camera,
        time,
        left=[left[i] for i in number.tolist()],
        right=[right.get(i) for i in number.tolist()] if right else (),
        depth=[depth.get(i) for i in number.tolist()] if depth else (),
        depth_unit=calibration.depth_unit,
        lens=Lens.of(calibration.camera, calibration.distortion),
        right_lens=Lens.of(calibration.camera, calibration.distortion),
    )
    remarks += _missing(there, path / pair[0])
    return assemble_drive(path.resolve().name, calibration, time, load, steps, truth, remarks)


def read_projections(path: Path) -> dict[str, FloatArray]:
    """The (3, 4) matrices of a calib.txt by their names.

    Raises:
        LogError, DriveError: the file is missing, or a line is no such matrix.
    """
    matrices = {}
    for line, words in fields(read_lines(path)):
        if words[0].endswith(":") and words[0][0] == "P":
            values = numbers(path, line, words[1:])
            if len(values) != 12:
                raise DriveError(f"{path}, line {line}: expected 12 numbers, found {len(values)}")
            matrices[words[0][:-1]] = np.array(values).reshape(3, 4)
    return matrices


def read_extrinsics(path: Path) -> tuple[FloatArray, FloatArray]:
    """Place (3,) and rotation (3, 3) of the camera on the robot from a `calib.npz`.

    Its `cam_T_imu` has the rotation that turns vectors of the inertial unit into the camera's, but
    its translation is the place of the camera in the unit's frame. The height is KITTI's.

    Raises:
        LogError, DriveError: the file is broken, or has another matrix.
    """
    matrix = Archive(path).tables.get("cam_T_imu", np.zeros(0))
    numbers = matrix.shape == (4, 4) and matrix.dtype.kind in "fiu"
    if not numbers or not np.isfinite(matrix).all():
        found = f"{matrix.dtype} of shape {matrix.shape}"
        raise DriveError(f"{path}: expected cam_T_imu, finite and of shape (4, 4), found {found}")
    matrix = matrix.astype(np.float64)
    place = np.array([matrix[0, 3], matrix[1, 3], KITTI_HEIGHT])
    return place, np.ascontiguousarray(matrix[:3, :3].T)


def _calibration(
    path: Path, pair: tuple[str, ...], size: tuple[int, int], stereo: bool
) -> Calibration:
    if (path / CAMERA_FILE).exists():
        return read_calibration(path / CAMERA_FILE)
    calib = path / "calib.txt"
    projections = read_projections(calib)
    P, right = (projections.get(name) for name in pair[2:])
    if P is None:
        raise DriveError(f"{calib}: expected {pair[2]}, found {', '.join(projections) or 'none'}")
    width, height = size
    if not (0 < P[0, 2] < width and 0 < P[1, 2] < height):
        raise DriveError(
            f"{calib}: expected a centre inside the images of {width} x {height} px, "
            f"found {P[0, 2]:.1f}, {P[1, 2]:.1f}"
        )
    place, rotation = np.array([0.0, 0.0, KITTI_HEIGHT]), AHEAD.copy()
    if (path / "calib.npz").exists():
        place, rotation = read_extrinsics(path / "calib.npz")
    baseline = 0.0
    if stereo and right is not None:
        baseline = float(P[0, 3] / P[0, 0] - right[0, 3] / right[0, 0])
    camera = Camera(
        width=width,
        height=height,
        fx=float(P[0, 0]),
        fy=float(P[1, 1]),
        cx=float(P[0, 2]),
        cy=float(P[1, 2]),
        baseline=baseline,
        position=place,
        rotation=rotation,
    )
    return Calibration(camera)


def _missing(there: IntArray, folder: Path) -> tuple[str, ...]:
    """A remark where numbers are left out between the first and the last image."""
    gaps = np.flatnonzero(np.diff(there) > 1)
    if len(gaps) == 0:
        return ()
    lost = int((np.diff(there) - 1).sum())
    what = "image is" if lost == 1 else "images are"
    return (f"{folder}: {lost} {what} missing, first number {there[gaps[0]] + 1}",)
