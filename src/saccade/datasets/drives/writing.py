"""Writes drives, and records a live camera."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from saccade.datasets.drives.calibration import (
    CAMERA_FILE,
    Calibration,
    write_calibration,
)
from saccade.datasets.drives.folder import (
    CameraOptions,
    assume_speed,
    assumed_increments,
    calibration_beside,
    has_images,
)
from saccade.datasets.drives.frames import FrameTimes, SourceImage, frame_reader
from saccade.datasets.drives.odometry import OdometryIncrements, write_increments
from saccade.datasets.drives.sidecar_files import GAZE_FILE, assemble_drive, write_turns
from saccade.datasets.drives.tracks import TRACK_FILES, write_tracks
from saccade.datasets.tables import write_tum
from saccade.errors import DriveError, OutputError
from saccade.frames import Camera, CameraTurn, Drive, EndOfDrive, Frame, Tracks
from saccade.io.files import LOCK, PARTIAL, results_in, writing
from saccade.io.video import LiveVideo
from saccade.types import Image

DRIVE_FILES = (
    *("calib.txt", CAMERA_FILE, "times.txt", "odometry.csv", "groundtruth.tum", "tags.csv"),
    *("image_0", "image_1", "depth", TRACK_FILES[-1], GAZE_FILE),
)
"""Files of a drive, which a new drive may replace."""


def save_drive(
    path: str | Path, drive: Drive, progress: Callable[[int, int], None] | None = None
) -> None:
    """Write a drive in KITTI's layout, or as tracks, with odometry and ground truth.

    The folder is written atomically and replaces an earlier drive.

    Args:
        path: the folder.
        drive: the drive, with images or with tracks alone.
        progress: function of the number of frames written and the total.

    Raises:
        ConfigError: another run is writing to the folder.
        DriveError: a frame has no images and no tracks, or the scale of the drive is unknown.
        ImageError: a frame cannot be read.
        OutputError: the folder cannot be written, or has files that do not belong to a drive.
    """
    path = Path(path)
    require_writable(path, drive)
    with results_in(path) as new, writing(path):
        _write(new, drive, progress)
        for name in DRIVE_FILES:  # links to files of an earlier drive
            old = path / name
            shutil.rmtree(old) if old.is_dir() else old.unlink(missing_ok=True)


def require_writable(path: Path, drive: Drive) -> None:
    """Check that a drive can be written to a folder."""
    if drive.scale != "metric":
        raise DriveError(
            f"{drive.name}: expected odometry and a calibration to write, found a drive whose "
            "scale is unknown"
        )
    with writing(path):
        names = {file.name for file in path.iterdir()} if path.exists() else set()
    for name in sorted(names - {*DRIVE_FILES, PARTIAL, LOCK})[:1]:
        raise OutputError(f"{path}: expected a new or empty folder, found {name!r} in it")


def _write(folder: Path, drive: Drive, progress: Callable[[int, int], None] | None) -> None:
    period = float(np.median(np.diff(drive.time))) if len(drive) > 1 else 0.0
    calibration = Calibration(
        drive.camera,
        **({"rate": 1 / period} if period > 0 else {}),
        odometry_bias=drive.odometry_bias,
        start=(*drive.start.tolist(),) if drive.start_known else None,
    )
    write_calibration(folder / CAMERA_FILE, calibration)
    np.savetxt(folder / "times.txt", drive.time, fmt="%.9f")
    if drive.has_odometry:
        increments = OdometryIncrements(drive.control, drive.control_covariance)
        write_increments(folder / "odometry.csv", increments)
    if drive.truth is not None:
        write_tum(folder / "groundtruth.tum", drive.truth)
    tracks, turns = list[Tracks](), list[CameraTurn | None]()
    for i in range(len(drive)):
        frame = drive.load(i)
        turns.append(frame.turn)
        if frame.image is not None:
            _write_images(folder, i, frame, calibration.depth_unit)
        elif frame.tracks is not None:
            tracks.append(frame.tracks)
        if len(tracks) != (0 if frame.image is not None else i + 1):
            raise DriveError(f"{drive.name}, frame {i}: expected an image to write, found none")
        if progress is not None:
            progress(i + 1, len(drive))
    if any(turns):
        write_turns(folder / GAZE_FILE, turns)
    if tracks:
        write_tracks(folder / TRACK_FILES[-1], tracks)
    else:
        (folder / "calib.txt").write_text(_projections(drive.camera), encoding="utf-8")


def _write_images(folder: Path, number: int, frame: Frame, depth_unit: float) -> None:
    """Write the images of a frame."""
    depth = _depth_steps(frame, depth_unit)
    for name, image in (("image_0", frame.image), ("image_1", frame.right), ("depth", depth)):
        if image is not None:
            write_png(folder / name / f"{number:06d}.png", image)


def _projections(camera: Camera) -> str:
    """P0 to P3 as KITTI writes them; P2 and P3 are the same cameras as P0 and P1."""
    left = np.column_stack([camera.matrix, np.zeros(3)])
    right = left.copy()
    right[0, 3] = -camera.fx * camera.baseline
    return "".join(
        f"P{i}: {' '.join(f'{value:.12e}' for value in P.ravel())}\n"
        for i, P in enumerate((left, right, left, right))
    )


def _depth_steps(frame: Frame, unit: float) -> Image | None:
    """Depth as a 16-bit image; 0 for unknown or out of range."""
    if frame.depth is None:
        return None
    steps = np.rint(np.nan_to_num(frame.depth, nan=0.0, posinf=0.0) / unit)
    return np.where((steps > 0) & (steps < 1 << 16), steps, 0).astype(np.uint16)


def write_png(path: Path, image: Image) -> None:
    """Write an image of 8 or 16 bits, or of floats in [0, 1]."""
    path.parent.mkdir(exist_ok=True)
    pixels = image
    if image.dtype.kind == "f":
        pixels = np.rint(image.clip(0, 1) * 255).astype(np.uint8)
    if pixels.ndim == 3:
        pixels = cv2.cvtColor(np.ascontiguousarray(pixels[:, :, :3]), cv2.COLOR_RGB2BGR)
    encoded, data = cv2.imencode(".png", pixels)
    if not encoded:
        raise OutputError(f"{path}: cannot be written: the image cannot be encoded")
    path.write_bytes(data.tobytes())


class LiveDrive:
    """A drive from a live camera, recorded to a folder.

    `drive.load` must be called once per frame, in order; it waits for the frame and writes it to
    the folder. Until then `drive.time` and the control assume the nominal frame rate. A single
    camera without odometry does not measure lengths, see `assume_speed`.

    Args:
        video: the camera.
        folder: folder of the recording; its camera.toml, if present, has the calibration.
        options: intrinsics, if there is no camera.toml.
        frames: maximum number of frames.
    """

    def __init__(self, video: LiveVideo, folder: Path, options: CameraOptions, frames: int) -> None:
        if folder.exists() and has_images(folder):
            raise DriveError(f"{folder}: expected no images beside the recording, found some")
        with writing(folder):
            (folder / "images").mkdir(parents=True, exist_ok=True)
        self._video, self._folder = video, folder
        calibration, assumptions, is_guess = calibration_beside(folder, video.size, options)
        self._calibration, self._is_guess = calibration, is_guess
        times = FrameTimes.sort(np.arange(frames) / video.rate, str(folder))
        self._read = frame_reader(calibration, times.time, left=self._record)
        drive = assemble_drive(
            video.name, folder, calibration, times, self._load, assumptions=assumptions
        )
        self.drive = assume_speed(drive, is_guess)
        self.times = list[float]()
        """Times of the recorded frames in seconds."""

    def close(self) -> None:
        """Write the times and the calibration, which complete the recorded drive."""
        with writing(self._folder):
            np.savetxt(self._folder / "times.txt", self.times, fmt="%.17g")
            if not self._is_guess:
                write_calibration(self._folder / CAMERA_FILE, self._calibration)

    def _load(self, number: int) -> Frame:
        frame, drive = self._read(number), self.drive
        drive.time[number:] = self.times[-1] + np.arange(len(drive) - number) / self._video.rate
        if number > 0:
            step = assumed_increments(np.diff(drive.time[number - 1 : number + 1]))
            drive.control[number - 1] = step.control[0]
            drive.control_covariance[number - 1] = step.covariance[0]
        return replace(frame, time=self.times[-1])

    def _record(self, number: int) -> SourceImage:
        taken = self._video.read()
        if taken is None:
            raise EndOfDrive
        seconds, pixels = taken
        with writing(self._folder):
            write_png(self._folder / "images" / f"{number:06d}.png", pixels)
        self.times.append(seconds)
        return SourceImage(pixels, f"{self._video.name}, frame {number}")
