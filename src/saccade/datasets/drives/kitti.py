"""Drives in the layout of KITTI's odometry benchmark.

    calib.txt                P0 and, for stereo, P1: (3, 4) projections of the rectified cameras
    times.txt                seconds, one line a frame
    image_0/, image_1/       left and right, gray, named by the number of the frame; image_2/ and
                             image_3/ (with P2, P3) are read where there is no image_0
    depth/                   optional: 16-bit images of the left camera's depth
    camera.toml              optional, see `calibration`: instead of calib.txt
    calib.npz                optional: `cam_T_imu`, see `read_extrinsics`

and odometry and ground truth as in `sidecar_files`. There may be fewer images than times.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from saccade.datasets.drives.calibration import (
    CAMERA_FILE,
    Calibration,
    pinhole,
    read_calibration,
)
from saccade.datasets.drives.frames import (
    FrameTimes,
    are_numbered,
    frame_loader,
    image_files,
    image_size,
    list_images,
)
from saccade.datasets.drives.sidecar_files import assemble_drive
from saccade.datasets.tables import Archive, read_rows, read_table
from saccade.errors import DriveError
from saccade.frames import AHEAD, Drive
from saccade.types import FloatArray, IntArray

KITTI_HEIGHT = 1.65
"""Metres of KITTI's cameras above the road."""
PAIRS = {("image_0", "image_1"): ("P0", "P1"), ("image_2", "image_3"): ("P2", "P3")}
"""Folders and projections of the left and right gray cameras, and of the color cameras."""


def read_kitti_drive(path: Path) -> Drive:
    """A drive from a folder."""
    pair = next((pair for pair in PAIRS if (path / pair[0]).is_dir()), ("image_0", "image_1"))
    recorded = read_table(path / "times.txt", ("seconds",))[:, 0]
    left = _images_by_frame(path / pair[0], len(recorded))
    right, depth = (
        _images_by_frame(folder, len(recorded)) if folder.is_dir() else {}
        for folder in (path / pair[1], path / "depth")
    )
    available = np.array(sorted(left), np.int64)
    frames = FrameTimes.sort(recorded, str(path / "times.txt"), available)
    remarks = frames.remarks + _missing_images(available, path / pair[0])
    frames = replace(frames, remarks=remarks)
    numbers = frames.index.tolist()
    size = image_size(left[numbers[0]])
    calibration = _calibration(path, PAIRS[pair], size, stereo=bool(right))
    load = frame_loader(
        calibration,
        frames.time,
        left=image_files([left[i] for i in numbers]),
        right=image_files([right.get(i) for i in numbers]),
        depth=image_files([depth.get(i) for i in numbers], calibration.depth_unit),
    )
    return assemble_drive(path.resolve().name, path, calibration, frames, load)


def _images_by_frame(folder: Path, count: int) -> dict[int, Path]:
    """Images by the number in their names, or by their position in the sorted list."""
    paths = list_images(folder)
    numbers = [int(path.stem) for path in paths] if are_numbered(paths) else range(len(paths))
    frames = dict(zip(numbers, paths, strict=True))
    last = max(frames)
    if last >= count:
        raise DriveError(
            f"{frames[last]}: expected one of {count} frames as there are times, "
            f"found number {last}"
        )
    return frames


def _read_projections(path: Path) -> dict[str, FloatArray]:
    """The (3, 4) matrices of a calib.txt by their names."""
    matrices = {}
    for row in read_rows(path):
        name = row.cells[0]
        if name.startswith("P") and name.endswith(":"):
            values = row.numbers(slice(1, None))
            if len(values) != 12:
                raise row.error("12 numbers", str(len(values)))
            matrices[name[:-1]] = np.array(values).reshape(3, 4)
    return matrices


def read_extrinsics(archive: Archive) -> dict[str, FloatArray]:
    """Position (3,) and rotation (3, 3) of the camera on the robot from a `calib.npz`.

    Its `cam_T_imu` has the rotation from the frame of the inertial unit to that of the camera, but
    its translation is the position of the camera in the frame of the unit. The height is KITTI's.
    """
    matrix = archive.array("cam_T_imu", (4, 4)).astype(np.float64)
    position = np.array([matrix[0, 3], matrix[1, 3], KITTI_HEIGHT])
    return {"position": position, "rotation": np.ascontiguousarray(matrix[:3, :3].T)}


def _calibration(
    path: Path, names: tuple[str, str], size: tuple[int, int], stereo: bool
) -> Calibration:
    """The calibration in camera.toml, or by the projections of two names in calib.txt."""
    if (path / CAMERA_FILE).exists():
        return read_calibration(path / CAMERA_FILE)
    calib = path / "calib.txt"
    projections = _read_projections(calib)
    P = projections.get(names[0])
    if P is None:
        found = ", ".join(projections) or "none"
        raise DriveError(f"{calib}: expected {names[0]}, found {found}")
    width, height = size
    if not (0 < P[0, 2] < width and 0 < P[1, 2] < height):
        raise DriveError(
            f"{calib}: expected a principal point inside the images of {width} x {height} px, "
            f"found {P[0, 2]:.1f}, {P[1, 2]:.1f}"
        )
    extrinsics = {"position": np.array([0.0, 0.0, KITTI_HEIGHT]), "rotation": AHEAD.copy()}
    if (path / "calib.npz").exists():
        extrinsics = read_extrinsics(Archive(path / "calib.npz"))
    baseline, right = 0.0, projections.get(names[1])
    if stereo and right is not None:
        baseline = float(P[0, 3] / P[0, 0] - right[0, 3] / right[0, 0])
    return Calibration(pinhole(P, size, baseline=baseline, **extrinsics))


def _missing_images(available: IntArray, folder: Path) -> tuple[str, ...]:
    """A remark where numbers are missing between the first and the last image."""
    gaps = np.flatnonzero(np.diff(available) > 1)
    if len(gaps) == 0:
        return ()
    count = int((np.diff(available) - 1).sum())
    images = "image is" if count == 1 else "images are"
    return (f"{folder}: {count} {images} missing, first number {available[gaps[0]] + 1}",)
