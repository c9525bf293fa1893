"""Drives given as point tracks of a stereo rig.

    stereo_tracks_clean.npz  or stereo_tracks.npz, or any file given by name:
                             frame (k,), ascending; track (k,) id of the point;
                             uvlr (k, 4) pixels: u left, v left, u right, v right; u right is u
                             left where the depth is unknown;
                             descriptors (k, 128) uint8, optional: SIFT descriptors
    calib.npz                K (3, 3), b the baseline in meters, cam_T_imu (see `kitti_extrinsics`);
                             or camera.toml, see `calibration`
    times.txt                seconds, one line a frame; later frames are dropped

Odometry and ground truth are described in `sidecar_files`.

In keyframes, some trackers restart and repeat every observation of the previous frame: each point
continues as a new track, and the motion between the two frames is lost. In the clean file these
observations are removed and the tracks split.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from saccade.datasets.drives.calibration import (
    CAMERA_FILE,
    Calibration,
    kitti_extrinsics,
    read_calibration,
)
from saccade.datasets.drives.frames import FrameTimes, image_size, list_images
from saccade.datasets.drives.sidecar_files import assemble_drive
from saccade.datasets.tables import Archive, read_table
from saccade.errors import DriveError
from saccade.frames import Camera, Drive, Frame, Tracks
from saccade.io.npz import save_arrays
from saccade.types import FloatArray, IntArray

TRACK_FILES = ("stereo_tracks_clean.npz", "stereo_tracks.npz")
"""File names looked for in a folder."""


def read_tracks_drive(path: Path) -> Drive:
    """Reads a drive from a file of tracks, or from its folder."""
    file = next((path / name for name in TRACK_FILES if (path / name).exists()), path)
    if file.is_dir():
        raise DriveError(f"{path}: expected {' or '.join(TRACK_FILES)}, found neither")
    folder = file.parent
    frame_of, tracks = _read_tracks(file)
    recorded = read_table(folder / "times.txt", ("seconds",))[:, 0]
    if len(recorded) == 0:
        raise DriveError(f"{folder / 'times.txt'}: expected times of frames, found none")
    frames = FrameTimes.sort(recorded, str(folder / "times.txt"))
    if (folder / CAMERA_FILE).exists():
        calibration = read_calibration(folder / CAMERA_FILE)
    else:
        calibration = Calibration(_camera(folder, tracks.xy))

    def read(number: int) -> Frame:
        first, last = np.searchsorted(frame_of, [number, number + 1]).tolist()
        return Frame(float(recorded[number]), tracks=tracks[first:last])

    name = f"{folder.resolve().name}/{file.stem}"
    return assemble_drive(name, folder, calibration, frames, read)


def is_tracks(path: Path) -> bool:
    """Whether an .npz has tracks."""
    return "uvlr" in Archive(path)


def _read_tracks(file: Path) -> tuple[IntArray, Tracks]:
    """Frame numbers (k,) of the observations, ascending, and the observations."""
    archive = Archive(file)
    frame = archive.array("frame", (None,), "iu")
    count, descriptors = len(frame), None
    track, uvlr = archive.array("track", (count,), "iu"), archive.array("uvlr", (count, 4), "f")
    order = np.argsort(frame, kind="stable")
    if "descriptors" in archive:
        descriptors = archive.array("descriptors", (count, 128), "u")[order]
        if descriptors.dtype != np.uint8:
            raise DriveError(f"{file}: descriptors: expected uint8, found {descriptors.dtype}")
    uvlr = uvlr[order].astype(np.float64)
    disparity = uvlr[:, 0] - uvlr[:, 2]
    tracks = Tracks(track[order].astype(np.int64), uvlr[:, :2], disparity, descriptors)
    return frame[order].astype(np.int64), tracks


def write_tracks(file: Path, tracks: Sequence[Tracks]) -> None:
    """Write the tracks of successive frames."""
    disparity = np.concatenate([each.disparity for each in tracks])
    u, v = np.concatenate([each.xy for each in tracks]).T
    arrays = {
        "frame": np.repeat(np.arange(len(tracks)), [len(each) for each in tracks]),
        "track": np.concatenate([each.id for each in tracks]),
        "uvlr": np.column_stack([u, v, u - np.nan_to_num(disparity), v]),
    }
    descriptors = [each.descriptor for each in tracks if each.descriptor is not None]
    if len(descriptors) == len(tracks):
        arrays["descriptors"] = np.concatenate(descriptors)
    save_arrays(file, arrays)


def _camera(folder: Path, xy: FloatArray) -> Camera:
    """The camera of `calib.npz`, with the size of adjacent images, or else the extent of `xy`."""
    archive = Archive(folder / "calib.npz")
    K, baseline = archive.array("K", (3, 3)), archive.array("b")
    if baseline.size != 1:
        raise DriveError(f"{archive.path}: expected one baseline b, found {baseline.size}")
    width, height = (np.ceil(xy.max(0)) + 1 if len(xy) else np.ones(2)).astype(int).tolist()
    if (folder / "image_0").is_dir():
        width, height = image_size(list_images(folder / "image_0")[0])
    extrinsics = kitti_extrinsics(archive.path)
    return Camera.from_matrix(K, (width, height), baseline=float(baseline.item()), **extrinsics)
