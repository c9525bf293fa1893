"""Film of a map over time, frame by frame."""

from collections.abc import Iterator, Sequence
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
import PIL.Image
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import ImageDraw, ImageFont

from saccade.types import FloatArray, Image, MapSnapshot, Trajectory
from saccade.viewing.maps import (
    ELLIPSE,
    ELLIPSE_LABEL,
    ELLIPSE_SCALE,
    bounds,
    ellipse_outlines,
    map_axes,
)
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED, rgb_levels

WIDTH, HEIGHT = 1280, 720
"""Pixels of a frame."""
ROBOT = np.array([[14.0, 0.0], [-9.0, 8.0], [-5.0, 0.0], [-9.0, -8.0]])
"""Pixels; an arrowhead that points along x."""
DOT = 2.2 * np.array([[np.cos(a), np.sin(a)] for a in np.arange(12) * np.pi / 6])
"""Pixels; a landmark."""
LINE_OFFSETS = 0.45 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
"""Pixels; a line drawn at each of them is twice as thick, and smooth."""
LAST_FRAMES = 36
"""Frames for which the last one stays."""
SUBPIXEL_BITS = 4
"""Fractional bits of OpenCV's coordinates."""
MAX_GROWTH = 0.2
"""Fraction of its sides by which earlier ellipses may enlarge the map."""
MAX_PIXEL = 1e4
"""Coordinates beyond are clipped."""


def map_frames(
    snapshots: Sequence[MapSnapshot], time: FloatArray, dead_reckoning: Trajectory | None = None
) -> Iterator[npt.NDArray[np.uint8]]:
    """One frame for each snapshot, the last one repeated.

    It shows the trajectory so far, the robot and the landmarks with their ellipses, lines to the
    observed landmarks, and dead reckoning.

    Args:
        snapshots: of one log, in order.
        time: (t,) of each pose of the log.
        dead_reckoning: from odometry alone.

    Yields:
        Frames (720, 1280, 3) in RGB.
    """
    if not snapshots:
        return
    canvas = _MapCanvas(_box(snapshots))
    odometry = np.empty((0, 2)) if dead_reckoning is None else dead_reckoning.pose[:, :2]
    begin = 0
    for snapshot in snapshots:
        end = snapshot.step + 1
        frame = canvas.draw(snapshot, odometry[begin:end], float(time[snapshot.step] - time[0]))
        begin = end
        yield frame
    for _ in range(LAST_FRAMES):
        yield frame


class _MapCanvas:
    """Axes drawn once, with the trajectories so far; each frame is drawn on a copy."""

    def __init__(self, box: FloatArray) -> None:
        figure = Figure(figsize=(WIDTH / 100, HEIGHT / 100), dpi=100)
        axes = figure.add_axes((0.06, 0.08, 0.92, 0.84))
        map_axes(axes, _with_aspect(box, 0.92 * WIDTH / (0.84 * HEIGHT)))
        figure.legend(
            handles=_legend(), loc="upper right", ncols=5, frameon=False, borderaxespad=1.1
        )
        canvas = cast("Any", FigureCanvasAgg(figure))
        canvas.draw()
        self.background = np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:, :, :3])
        extent, (x, y) = axes.get_window_extent(), (axes.get_xlim(), axes.get_ylim())
        left, right, top, bottom = (
            round(each) for each in (extent.x0, extent.x1, HEIGHT - extent.y1, HEIGHT - extent.y0)
        )
        self.panel = (slice(top, bottom), slice(left, right))  # drawings are clipped to it
        self.origin = np.array([x[0], y[1]])
        self.scale = np.array([(right - left) / (x[1] - x[0]), -(bottom - top) / (y[1] - y[0])])
        self.font = ImageFont.truetype(findfont("DejaVu Sans"), 17)
        self.path = self.odometry = np.empty((0, 2))

    def draw(
        self, snapshot: MapSnapshot, odometry: FloatArray, time: float
    ) -> npt.NDArray[np.uint8]:
        """The next frame; its trajectories are added to the background.

        Args:
            snapshot: what to draw.
            odometry: (m, 2) dead reckoning since the last snapshot.
            time: written on the frame.
        """
        pose, landmarks = snapshot.path[-1], snapshot.landmarks
        self.odometry = np.concatenate([self.odometry[-1:], odometry])
        self.path = np.concatenate([self.path[-1:], snapshot.path[:, :2]])
        background = self.background[self.panel]
        _draw_lines(background, [self._pixels(self.odometry)], GRAY)
        for offset in LINE_OFFSETS:
            _draw_lines(background, [self._pixels(self.path) + offset], BLUE)
        frame = self.background.copy()
        panel = frame[self.panel]
        self._draw_ellipses(panel, landmarks, snapshot.landmark_covariance, ORANGE)
        observed = landmarks[snapshot.observed]
        lines = np.stack([np.broadcast_to(pose[:2], observed.shape), observed], 1)  # (s, 2, 2)
        _draw_lines(panel, [*self._pixels(lines)], GREEN)
        _fill(panel, [*(self._pixels(landmarks)[:, None] + DOT)], "black")
        self._draw_ellipses(panel, pose[None, :2], snapshot.covariance[None, :2, :2], BLUE)
        robot = self._pixels(pose[:2]) + ROBOT @ _rotation(-pose[2])
        _fill(panel, [robot], RED)
        _draw_lines(panel, [robot], "white", closed=True)
        image = PIL.Image.fromarray(frame)
        labels = (f"{time:.0f} s", f"pose {snapshot.step}", f"{len(landmarks)} landmarks")
        for column, label in enumerate(labels):
            xy = (0.06 * WIDTH + 120 * column, 0.04 * HEIGHT)
            ImageDraw.Draw(image).text(xy, label, font=self.font, fill="#333333", anchor="lm")
        return np.asarray(image)

    def _draw_ellipses(
        self, panel: Image, centers: FloatArray, covariance: FloatArray, color: str
    ) -> None:
        outlines = [*self._pixels(ellipse_outlines(centers, covariance))]
        filled = panel.copy()
        _fill(filled, outlines, color)
        cv2.addWeighted(filled, 0.2, panel, 0.8, 0, dst=panel)
        _draw_lines(panel, outlines, color, closed=True)

    def _pixels(self, xy: FloatArray) -> FloatArray:
        """Positions (..., 2) in metres as pixels of the panel."""
        return np.asarray(((xy - self.origin) * self.scale).clip(-MAX_PIXEL, MAX_PIXEL))


