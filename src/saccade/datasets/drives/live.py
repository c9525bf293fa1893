"""A drive whose frames come from a live camera, and are recorded while it is mapped."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from saccade.datasets.drives.calibration import CAMERA_FILE, write_calibration
from saccade.datasets.drives.folder import (
    CameraOptions,
    assume_speed,
    assumed_increments,
    calibration_beside,
    has_images,
)
from saccade.datasets.drives.frames import FrameTimes, SourceImage, frame_loader
from saccade.datasets.drives.sidecar_files import assemble_drive
from saccade.datasets.drives.writing import write_png
from saccade.errors import DriveError, OutputError
from saccade.frames import EndOfDrive, Frame
from saccade.io.files import reason_of, written_at_once
from saccade.io.video import LiveVideo


class LiveDrive:
    """A drive from a camera, and the folder in which it is recorded.

    `drive.load` takes frames in their order, each once: it waits for the next one and writes it to
    the folder. Until a frame is loaded, its time in `drive.time` and its control are those of a
    camera that keeps its rate. A single camera without odometry measures no lengths: see
    `assume_speed`.

    Args:
        video: the camera.
        folder: of the recording; its camera.toml, if there, is the calibration.
        options: intrinsics, without a camera.toml.
        frames: maximum number.

    Raises:
        DriveError: the folder has images, or the frames another size than its calibration.
        OutputError: the folder cannot be written.
    """

    def __init__(self, video: LiveVideo, folder: Path, options: CameraOptions, frames: int) -> None:
        if folder.exists() and has_images(folder):
            raise DriveError(f"{folder}: expected no images beside the recording, found some")
        try:
            (folder / "images").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{folder}: cannot be written: {reason_of(error)}") from error
        self._video, self._folder = video, folder
        calibration, remark, is_guess = calibration_beside(folder, None, video.size, options)
        self._calibration, self._is_guess = calibration, is_guess
        times = FrameTimes.sort(np.arange(frames) / video.rate, str(folder))
        self._read = frame_loader(calibration, times.time, left=self._record)
        drive = assemble_drive(video.name, folder, calibration, times, self._load)
        drive = replace(drive, assumptions=tuple(filter(None, [remark])))
        self.drive = assume_speed(drive, is_guess)
        self.times = list[float]()
        """Seconds of each recorded frame."""

    def close(self) -> None:
        """Write the times and the calibration, with which the recording is a drive of its own."""
        try:
            np.savetxt(self._folder / "times.txt", self.times, fmt="%.17g")
            if not self._is_guess:
                with written_at_once():
                    write_calibration(self._folder / CAMERA_FILE, self._calibration)
        except OSError as error:
            raise OutputError(f"{self._folder}: cannot be written: {reason_of(error)}") from error

    def _load(self, number: int) -> Frame:
        frame, drive = self._read(number), self.drive
        drive.time[number:] = self.times[-1] + np.arange(len(drive) - number) / self._video.rate
        if number > 0:
            step = assumed_increments(np.diff(drive.time[number - 1 : number + 1]))
            drive.control[number - 1], drive.control_covariance[number - 1] = (
                each[0] for each in step
            )
        return replace(frame, time=self.times[-1])

    def _record(self, number: int) -> SourceImage:
        taken = self._video.read()
        if taken is None:
            raise EndOfDrive
        seconds, pixels = taken
        try:
            write_png(self._folder / "images" / f"{number:06d}.png", pixels)
        except OSError as error:
            raise OutputError(f"{self._folder}: cannot be written: {reason_of(error)}") from error
        self.times.append(seconds)
        return SourceImage(pixels, f"{self._video.name}, frame {number}")
