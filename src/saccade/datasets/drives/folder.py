"""Drives from a folder of images, or from a video, with a calibration beside it.

    camera.toml              see `calibration`; required
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

from saccade.datasets.drives.calibration import CAMERA_FILE, read_calibration
from saccade.datasets.drives.frames import (
    FrameTimes,
    SourceImage,
    are_numbered,
    frame_loader,
    image_files,
    list_images,
)
from saccade.datasets.drives.sidecar_files import assemble_drive
from saccade.datasets.tables import read_table
from saccade.errors import DriveError
from saccade.frames import Drive
from saccade.video import VideoFrames


def read_folder_drive(path: Path) -> Drive:
    """A drive from a folder of images."""
    folder = path / "images" if (path / "images").is_dir() else path
    calibration = read_calibration(path / CAMERA_FILE)
    images = list_images(folder)
    if are_numbered(images):
        images.sort(key=lambda image: int(image.stem))
    frames = _frame_times(path, len(images), calibration.rate)
    left = [images[i] for i in frames.index.tolist()]
    load = frame_loader(
        calibration,
        frames.time,
        left=image_files(left),
        right=image_files(_same_names(path / "right", left)),
        depth=image_files(_same_names(path / "depth", left), calibration.depth_unit),
    )
    return assemble_drive(path.resolve().name, path, calibration, frames, load)


def read_video_drive(path: Path) -> Drive:
    """A drive from a video."""
    calibration = read_calibration(path.parent / CAMERA_FILE)
    video = VideoFrames(path)
    frames = _frame_times(path.parent, len(video), video.rate)
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
    return assemble_drive(path.stem, path.parent, calibration, frames, load)


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


def _same_names(folder: Path, images: list[Path]) -> list[Path | None]:
    """For each image the one of a folder with the same name; None where there is none."""
    others = {path.stem: path for path in list_images(folder)} if folder.is_dir() else {}
    return [others.get(image.stem) for image in images]
