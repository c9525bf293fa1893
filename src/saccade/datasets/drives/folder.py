"""Drives from a folder of images, or from a video, with a calibration beside it.

    camera.toml              see `calibration`; without it the camera is guessed, see `bare`
    the images               in the folder or its subfolder images/: sorted by the numbers in
                             their names, or by name; or the video, in the folder of the rest
    right/, depth/           optional, with the names of the images; not with a video
    times.txt                optional: seconds, one line a frame; else `rate` of camera.toml, or
                             the frame rate of the video

and odometry and ground truth as in `sidecar_files`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from saccade.datasets.drives.bare import BareCamera, CameraOptions, bare_camera, image_folders
from saccade.datasets.drives.calibration import CAMERA_FILE, read_calibration
from saccade.datasets.drives.frames import (
    FrameTimes,
    SourceImage,
    are_numbered,
    frame_loader,
    image_files,
    image_size,
    list_images,
)
from saccade.datasets.drives.odometry import OdometryIncrements
from saccade.datasets.drives.sidecar_files import assemble_drive
from saccade.datasets.tables import read_table
from saccade.errors import DriveError
from saccade.frames import Drive
from saccade.io.video import VideoFrames
from saccade.types import FloatArray

ASSUMED_SPEED = 1.0
"""Units per second of a single camera without odometry."""
ASSUMED_TURN = 0.2
"""Standard deviation of its turn from frame to frame, in radians."""
_NO_SCALE = "the scale is unknown, since a single camera without odometry measures no lengths: "
HELD_SCALE = _NO_SCALE + "metres are units, of which it moves one a second in the first step"
ASSUMED_SCALE = _NO_SCALE + "metres are units, and a constant speed of one a second is assumed"


def read_folder_drive(path: Path, options: CameraOptions | None = None) -> Drive:
    """A drive from a folder of images."""
    folder, right = image_folders(path)
    images = list_images(folder)
    if are_numbered(images):
        images.sort(key=lambda image: int(image.stem))
    calibration, remark, is_guess = calibration_beside(path, images[0], None, options)
    assumptions = tuple(filter(None, [remark]))
    if right is not None and calibration.camera.baseline == 0:
        assumptions += (f"{right}: not used, since the baseline is unknown; --baseline gives it",)
        right = None
    frames = _frame_times(path, len(images), calibration.rate)
    left = [images[i] for i in frames.index.tolist()]
    load = frame_loader(
        calibration,
        frames.time,
        left=image_files(left),
        right=image_files(_same_names(right, left)),
        depth=image_files(_same_names(path / "depth", left), calibration.depth_unit),
    )
    drive = assemble_drive(path.resolve().name, path, calibration, frames, load)
    drive = replace(drive, assumptions=assumptions)
    return drive if (path / "depth").is_dir() else assume_speed(drive, is_guess)


def read_video_drive(path: Path, options: CameraOptions | None = None) -> Drive:
    """A drive from a video."""
    video = VideoFrames(path)
    height, width = video[0].shape[:2]
    size = width, height
    calibration, remark, is_guess = calibration_beside(path.parent, None, size, options, path)
    frames = _frame_times(path.parent, len(video), video.rate)
    assumptions = tuple(filter(None, [remark]))
    if video.declared > len(video):
        remark = (
            f"{path}: {video.declared} frames are announced, {len(video)} can be decoded: "
            "the video is truncated"
        )
        frames = replace(frames, remarks=(*frames.remarks, remark))

    def read(i: int) -> SourceImage:
        number = int(frames.index[i])
        return SourceImage(video[number], f"{path}, frame {number}")

    load = frame_loader(calibration, frames.time, left=read)
    drive = assemble_drive(path.stem, path.parent, calibration, frames, load)
    return assume_speed(replace(drive, assumptions=assumptions), is_guess)


def assume_speed(drive: Drive, is_guess: bool = False) -> Drive:
    """A drive of one camera without odometry, with an assumed speed: one unit in a second.

    Where the focal length is a guess, in all steps: its error makes a scale that is held from step
    to step drift; else in the first.
    """
    if drive.camera.baseline > 0 or drive.control.any() or len(drive) < 2:
        return drive
    increments = assumed_increments(np.diff(drive.time))
    return replace(
        drive,
        control=increments.control,
        control_covariance=increments.covariance,
        scale="assumed" if is_guess else "held",
        assumptions=(*drive.assumptions, ASSUMED_SCALE if is_guess else HELD_SCALE),
    )


def assumed_increments(duration: FloatArray) -> OdometryIncrements:
    """Increments over durations (m,) in seconds at the assumed speed, straight ahead."""
    step = ASSUMED_SPEED * duration
    sigma = np.stack([step / 2, step / 2, np.full(len(step), ASSUMED_TURN)], 1)
    control = np.stack([step, 0 * step, 0 * step], 1)
    return OdometryIncrements(control, np.square(sigma)[:, :, None] * np.eye(3))


def calibration_beside(
    folder: Path,
    image: Path | None,
    size: tuple[int, int] | None,
    options: CameraOptions | None,
    source: Path | None = None,
) -> BareCamera:
    """The calibration of camera.toml, or that of a bare folder with a remark about it.

    The remark names the `source`, if the frames are not in the folder's images.
    """
    file, options = folder / CAMERA_FILE, options or CameraOptions()
    if file.exists():
        if options != CameraOptions():
            raise DriveError(f"{file}: gives the camera; expected no --intrinsics or --baseline")
        return BareCamera(read_calibration(file))
    if size is None:
        assert image is not None
        size = image_size(image)
    camera = bare_camera(folder, size, image, options)
    return camera._replace(remark=f"{source or folder}: {camera.remark}")


def _frame_times(folder: Path, count: int, rate: float) -> FrameTimes:
    path = folder / "times.txt"
    if not path.exists():
        return FrameTimes.sort(np.arange(count) / rate, str(path))
    recorded = read_table(path, ("seconds",))[:, 0]
    if len(recorded) < count:
        raise DriveError(
            f"{path}: expected a time for each of {count} frames, found {len(recorded)}"
        )
    return FrameTimes.sort(recorded[:count], str(path))


def _same_names(folder: Path | None, images: list[Path]) -> list[Path | None]:
    """For each image the one of a folder with the same name; None where there is none."""
    others = {path.stem: path for path in list_images(folder)} if folder and folder.is_dir() else {}
    return [others.get(image.stem) for image in images]
