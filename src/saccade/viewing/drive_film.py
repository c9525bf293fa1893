"""Film of a drive: the camera image with its landmarks beside the map over time."""

from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np
import numpy.typing as npt

from saccade.types import Float32Array, FloatArray, Image, MapSnapshot, Trajectory
from saccade.viewing.attention import heat_colors
from saccade.viewing.map_film import HEIGHT, map_frames
from saccade.viewing.report_map import ObservedLandmarks
from saccade.viewing.style import GREEN, ORANGE, RED, rgb_levels

CAMERA_WIDTH = 640
"""Pixels; the width of the camera image."""
RADIUS = 4
"""Pixels, of the circle around a landmark."""
KINDS = (("new", ORANGE), ("tracked", GREEN), ("re-identified", RED))
"""Label and color of each `ObservedLandmarks.kind`."""
HEAT_OPACITY = 0.55
"""Opacity of the saliency map over the image."""
_GRAY = (51, 51, 51)


def drive_frames(
    snapshots: Sequence[MapSnapshot],
    time: FloatArray,
    odometry: Trajectory,
    image_at: Callable[[int], Image | None],
    attention: Callable[[Image], Float32Array] | None,
    observed: ObservedLandmarks,
) -> Iterator[npt.NDArray[np.uint8]]:
    """One frame for each snapshot, the last one repeated.

    Args:
        snapshots: of the map, in order.
        time: (n,) of each frame of the drive.
        odometry: dead reckoning.
        image_at: gives the image of a frame, or None.
        attention: gives the saliency map of an image; None draws none.
        observed: landmarks with pixels and kinds.

    Yields:
        Frames (720, 1920, 3) in RGB.
    """
    camera = np.zeros((HEIGHT, CAMERA_WIDTH, 3), np.uint8)
    for number, map_frame in enumerate(map_frames(snapshots, time, odometry)):
        if number < len(snapshots):
            step = snapshots[number].step
            camera = _camera_panel(image_at(step), step, attention, observed)
        yield np.concatenate([camera, map_frame], 1)


def _camera_panel(
    image: Image | None,
    step: int,
    attention: Callable[[Image], Float32Array] | None,
    observed: ObservedLandmarks,
) -> npt.NDArray[np.uint8]:
    """The image with its landmarks, and below it with its saliency map."""
    panel = np.full((HEIGHT, CAMERA_WIDTH, 3), 255, np.uint8)
    if image is None:
        return panel
    rgb = image if image.ndim == 3 else np.repeat(image[:, :, None], 3, 2)
    height, width = rgb.shape[:2]
    scale = min(CAMERA_WIDTH / width, (HEIGHT / 2 - 30) / height)
    size = (round(width * scale), round(height * scale))
    resized = cv2.resize(np.ascontiguousarray(rgb[:, :, :3]), size, interpolation=cv2.INTER_AREA)
    small = np.asarray(resized, np.uint8)
    marked = small.copy()
    if observed.xy is not None and observed.kind is not None:
        rows = slice(*np.searchsorted(observed.step, [step, step + 1]))
        for kind, xy in zip(observed.kind[rows].tolist(), observed.xy[rows], strict=True):
            x, y = (round(float(each) * 16) for each in (xy + 0.5) * scale - 0.5)
            color = rgb_levels(KINDS[kind][1])
            cv2.circle(marked, (x, y), RADIUS * 16, color, 2, cv2.LINE_AA, 4)
    left = _insert(panel, marked, 0, "landmarks")
    for column, (label, color_name) in enumerate(KINDS):
        _write(panel, label, left + 130 + 120 * column, 0, rgb_levels(color_name))
    if attention is not None:
        saliency = cv2.resize(attention(image), size, interpolation=cv2.INTER_LINEAR).clip(0, 1)
        heat = heat_colors(np.asarray((saliency * 255).round(), np.uint8))
        blended = cv2.addWeighted(small, 1 - HEAT_OPACITY, heat, HEAT_OPACITY, 0)
        _insert(panel, np.asarray(blended, np.uint8), HEIGHT // 2, "attention")
    return panel


def _insert(
    panel: npt.NDArray[np.uint8], image: npt.NDArray[np.uint8], top: int, title: str
) -> int:
    """Draw an image under its title; returns its left edge."""
    height, width = image.shape[:2]
    left = int(CAMERA_WIDTH - width) // 2
    panel[top + 26 : top + 26 + height, left : left + width] = image
    _write(panel, title, left + 4, top, _GRAY)
    return left


def _write(
    panel: npt.NDArray[np.uint8], text: str, left: int, top: int, color: tuple[int, int, int]
) -> None:
    origin = (left, top + 18)
    cv2.putText(panel, text, origin, cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, 1, cv2.LINE_AA)
