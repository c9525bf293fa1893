"""Reads camera drives of every layout."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal, TypeAlias, cast, get_args

from saccade.datasets.drives.calibration import CAMERA_FILE
from saccade.datasets.drives.euroc import read_euroc_drive
from saccade.datasets.drives.folder import read_folder_drive, read_video_drive
from saccade.datasets.drives.kitti import PAIRS, read_kitti_drive
from saccade.datasets.drives.rosbag import read_rosbag_drive
from saccade.datasets.drives.tracks import TRACK_FILES, read_tracks_drive
from saccade.datasets.drives.tum_rgbd import read_tum_drive
from saccade.errors import DriveError, ImageError, LogError, require
from saccade.frames import Drive
from saccade.video import is_video

DriveKind: TypeAlias = Literal[
    "auto", "kitti", "tum-rgbd", "euroc", "rosbag", "tracks", "folder", "video"
]
"""The layouts; "auto" detects the layout from the files in the folder."""
_READERS: dict[DriveKind, Callable[[Path], Drive]] = {
    "kitti": read_kitti_drive,
    "tum-rgbd": read_tum_drive,
    "euroc": read_euroc_drive,
    "rosbag": read_rosbag_drive,
    "tracks": read_tracks_drive,
    "folder": read_folder_drive,
    "video": read_video_drive,
}


def load_drive(kind: DriveKind, path: str | Path) -> Drive:
    """Open a camera drive; its images are read on demand.

    Args:
        kind: "kitti", "tum-rgbd", "euroc", "rosbag" (ROS 1 and 2), "tracks" (point
            tracks), "folder" or "video" (with a camera.toml), or "auto". The module of each in
            `saccade.datasets.drives` lists its files.
        path: the folder or file.

    Raises:
        DriveError: a file is missing, broken, or not of this layout; one line that names it.
        ConfigError: no such kind, or it needs an extra that is not installed.
    """
    require(kind in get_args(DriveKind), "kind", f"one of {', '.join(get_args(DriveKind))}", kind)
    path = Path(path)
    if not path.exists():
        raise DriveError(f"{path}: expected a camera drive, found no such file or folder")
    if kind == "auto":
        kind = detect_layout(path)
    try:
        return _READERS[kind](path)
    except (ImageError, LogError) as error:
        raise DriveError(str(error)) from error


def detect_layout(path: Path) -> DriveKind:
    """Layout of a file or folder.

    Raises:
        DriveError: none of the known ones.
    """
    if path.is_file():
        kinds = {".bag": "rosbag", ".npz": "tracks"}
        kind = "video" if is_video(path) else kinds.get(path.suffix.lower())
        if kind is None:
            raise DriveError(f"{path}: expected a folder, a video, a .bag or an .npz, found none")
        return cast("DriveKind", kind)
    marks: tuple[tuple[DriveKind, tuple[str, ...]], ...] = (
        ("kitti", tuple(left for left, _ in PAIRS)),
        ("tum-rgbd", ("rgb.txt",)),
        ("euroc", ("mav0", "cam0")),
        ("rosbag", ("metadata.yaml",)),
        ("tracks", TRACK_FILES),
        ("folder", (CAMERA_FILE,)),
    )
    for kind, names in marks:
        if any((path / name).exists() for name in names):
            return kind
    expected = ", ".join(f"{names[0]} ({kind})" for kind, names in marks)
    raise DriveError(f"{path}: expected one of {expected}; found none of them")