def _draw_lines(image: Image, lines: list[FloatArray], color: str, closed: bool = False) -> None:
    points = [*map(_fixed_point, lines)]
    cv2.polylines(image, points, closed, rgb_levels(color), 1, cv2.LINE_AA, SUBPIXEL_BITS)


def _fill(image: Image, polygons: list[FloatArray], color: str) -> None:
    for each in polygons:  # one by one: together they would cut holes into each other
        cv2.fillPoly(image, [_fixed_point(each)], rgb_levels(color), cv2.LINE_AA, SUBPIXEL_BITS)


def _fixed_point(pixels: FloatArray) -> npt.NDArray[np.int32]:
    """Pixels (n, 2) as OpenCV's fixed-point numbers."""
    return np.asarray((pixels * 2**SUBPIXEL_BITS).round(), np.int32)


def _rotation(angle: float) -> FloatArray:
    """(2, 2) matrix that rotates rows of (x, y)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [-s, c]])


def _legend() -> list[Artist]:
    return [
        Line2D([], [], color=BLUE, linewidth=2, label="estimate"),
        Line2D([], [], color=GRAY, linewidth=1, label="odometry alone"),
        Patch(**ELLIPSE, label=f"landmarks, {ELLIPSE_LABEL}"),
        Line2D([], [], color=GREEN, linewidth=1, label="observed"),
    ]


def _box(snapshots: Sequence[MapSnapshot]) -> FloatArray:
    """The extent of the film: the trajectory, the final landmarks, and their ellipses.

    Earlier ellipses may be much larger; they enlarge it by `MAX_GROWTH` at most.
    """
    last = snapshots[-1]
    path = np.concatenate([each.path[:, :2] for each in snapshots])
    outlines = ellipse_outlines(last.landmarks, last.landmark_covariance).reshape(-1, 2)
    low, high = bounds(np.concatenate([path, outlines]))
    centers = np.concatenate([each.landmarks for each in snapshots])
    covariance = np.concatenate([each.landmark_covariance for each in snapshots])
    extent = ELLIPSE_SCALE * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2).clip(0))  # (n, 2)
    all_low, all_high = bounds(np.concatenate([path, centers - extent, centers + extent]))
    growth = MAX_GROWTH * (high - low)
    return np.array([all_low.clip(low - growth, low), all_high.clip(high, high + growth)])


def _with_aspect(box: FloatArray, aspect: float) -> FloatArray:
    """The smallest box around another whose width is `aspect` times its height."""
    width, height = (box[1] - box[0]).tolist()
    half = np.array([max(width, aspect * height), max(height, width / aspect)]) / 2
    return np.asarray(box.mean(0) + np.array([-half, half]))
