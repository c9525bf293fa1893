"""Reads camera drives of every layout."""

from collections.abc import Callable
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Literal, TypeAlias, cast, get_args

from saccade.datasets.drives.calibration import CAMERA_FILE
from saccade.datasets.drives.folder import (
    PROJECTIONS,
    CameraOptions,
    has_images,
    read_folder_drive,
    read_video_drive,
)
from saccade.datasets.drives.tracks import TRACK_FILES, read_tracks_drive
from saccade.datasets.drives.tum import read_tum_drive
from saccade.datasets.ros.bags import BAG_SUFFIXES, bag_files
from saccade.datasets.ros.drives import read_rosbag_drive
from saccade.datasets.tables import read_rows
from saccade.errors import DriveError, ImageError, LogError, require
from saccade.frames import Drive
from saccade.io.video import is_video

DriveKind: TypeAlias = Literal["auto", "kitti", "tum-rgbd", "rosbag", "tracks", "folder", "video"]
"""The layouts; "auto" detects the layout from the files in the folder."""
_READERS: dict[DriveKind, Callable[..., Drive]] = {
    "kitti": partial(read_folder_drive, is_kitti=True),
    "tum-rgbd": read_tum_drive,
    "rosbag": read_rosbag_drive,
    "tracks": read_tracks_drive,
    "folder": read_folder_drive,
    "video": read_video_drive,
}


def load_drive(kind: DriveKind, path: str | Path, camera: CameraOptions | None = None) -> Drive:
    """Open a camera drive; its images are read on demand.

    Args:
        kind: "kitti", "tum-rgbd", "rosbag" (ROS 1 and 2), "tracks" (point tracks), "folder" or
            "video" (whose camera is guessed without a camera.toml), or "auto". The modules in
            `saccade.datasets.drives` list the files of each layout.
        path: the folder or file.
        camera: intrinsics and baseline for images without a calibration.

    Raises:
        DriveError: a file is missing, broken, or not of this layout; the message names it.
        ConfigError: unknown kind, or a missing extra.
    """
    require(kind in get_args(DriveKind), "kind", f"one of {', '.join(get_args(DriveKind))}", kind)
    path = Path(path)
    if not path.exists():
        raise DriveError(f"{path}: expected a camera drive, found no such file or folder")
    try:
        kind = detect_layout(path) if kind == "auto" else kind
        reader = _READERS[kind]
        if "options" in signature(reader).parameters:
            return reader(path, camera)
        if camera not in (None, CameraOptions()):
            raise DriveError(
                f"{path}: has a calibration ({kind} layout); leave out --intrinsics and --baseline"
            )
        return reader(path)
    except (ImageError, LogError) as error:
        raise DriveError(str(error)) from error


def detect_layout(path: Path) -> DriveKind:
    """Layout of a file or folder."""
    if path.is_file():
        kinds = dict.fromkeys(BAG_SUFFIXES, "rosbag") | {".npz": "tracks"}
        kind = "video" if is_video(path) else kinds.get(path.suffix.lower())
        if kind is None:
            raise DriveError(f"{path}: expected a folder, a video, a bag or an .npz, found none")
        return cast("DriveKind", kind)
    marks: tuple[tuple[DriveKind, tuple[str, ...]], ...] = (
        ("kitti", tuple(left for left in PROJECTIONS if _is_kitti(path))),
        ("tum-rgbd", ("rgb.txt",)),
        ("rosbag", ("metadata.yaml",)),
        ("tracks", TRACK_FILES),
        ("folder", (CAMERA_FILE,)),
    )
    for kind, names in marks:
        if any((path / name).exists() for name in names):
            return kind
    if has_images(path):
        return "folder"
    if bag_files(path):
        return "rosbag"
    expected = ", ".join(f"{names[0]} ({kind})" for kind, names in marks if names)
    raise DriveError(f"{path}: expected one of {expected}; found none of these")


def _is_kitti(path: Path) -> bool:
    """Whether a folder has KITTI's times, a calib.txt with names, or no images at all."""
    if (path / "times.txt").exists() or (path / CAMERA_FILE).exists() or not has_images(path):
        return True
    calib = path / "calib.txt"
    return calib.exists() and any(row.cells[0].startswith("P") for row in read_rows(calib))
