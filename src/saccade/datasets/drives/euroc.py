"""Drives in EuRoC's layout (Burri et al. 2016), from a drone or a hand-held rig.

    mav0/cam0/sensor.yaml    intrinsics, distortion and T_BS, the pose of the camera in the body
    mav0/cam0/data/TIME.png  images, named by their time in nanoseconds
    mav0/cam1/               optional: the right camera; the pair is rectified by both T_BS
    mav0/state_groundtruth_estimate0/data.csv
                             optional: poses of the body: time in ns, x, y, z, qw, qx, qy, qz

The drive is the folder mav0 or the folder that has it. The robot is the left camera, which faces
ahead; odometry is described in `sidecar_files`.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from saccade.datasets.drives.calibration import Calibration
from saccade.datasets.drives.camera_files import read_camera_file, sensor_pose
from saccade.datasets.drives.frames import (
    FrameTimes,
    ImageSource,
    Maps,
    associate,
    frame_reader,
    image_files,
    image_size,
    list_images,
)
from saccade.datasets.drives.sidecar_files import assemble_drive, camera_truth
from saccade.datasets.tables import read_csv
from saccade.errors import DriveError
from saccade.frames import Camera, Drive, Poses
from saccade.types import FloatArray, Trajectory

SENSOR_FILE = "sensor.yaml"
ROOT = "mav0"
"""Folder of the sensors."""
TRUTH_FOLDERS = ("state_groundtruth_estimate0", "leica0", "vicon0")
NANOSECOND = 1e-9
MAX_PAIR_TIME_DIFFERENCE = 0.005
"""Maximum time difference between the images of a pair, in seconds."""


class Rectification(NamedTuple):
    """A rectified pair: its camera, and the maps of the recorded images."""

    camera: Camera
    """With the baseline."""
    left: Maps
    right: Maps
    rotation: FloatArray
    """(3, 3) from the rectified to the recorded frame of the left camera."""


def sensors_of(path: Path) -> Path:
    """The folder of the sensors of a drive."""
    return path / ROOT if (path / ROOT).is_dir() else path


def is_euroc(path: Path) -> bool:
    """Whether a folder has EuRoC's layout."""
    return (sensors_of(path) / "cam0" / SENSOR_FILE).is_file()


def read_euroc_drive(path: Path) -> Drive:
    """A drive from a folder."""
    root = sensors_of(path)
    files, time = _images(root / "cam0")
    size = image_size(files[0])
    camera = read_camera_file(root / "cam0" / SENSOR_FILE, size).camera
    pose, rotation = sensor_pose(root / "cam0" / SENSOR_FILE), np.eye(3)
    right: ImageSource | None = None
    maps = None
    if (root / "cam1" / SENSOR_FILE).is_file():
        others, other_time = _images(root / "cam1")
        other = read_camera_file(root / "cam1" / SENSOR_FILE, size).camera
        pair = rectify(camera, pose, other, sensor_pose(root / "cam1" / SENSOR_FILE), str(root))
        camera, maps, rotation = pair.camera, (pair.left, pair.right), pair.rotation
        nearest = associate(time, other_time, MAX_PAIR_TIME_DIFFERENCE).tolist()
        right = image_files(lambda i: others[nearest[i]] if nearest[i] >= 0 else None)
    calibration = Calibration(camera)
    frames = FrameTimes.sort(time, str(root / "cam0" / "data"))
    read = frame_reader(calibration, time, image_files(files.__getitem__), right, maps=maps)
    truth = _truth(root, pose, rotation, camera, frames)
    name = path.resolve().parent.name if path.resolve().name == ROOT else path.resolve().name
    return assemble_drive(name, path, calibration, frames, read, truth=truth)


def _images(folder: Path) -> tuple[list[Path], FloatArray]:
    """The images of a camera, and their times (n,) in seconds."""
    files = list_images(folder / "data")
    for file in files:
        if not (file.stem.isascii() and file.stem.isdecimal()):
            raise DriveError(f"{file}: expected a name that is a time in nanoseconds")
    return files, np.array([int(file.stem) * NANOSECOND for file in files], np.float64)


def rectify(
    left: Camera, left_pose: FloatArray, right: Camera, right_pose: FloatArray, name: str
) -> Rectification:
    """Rectification of a calibrated pair: both rotate until their rows are the same lines.

    Args:
        left: camera of the left images as recorded; the rectified pair has its camera matrix.
        left_pose: (4, 4) from its frame to the frame of the body.
        right: camera of the right images.
        right_pose: (4, 4) likewise.
        name: name of the files, for messages.

    Raises:
        DriveError: the right camera is not to the right of the left one.
    """
    to_left = np.linalg.inv(left_pose) @ right_pose  # from the right camera's frame
    offset = to_left[:3, 3]
    baseline = float(np.linalg.norm(offset))
    if baseline <= 0 or offset[0] < 0.5 * baseline:
        raise DriveError(
            f"{name}: expected cam1 to the right of cam0 by T_BS, found an offset of "
            f"{offset.round(3).tolist()} m in the frame of cam0"
        )
    x = offset / baseline
    y = np.cross(np.array([0.0, 0.0, 1.0]) + to_left[:3, 2], x)
    y /= np.linalg.norm(y)
    rotation = np.stack([x, y, np.cross(x, y)], 1)
    camera = Camera.from_matrix(left.matrix, (left.width, left.height), baseline=baseline)
    turned = to_left[:3, :3].T @ rotation
    return Rectification(
        camera, left.maps_to(camera, rotation), right.maps_to(camera, turned), rotation
    )


def _truth(
    root: Path, pose: FloatArray, rotation: FloatArray, camera: Camera, frames: FrameTimes
) -> Trajectory | None:
    """The truth of the left camera, from poses of the body; None without it."""
    files = [root / folder / "data.csv" for folder in TRUTH_FOLDERS]
    file = next((each for each in files if each.is_file()), None)
    if file is None:
        return None
    table = read_csv(file, comment=None)
    if len(table.header.cells) < 8 or not table.rows:
        return None  # positions alone have no heading
    rows = np.array([row.numbers(slice(8)) for row in table.rows])
    order = [0, 1, 2, 3, 5, 6, 7, 4]  # the real part of the quaternion is first
    body = Poses.from_rows(rows[:, order] * [NANOSECOND, *[1.0] * 7], str(file))
    n = len(body)
    mount = Poses(
        body.time, np.tile(pose[:3, :3] @ rotation, (n, 1, 1)), np.tile(pose[:3, 3], (n, 1))
    )
    return camera_truth(body @ mount, camera, float(frames.time[0]))
