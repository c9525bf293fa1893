"""Drives from a folder of images, or from a video, with a calibration beside it.

    camera.toml              see `camera_file`; needed
    the images               in the folder or in images/ in it: in the order of the numbers in
                             their names, or of the names; or the video, in the folder of the rest
    right/, depth/           optional, named as the images; a video has neither
    times.txt                optional: seconds, one line a frame; else `rate` of camera.toml, or
                             the frame rate of the video

and odometry and truth as `sidecar_files` tells.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saccade.datasets.drives.camera_file import CAMERA_FILE, read_calibration
from saccade.datasets.drives.image_files import ImageFiles, images_of, in_time, undistort
from saccade.datasets.drives.sidecar_files import (
    assemble_drive,
    read_increments_or_unknown,
    read_truth,
)
from saccade.datasets.drives.undistortion import Lens
from saccade.datasets.text import read_columns
from saccade.errors import DriveError
from saccade.frames import Camera, Drive, Frame
from saccade.types import FloatArray, IntArray
from saccade.video import VideoFrames


@dataclass(frozen=True, eq=False)
class _VideoFile:
    """Reads frame i from a video; what `Drive.load` is."""

    frames: VideoFrames
    number: IntArray
    camera: Camera
    time: FloatArray
    lens: Lens | None

    def __call__(self, i: int) -> Frame:
        number = int(self.number[i])
        name = f"{self.frames.path}, frame {number}"
        image = undistort(self.frames[number], self.camera, self.lens, name)
        return Frame(float(self.time[i]), image)


def read_folder_drive(path: Path) -> Drive:
    """A drive from a folder of images.

    Raises:
        DriveError, LogError: a file is missing, broken or does not fit the others; names it.
    """
    folder = path / "images" if (path / "images").is_dir() else path
    calibration = read_calibration(path / CAMERA_FILE)
    left = _in_order(images_of(folder))
    clock = _clock(path, len(left), calibration.rate)
    number, remarks = in_time(clock, str(path / "times.txt"))
    time, chosen = clock[number], [left[i] for i in number.tolist()]
    right, depth = (_beside(path / name, chosen) for name in ("right", "depth"))
    load = ImageFiles(
        calibration.camera,
        time,
        left=chosen,
        right=right,
        depth=depth,
        depth_unit=calibration.depth_unit,
        lens=Lens.of(calibration.camera, calibration.distortion),
        right_lens=Lens.of(calibration.camera, calibration.distortion),
    )
    steps = read_increments_or_unknown(path, time, number)
    truth = read_truth(path, clock, calibration.camera, time[0])
    return assemble_drive(path.resolve().name, calibration, time, load, steps, truth, remarks)


def read_video_drive(path: Path) -> Drive:
    """A drive from a video.

    Raises:
        DriveError, LogError, ImageError: a file is missing, broken or does not fit the others.
    """
    calibration = read_calibration(path.parent / CAMERA_FILE)
    frames = VideoFrames(path)
    clock = _clock(path.parent, len(frames), frames.rate)
    number, remarks = in_time(clock, str(path.parent / "times.txt"))
    if frames.declared > len(frames):
        remarks += (
            f"{path}: {frames.declared} frames are announced, {len(frames)} can be decoded: "
            "the video is cut",
        )
    lens = Lens.of(calibration.camera, calibration.distortion)
    time = clock[number]
    load = _VideoFile(frames, number, calibration.camera, time, lens)
    steps = read_increments_or_unknown(path.parent, time, number)
    truth = read_truth(path.parent, clock, calibration.camera, time[0])
    return assemble_drive(path.stem, calibration, time, load, steps, truth, remarks)


def _clock(folder: Path, frames: int, rate: float) -> FloatArray:
    """(n,) seconds of the frames."""
    path = folder / "times.txt"
    if not path.exists():
        return np.arange(frames) / rate
    clock = read_columns(path, ("seconds",))[:, 0]
    if len(clock) < frames:
        raise DriveError(f"{path}: expected a time for each of {frames} frames, found {len(clock)}")
    return clock[:frames]


def _in_order(paths: list[Path]) -> list[Path]:
    if all(path.stem.isascii() and path.stem.isdecimal() for path in paths):
        return sorted(paths, key=lambda path: int(path.stem))
    return paths


def _beside(folder: Path, chosen: list[Path]) -> list[Path | None]:
    """The images of a folder that are named as some others."""
    if not folder.is_dir():
        return []
    there = {path.stem: path for path in images_of(folder)}
    return [there.get(path.stem) for path in chosen]
