"""The layouts of camera drives."""

from functools import partial
from pathlib import Path

from saccade.datasets.drives.calibration import CAMERA_FILE
from saccade.datasets.drives.euroc import ROOT, is_euroc, read_euroc_drive
from saccade.datasets.drives.folder import (
    PROJECTIONS,
    has_images,
    read_folder_drive,
    read_video_drive,
)
from saccade.datasets.drives.tracks import TRACK_FILES, read_tracks_drive
from saccade.datasets.drives.tum import read_tum_drive
from saccade.datasets.formats import Format
from saccade.datasets.ros.bags import BAG_SUFFIXES, is_bag
from saccade.datasets.ros.drives import read_rosbag_drive
from saccade.datasets.tables import read_rows
from saccade.io.files import VIDEO_SUFFIXES
from saccade.io.video import is_video


def _is_kitti(path: Path) -> bool:
    """Whether a folder has KITTI's times, a calib.txt with names, or no images at all."""
    if (path / "times.txt").exists() or (path / CAMERA_FILE).exists() or not has_images(path):
        return path.is_dir()
    calib = path / "calib.txt"
    return calib.exists() and any(row.cells[0].startswith("P") for row in read_rows(calib))


DRIVE_FORMATS = {
    "euroc": Format(read_euroc_drive, files=(ROOT, "cam0"), recognizes=is_euroc),
    "kitti": Format(
        partial(read_folder_drive, is_kitti=True), files=(*PROJECTIONS,), recognizes=_is_kitti
    ),
    "tum-rgbd": Format(read_tum_drive, files=("rgb.txt",)),
    "tracks": Format(read_tracks_drive, suffixes=(".npz",), files=TRACK_FILES),
    "rosbag": Format(
        read_rosbag_drive,
        suffixes=BAG_SUFFIXES,
        recognizes=lambda path: is_bag(path) and not has_images(path),
    ),
    "folder": Format(
        read_folder_drive,
        recognizes=lambda path: path.is_dir() and (has_images(path) or _has_calibration(path)),
    ),
    "video": Format(
        read_video_drive,
        suffixes=VIDEO_SUFFIXES,
        recognizes=lambda path: path.is_file() and is_video(path),
    ),
}
"""Layouts of camera drives by name, in the order in which they are recognized."""


def _has_calibration(path: Path) -> bool:
    return (path / CAMERA_FILE).exists()
