"""Drives whose points someone else has followed through the images of a stereo rig.

    stereo_tracks_clean.npz  or stereo_tracks.npz, or any file that is named:
                             frame (k,), ascending; track (k,) the same for the same point;
                             uvlr (k, 4) pixels: u left, v left, u right, v right
    calib.npz                K (3, 3), b the baseline in metres, cam_T_imu (see `read_extrinsics`)
    times.txt                seconds, one line a frame; frames beyond are left out

and odometry and truth as `sidecar_files` tells.

Files of this kind may have frames at which points were looked for anew, and every old one has an
exact copy of what it had in the frame before: the point goes on as another, and what is between
them is lost. The clean file has left out such observations and begins the tracks anew.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saccade.datasets.archive import Archive
from saccade.datasets.drives.camera_file import Calibration
from saccade.datasets.drives.image_files import images_of, in_time, size_of
from saccade.datasets.drives.kitti import read_extrinsics
from saccade.datasets.drives.sidecar_files import (
    assemble_drive,
    read_increments_or_unknown,
    read_truth,
)
from saccade.datasets.text import read_columns
from saccade.errors import DriveError
from saccade.frames import Camera, Drive, Frame, Tracks
from saccade.types import FloatArray, IntArray

NAMES = ("stereo_tracks_clean.npz", "stereo_tracks.npz")
"""What the file of a folder may be called."""


@dataclass(frozen=True, eq=False)
class TrackFile:
    """The tracks of frame i; what `Drive.load` is."""

    time: FloatArray
    """(n,) seconds."""
    first: IntArray
    """(n,) row at which the observations of each frame begin."""
    end: IntArray
    """(n,) row after their last."""
    tracks: Tracks
    """All observations, one frame after the other."""

    def __call__(self, i: int) -> Frame:
        """Frame i."""
        rows = slice(int(self.first[i]), int(self.end[i]))
        tracks = self.tracks
        seen = Tracks(tracks.id[rows], tracks.xy[rows], tracks.disparity[rows])
        return Frame(float(self.time[i]), tracks=seen)


def read_tracks_drive(path: Path) -> Drive:
    """A drive from a file of tracks, or from the folder it is in.

    Raises:
        DriveError, LogError: a file is missing, broken or does not fit the others; names it.
    """
    file = next((path / name for name in NAMES if (path / name).exists()), path)
    if file.is_dir():
        raise DriveError(f"{path}: expected {' or '.join(NAMES)}, found neither")
    folder = file.parent
    frame, tracks = _read(file)
    clock = read_columns(folder / "times.txt", ("seconds",))[:, 0]
    if len(clock) == 0:
        raise DriveError(f"{folder / 'times.txt'}: expected times of frames, found none")
    number, remarks = in_time(clock, str(folder / "times.txt"))
    camera = _camera(folder, tracks.xy)
    time = clock[number]
    steps = read_increments_or_unknown(folder, time, number)
    truth = read_truth(folder, clock, camera, time[0])
    first, end = (np.searchsorted(frame, number, side=side) for side in ("left", "right"))
    name = f"{folder.resolve().name}/{file.stem}"
    load = TrackFile(time, first, end, tracks)
    return assemble_drive(name, Calibration(camera), time, load, steps, truth, remarks)


def _read(file: Path) -> tuple[IntArray, Tracks]:
    """Frames (k,), ascending, and what was seen in them."""
    tables = Archive(file).tables
    shapes = {"frame": 1, "track": 1, "uvlr": 2}
    for name, dimensions in shapes.items():
        table = tables.get(name, np.zeros(0, object))
        if table.dtype.kind not in ("f" if name == "uvlr" else "iu") or table.ndim != dimensions:
            found = f"{table.dtype} of shape {table.shape}" if name in tables else "none"
            raise DriveError(f"{file}: expected {', '.join(shapes)}, found {name}: {found}")
    frame, track, uvlr = (tables[name] for name in shapes)
    if not len(frame) == len(track) == len(uvlr) or uvlr.shape[1] != 4:
        raise DriveError(
            f"{file}: expected as many frames and tracks as rows of uvlr (k, 4), "
            f"found {len(frame)}, {len(track)} and {uvlr.shape}"
        )
    if not np.isfinite(uvlr).all():
        raise DriveError(f"{file}, uvlr: expected finite numbers, found NaN")
    order = np.argsort(frame, kind="stable")
    seen = uvlr[order].astype(np.float64)
    tracks = Tracks(track[order].astype(np.int64), seen[:, :2], seen[:, 0] - seen[:, 2])
    return frame[order].astype(np.int64), tracks


def _camera(folder: Path, xy: FloatArray) -> Camera:
    """The camera of `calib.npz`; as large as the images beside it, or as what it saw."""
    calib = folder / "calib.npz"
    tables = Archive(calib).tables
    K, b = tables.get("K", np.zeros(0)), tables.get("b", np.zeros(0))
    numbers = K.dtype.kind in "fiu" and b.dtype.kind in "fiu"
    if K.shape != (3, 3) or b.size != 1 or not numbers:
        raise DriveError(
            f"{calib}: expected K of shape (3, 3) and a baseline b, found "
            f"{K.dtype} {K.shape} and {b.dtype} {b.shape}"
        )
    place, rotation = read_extrinsics(calib)
    seen = np.ceil(xy.max(0)) + 1 if len(xy) else np.ones(2)
    width, height = int(seen[0]), int(seen[1])
    if (folder / "image_0").is_dir():
        width, height = size_of(images_of(folder / "image_0")[0])
    return Camera(
        width=width,
        height=height,
        fx=float(K[0, 0]),
        fy=float(K[1, 1]),
        cx=float(K[0, 2]),
        cy=float(K[1, 2]),
        baseline=float(b.reshape(())),
        position=place,
        rotation=rotation,
    )
