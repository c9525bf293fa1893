"""Writes camera drives in KITTI's layout (see `kitti`)."""

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from saccade.datasets.drives.camera_file import CAMERA_FILE, Calibration, write_calibration
from saccade.datasets.drives.odometry_csv import write_increments
from saccade.datasets.drives.odometry_increments import OdometryIncrements
from saccade.datasets.drives.undistortion import camera_matrix
from saccade.datasets.estimates import write_tum
from saccade.errors import DriveError, OutputError
from saccade.frames import Camera, Drive, Frame
from saccade.types import Image

DRIVE_FILES = (
    *("calib.txt", CAMERA_FILE, "times.txt", "odometry.csv", "groundtruth.tum"),
    *("image_0", "image_1", "depth"),
)
"""Files of an earlier drive, which may be replaced."""
DEPTH_UNIT = 0.001
"""Metres per step of the depth images."""


def save_drive(
    path: str | Path, drive: Drive, progress: Callable[[int, int], None] | None = None
) -> None:
    """Write a drive as a folder in KITTI's layout, with odometry.csv and groundtruth.tum.

    The folder is written atomically; one of an earlier drive is replaced.

    Args:
        path: the folder.
        drive: with images; tracks are not part of the layout.
        progress: called with the number of frames written, and of all.

    Raises:
        DriveError: a frame has no image.
        ImageError: a frame cannot be read.
        OutputError: the folder cannot be written, or holds other files than those of a drive.
    """
    path = Path(path)
    try:
        names = {file.name for file in path.iterdir()} if path.exists() else set()
        for name in sorted(names - set(DRIVE_FILES))[:1]:
            raise OutputError(f"{path}: expected a new or empty folder, found {name!r} in it")
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".saccade-", dir=path.parent))
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    try:
        _write(temporary / "new", drive, progress)
        _exchange(path, temporary / "new", temporary / "old")
    except OutputError as error:
        raise OutputError(str(error).replace(str(temporary / "new"), str(path))) from error
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _exchange(path: Path, new: Path, old: Path) -> None:
    """Replace a folder that may exist by the new one; on failure restore it."""
    if path.exists():
        path.replace(old)
    try:
        new.replace(path)
    except OSError:
        if old.exists():
            old.replace(path)
        raise


def _write(folder: Path, drive: Drive, progress: Callable[[int, int], None] | None) -> None:
    folder.mkdir()
    calibration = Calibration(
        drive.camera,
        depth_unit=DEPTH_UNIT,
        odometry_bias=drive.odometry_bias,
        start=(float(drive.start[0]), float(drive.start[1]), float(drive.start[2])),
    )
    write_calibration(folder / CAMERA_FILE, calibration)
    (folder / "calib.txt").write_text(_projections(drive.camera), encoding="utf-8")
    np.savetxt(folder / "times.txt", drive.time, fmt="%.9f")
    write_increments(
        folder / "odometry.csv", OdometryIncrements(drive.control, drive.control_covariance)
    )
    if drive.truth is not None:
        write_tum(folder / "groundtruth.tum", drive.truth)
    for i in range(len(drive)):
        frame = drive.load(i)
        if frame.image is None:
            raise DriveError(f"{drive.name}, frame {i}: expected an image to write, found none")
        images = {
            "image_0": frame.image,
            "image_1": frame.right,
            "depth": _depth_steps(frame),
        }
        for name, image in images.items():
            if image is not None:
                _write_png(folder / name / f"{i:06d}.png", image)
        if progress is not None:
            progress(i + 1, len(drive))


def _projections(camera: Camera) -> str:
    """P0 to P3 as KITTI writes them; P2 and P3 are the same cameras as P0 and P1."""
    left = np.column_stack([camera_matrix(camera), np.zeros(3)])
    right = left.copy()
    right[0, 3] = -camera.fx * camera.baseline
    lines = [
        f"P{i}: " + " ".join(f"{value:.12e}" for value in P.ravel())
        for i, P in enumerate((left, right, left, right))
    ]
    return "\n".join(lines) + "\n"


def _depth_steps(frame: Frame) -> Image | None:
    """Depth as a 16-bit image; 0 where it is unknown or out of range."""
    if frame.depth is None:
        return None
    steps = np.rint(np.nan_to_num(frame.depth, nan=0.0, posinf=0.0) / DEPTH_UNIT)
    return np.where((steps > 0) & (steps < 1 << 16), steps, 0).astype(np.uint16)


def _write_png(path: Path, image: Image) -> None:
    path.parent.mkdir(exist_ok=True)
    pixels = image
    if pixels.dtype.kind == "f":
        pixels = np.rint(pixels.clip(0, 1) * 255).astype(np.uint8)
    if pixels.ndim == 3:
        pixels = cv2.cvtColor(np.ascontiguousarray(pixels[:, :, :3]), cv2.COLOR_RGB2BGR)
    encoded, data = cv2.imencode(".png", pixels)
    if not encoded:
        raise OutputError(f"{path}: cannot be written: the image cannot be encoded")
    path.write_bytes(data.tobytes())
