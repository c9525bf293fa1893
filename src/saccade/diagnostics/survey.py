"""One look through a drive: what its frames show, and how they say it moved."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from saccade.diagnostics.motion import motion_between
from saccade.diagnostics.tracks import (
    Points,
    PreparedFrame,
    match_points,
    points_of,
    shrink_factor,
    shrunk,
)
from saccade.errors import ImageError
from saccade.frames import Camera, Drive, Tracks
from saccade.types import FloatArray, IntArray

BLOCKS = 4
"""Stretches, evenly spread, into which frames are gathered where a drive has too many."""
COPIED = 0.5
"""Share of the tracks of two frames that are exact copies, above which the frame is one."""
LEAST_COPIES = 5
"""Tracks that must be common to two frames before they may be said to be copies."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What was seen of m frames."""

    frame: IntArray
    """(m,) their numbers, ascending."""
    brightness: FloatArray
    """(m,) mean grey level of 255; NaN without an image."""
    contrast: FloatArray
    """(m,) standard deviation of the grey levels; NaN without an image."""
    sharpness: FloatArray
    """(m,) how much of the contrast is between neighbours; NaN without an image."""
    points: IntArray
    """(m,) how many there were to follow."""
    copied: npt.NDArray[np.bool_]
    """(m,) whether the frame is an exact copy of the one before."""
    unreadable: dict[int, str]
    """Messages by number of the frame."""
    rotation: FloatArray
    """(m, 3) as `Motion.turn`, from the frame before to this one; NaN where not known."""
    translation: FloatArray
    """(m, 3) as `Motion.way`; NaN where not known."""
    metric: npt.NDArray[np.bool_]
    """(m,) whether the way is in metres."""
    disparity: FloatArray
    """(d,) of all points for which the right image has one, in pixels of the whole image."""
    rows_apart: FloatArray
    """(d,) by how much the right image has them lower; NaN where not known."""

    def __len__(self) -> int:
        return len(self.frame)


def survey_drive(
    drive: Drive, most: int, progress: Callable[[int, int], None] | None = None
) -> Survey:
    """Look at the frames of a drive.

    Args:
        drive: to be looked at.
        most: images; tracks are looked at whatever their number.
        progress: told the number of frames done, and of all.
    """
    shrink = shrink_factor(drive.camera)
    chosen = chosen_frames(len(drive), most)
    first = next((i for i in chosen if _readable(drive, i)), None)
    tracks = first is not None and drive.load(first).tracks is not None
    if tracks:
        chosen = list(range(len(drive)))
    surveyor = _Surveyor(drive, drive.camera if tracks else shrunk(drive.camera, shrink), shrink)
    for done, i in enumerate(chosen, 1):
        surveyor.add(i)
        if progress is not None:
            progress(done, len(chosen))
    return surveyor.survey()


def chosen_frames(n: int, most: int) -> list[int]:
    """All of n frames, or stretches of them that are `most` together."""
    if n <= most:
        return list(range(n))
    size = most // BLOCKS
    starts = np.linspace(0, n - size, BLOCKS).astype(int).tolist()
    return sorted({i for start in starts for i in range(start, start + size)})


def _readable(drive: Drive, i: int) -> bool:
    try:
        drive.load(i)
    except ImageError:
        return False
    return True


class _Surveyor:
    """What has been seen so far, and the frame before."""

    def __init__(self, drive: Drive, camera: Camera, shrink: int) -> None:
        self.drive, self.camera, self.shrink = drive, camera, shrink
        self.rows: list[list[float]] = []
        self.motions: list[list[float]] = []
        self.unreadable: dict[int, str] = {}
        self.pairs: list[FloatArray] = []
        self.before: tuple[int, PreparedFrame, Points | None] | None = None

    def add(self, i: int) -> None:
        try:
            view = PreparedFrame.of(self.drive.load(i), self.shrink)
        except ImageError as error:
            self.unreadable[i] = str(error)
            self.before = None
            self.rows.append([i, np.nan, np.nan, np.nan, 0, 0])
            self.motions.append([np.nan] * 6 + [0])
            return
        points = points_of(view, self.camera)
        last = self.before if self.before is not None and self.before[0] == i - 1 else None
        copied = last is not None and _is_copy(last[1], view)
        self.rows.append([i, *_of_picture(view), len(points.xy) if points else 0, copied])
        self.motions.append(self._motion(last, view, points))
        if points is not None:
            known = np.isfinite(points.disparity)
            self.pairs.append(np.stack([points.disparity, points.rows_apart], 1)[known])
        self.before = (i, view, points)

    def _motion(
        self,
        last: tuple[int, PreparedFrame, Points | None] | None,
        view: PreparedFrame,
        points: Points | None,
    ) -> list[float]:
        motion = None
        if last is not None and last[2] is not None:
            pairs = match_points(last[2], (last[1], view), points)
            motion = motion_between(*pairs, self.camera)
        if motion is None:
            return [np.nan] * 6 + [0]
        return [*motion.rotation.tolist(), *motion.translation.tolist(), motion.metric]

    def survey(self) -> Survey:
        rows, motions = np.array(self.rows, np.float64), np.array(self.motions, np.float64)
        whole = 1 if self.camera is self.drive.camera else self.shrink
        pairs = np.concatenate([np.zeros((0, 2)), *self.pairs]) * whole
        return Survey(
            frame=rows[:, 0].astype(np.int64),
            brightness=rows[:, 1],
            contrast=rows[:, 2],
            sharpness=rows[:, 3],
            points=rows[:, 4].astype(np.int64),
            copied=rows[:, 5] > 0,
            unreadable=self.unreadable,
            rotation=motions[:, :3],
            translation=motions[:, 3:6],
            metric=motions[:, 6] > 0,
            disparity=pairs[:, 0],
            rows_apart=pairs[:, 1],
        )


def _of_picture(view: PreparedFrame) -> tuple[float, float, float]:
    """Brightness, contrast and sharpness."""
    if view.grey is None:
        return np.nan, np.nan, np.nan
    contrast = float(view.grey.std())
    fine = float(np.abs(cv2.Laplacian(view.grey, cv2.CV_16S)).mean())
    return float(view.grey.mean()), contrast, fine / max(contrast, 1.0)


def _is_copy(before: PreparedFrame, now: PreparedFrame) -> bool:
    if now.tracks is not None and before.tracks is not None:
        return _tracks_are_copies(before.tracks, now.tracks)
    if now.grey is None or before.grey is None:
        return False
    return bool(now.grey.std() > 0 and np.array_equal(before.grey, now.grey))


def _tracks_are_copies(before: Tracks, now: Tracks) -> bool:
    _, a, b = np.intersect1d(before.id, now.id, return_indices=True)
    same = (before.xy[a] == now.xy[b]).all(1)
    return len(a) >= LEAST_COPIES and bool(same.mean() > COPIED)
