"""Drives in the layout of KITTI's odometry benchmark.

    calib.txt                P0 and, for stereo, P1: (3, 4) projections of the rectified cameras
    times.txt                seconds, one line a frame
    image_0/, image_1/       left and right, grey, named by the number of the frame; image_2/ and
                             image_3/ (with P2, P3) are taken where there is no image_0
    depth/                   optional: 16-bit images of the left camera's depth
    odometry.csv             optional, see `odometry_csv`; or odometry_oxts.csv
    groundtruth.tum          optional truth: of the robot; or of the left camera, in its frame:
                             groundtruth_tum.txt, groundtruth_kitti.txt, poses.txt or, as the
                             benchmark has it, ../../poses/NAME.txt
    camera.toml              optional, see `camera_file`: instead of calib.txt
    calib.npz                optional: `cam_T_imu`, see `read_mounting`

There may be fewer images than times.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from saccade.datasets.archive import Archive
from saccade.datasets.camera_file import CAMERA_FILE, Calibration, read_calibration
from saccade.datasets.camera_poses import (
    Poses,
    of_robot,
    off_the_plane,
    on_the_plane,
    read_kitti_poses,
    read_tum_poses,
)
from saccade.datasets.image_files import ImageFiles, images_of, in_time, numbered, size_of
from saccade.datasets.odometry_csv import read_odometry
from saccade.datasets.steps import Steps, unknown_steps
from saccade.datasets.text import fields, numbers, read_columns, read_lines
from saccade.errors import ConfigError, DriveError
from saccade.frames import Camera, Drive
from saccade.types import FloatArray, IntArray, Trajectory

KITTI_HEIGHT = 1.65
"""Metres of KITTI's cameras above the road."""


def read_kitti_drive(path: Path) -> Drive:
    """A drive from a folder.

    Raises:
        DriveError, LogError: a file is missing, broken or does not fit the others; names it.
    """
    pair = ("image_0", "image_1", "P0", "P1")
    if not (path / pair[0]).is_dir() and (path / "image_2").is_dir():
        pair = ("image_2", "image_3", "P2", "P3")
    clock = read_columns(path / "times.txt", ("seconds",))[:, 0]
    left = numbered(images_of(path / pair[0]), len(clock))
    right, depth = (
        numbered(images_of(folder), len(clock)) if folder.is_dir() else {}
        for folder in (path / pair[1], path / "depth")
    )
    number = np.array(sorted(left), np.int64)
    number = number[in_time(clock[number])]
    calibration = _calibration(path, pair, size_of(left[int(number[0])]))
    if not right:
        calibration = replace(calibration, camera=replace(calibration.camera, baseline=0.0))
    truth, lift = read_truth(path, clock, calibration.camera)
    time = clock[number]
    steps = read_steps(path, time, number)
    return Drive(
        name=path.resolve().name,
        camera=calibration.camera,
        time=time,
        control=steps.control,
        control_covariance=steps.covariance,
        load=ImageFiles(
            calibration.camera,
            time,
            left=[left[i] for i in number.tolist()],
            right=[right.get(i) for i in number.tolist()] if right else (),
            depth=[depth.get(i) for i in number.tolist()] if depth else (),
            depth_unit=calibration.depth_unit,
            distortion=calibration.distortion,
        ),
        start=np.array(calibration.start),
        odometry_bias=calibration.odometry_bias,
        truth=truth,
        truth_off_plane=lift,
    )


def read_steps(path: Path, time: FloatArray, number: IntArray) -> Steps:
    """Odometry of a folder, or steps of which nothing is known."""
    for name in ("odometry.csv", "odometry_oxts.csv"):
        if (path / name).exists():
            return read_odometry(path / name, time, number)
    return unknown_steps(time)


def read_truth(
    path: Path, clock: FloatArray, camera: Camera
) -> tuple[Trajectory | None, FloatArray | None]:
    """Truth of a folder, and what of it leaves the plane (see `Drive`).

    Args:
        path: the folder.
        clock: (n,) seconds of all frames.
        camera: on the robot.
    """
    if (path / "groundtruth.tum").exists():
        poses = read_tum_poses(path / "groundtruth.tum")
        return on_the_plane(poses), off_the_plane(poses)
    found = _camera_truth(path, clock)
    if found is None:
        return None, None
    poses = of_robot(found, camera)
    return on_the_plane(poses), off_the_plane(poses)


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


def read_mounting(path: Path) -> tuple[FloatArray, FloatArray]:
    """Place (3,) and rotation (3, 3) of the camera on the robot from a `calib.npz`.

    Its `cam_T_imu` has the rotation that turns vectors of the inertial unit into the camera's, but
    its translation is the place of the camera in the unit's frame. The height is KITTI's.

    Raises:
        LogError, DriveError: the file is broken, or has another matrix.
    """
    matrix = Archive(path).tables.get("cam_T_imu", np.zeros(0))
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise DriveError(f"{path}: expected cam_T_imu of shape (4, 4), found {matrix.shape}")
    place = np.array([matrix[0, 3], matrix[1, 3], KITTI_HEIGHT])
    return place, np.ascontiguousarray(matrix[:3, :3].T)


def _calibration(path: Path, pair: tuple[str, ...], size: tuple[int, int]) -> Calibration:
    if (path / CAMERA_FILE).exists():
        return read_calibration(path / CAMERA_FILE)
    calib = path / "calib.txt"
    projections = read_projections(calib)
    P = projections.get(pair[2])
    if P is None:
        raise DriveError(f"{calib}: expected {pair[2]}, found {', '.join(projections) or 'none'}")
    width, height = size
    if not (0 < P[0, 2] < width and 0 < P[1, 2] < height):
        raise DriveError(
            f"{calib}: expected a centre inside the images of {width} x {height} px, "
            f"found {P[0, 2]:.1f}, {P[1, 2]:.1f}"
        )
    place, rotation = np.array([0.0, 0.0, KITTI_HEIGHT]), Camera(1, 1, 1, 1, 0, 0).rotation
    if (path / "calib.npz").exists():
        place, rotation = read_mounting(path / "calib.npz")
    right = projections.get(pair[3])
    baseline = 0.0 if right is None else float(P[0, 3] / P[0, 0] - right[0, 3] / right[0, 0])
    try:
        camera = Camera(
            width=width,
            height=height,
            fx=float(P[0, 0]),
            fy=float(P[1, 1]),
            cx=float(P[0, 2]),
            cy=float(P[1, 2]),
            baseline=baseline,
            place=place,
            rotation=rotation,
        )
    except ConfigError as error:
        raise DriveError(f"{calib}: {error}") from error
    return Calibration(camera)


def _camera_truth(path: Path, clock: FloatArray) -> Poses | None:
    if (path / "groundtruth_tum.txt").exists():
        return read_tum_poses(path / "groundtruth_tum.txt")
    benchmark = path.resolve().parent.parent / "poses" / f"{path.resolve().name}.txt"
    for file in (path / "groundtruth_kitti.txt", path / "poses.txt", benchmark):
        if file.exists():
            return read_kitti_poses(file, clock)
    return None
