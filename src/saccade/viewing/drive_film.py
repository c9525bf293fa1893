"""What the camera sees at the left, the map that grows of it at the right."""

from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np
import numpy.typing as npt

from saccade.types import Float32Array, FloatArray, Image, IntArray, MapSnapshot, Trajectory
from saccade.viewing.map_film import HEIGHT, map_frames

LEFT = 640
"""Pixels; the width of what the camera sees."""
RADIUS = 4
LANDMARK, REIDENTIFIED, NEW = (0, 158, 115), (213, 94, 0), (230, 159, 0)
"""RGB of landmarks that are followed, met again and taken in."""
COLORS = (NEW, LANDMARK, REIDENTIFIED)
WORDS = ("new", "followed", "recognized")
SHADE = 0.55
"""Weight of the attention map over the photograph."""


def drive_frames(
    snapshots: Sequence[MapSnapshot],
    time: FloatArray,
    odometry: Trajectory,
    image: Callable[[int], Image | None],
    attention: Callable[[Image], Float32Array] | None,
    sighting: tuple[IntArray, IntArray, FloatArray],
) -> Iterator[npt.NDArray[np.uint8]]:
    """One frame for each snapshot, the last one held.

    Args:
        snapshots: of the map, in order.
        time: (n,) of each frame of the drive.
        odometry: the same drive from odometry alone.
        image: gives the picture of a frame, or None.
        attention: gives the saliency of a picture; None draws none.
        sighting: frame (k,), ascending, kind (k,) and pixel (k, 2) of every landmark seen.

    Yields:
        Frames (720, 1920, 3) in RGB.
    """
    left = np.zeros((HEIGHT, LEFT, 3), np.uint8)
    frames = map_frames(snapshots, time, odometry)
    for number, ground in enumerate(frames):
        if number < len(snapshots):
            left = _seen(snapshots[number].step, image, attention, sighting)
        yield np.concatenate([left, ground], 1)


def _seen(
    step: int,
    image: Callable[[int], Image | None],
    attention: Callable[[Image], Float32Array] | None,
    sighting: tuple[IntArray, IntArray, FloatArray],
) -> npt.NDArray[np.uint8]:
    """The picture with its landmarks, and below it where attention is drawn."""
    panel = np.full((HEIGHT, LEFT, 3), 255, np.uint8)
    picture = image(step)
    if picture is None:
        return panel
    gray = picture if picture.ndim == 3 else np.repeat(picture[:, :, None], 3, 2)
    height, width = gray.shape[:2]
    scale = min(LEFT / width, (HEIGHT / 2 - 30) / height)
    size = (round(width * scale), round(height * scale))
    small = cv2.resize(np.ascontiguousarray(gray[:, :, :3]), size, interpolation=cv2.INTER_AREA)
    shown = np.asarray(small, np.uint8)
    marked = shown.copy()
    frame, kind, xy = sighting
    rows = slice(*np.searchsorted(frame, [step, step + 1]))
    for which, place in zip(kind[rows].tolist(), xy[rows], strict=True):
        x, y = (round(float(each) * 16) for each in (place + 0.5) * scale - 0.5)
        cv2.circle(marked, (x, y), RADIUS * 16, COLORS[which], 2, cv2.LINE_AA, 4)
    _put(panel, marked, 0, "landmarks", True)
    if attention is not None:
        _put(panel, _heated(shown, attention(picture)), HEIGHT // 2, "attention", False)
    return panel


def _put(
    panel: npt.NDArray[np.uint8],
    picture: npt.NDArray[np.uint8],
    top: int,
    title: str,
    legend: bool,
) -> None:
    """A picture under its title."""
    height, width = picture.shape[:2]
    left = (LEFT - width) // 2
    panel[top + 26 : top + 26 + height, left : left + width] = picture
    _write(panel, title, (left + 4, top + 18), (51, 51, 51))
    for column, (word, color) in enumerate(zip(WORDS, COLORS, strict=True)):
        if legend:
            _write(panel, word, (left + 130 + 120 * column, top + 18), color)


def _write(
    panel: npt.NDArray[np.uint8], word: str, at: tuple[int, int], color: tuple[int, int, int]
) -> None:
    cv2.putText(panel, word, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, 1, cv2.LINE_AA)


def _heated(picture: npt.NDArray[np.uint8], saliency: Float32Array) -> npt.NDArray[np.uint8]:
    size = (picture.shape[1], picture.shape[0])
    strong = cv2.resize(saliency, size, interpolation=cv2.INTER_LINEAR).clip(0, 1)
    levels = np.asarray((strong * 255).round(), np.uint8)
    heat = cv2.applyColorMap(levels, cv2.COLORMAP_CIVIDIS)[:, :, ::-1]
    return np.asarray(cv2.addWeighted(picture, 1 - SHADE, heat, SHADE, 0), np.uint8)
