"""The map while it grows, frame by frame."""

from collections.abc import Iterator, Sequence
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
import PIL.Image
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import ImageDraw, ImageFont

from saccade.types import FloatArray, Image, MapSnapshot, Trajectory
from saccade.viewing.maps import ELLIPSE, SIGMAS, bounds, ellipse_outlines, map_axes
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED

WIDTH, HEIGHT = 1280, 720
"""Pixels of a frame."""
ROBOT = np.array([[14.0, 0.0], [-9.0, 8.0], [-5.0, 0.0], [-9.0, -8.0]])
"""Pixels; an arrowhead that looks along x."""
DOT = 2.2 * np.array([[np.cos(a), np.sin(a)] for a in np.arange(12) * np.pi / 6])
"""Pixels; a landmark."""
THICK = 0.45 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
"""Pixels; a line is drawn at each of them, which makes it twice as thick, and smooth."""
HELD = 36
"""Frames for which the last one stays."""
SHIFT = 4
"""Bits after the point of OpenCV's coordinates."""
GROWN = 0.2
"""Share of its sides by which the film shows more where the ellipses of the way need it."""
FAR = 1e4
"""Pixels; what is farther out is drawn no farther."""


def map_frames(
    snapshots: Sequence[MapSnapshot], time: FloatArray, dead_reckoning: Trajectory | None = None
) -> Iterator[npt.NDArray[np.uint8]]:
    """One frame for each snapshot, the last one held.

    Drawn are the drive so far, the robot with its ellipse, the landmarks with theirs, lines to
    those in sight, and where odometry alone would be.

    Args:
        snapshots: of one drive, in order.
        time: (t,) of each pose of the log.
        dead_reckoning: the same drive from odometry alone.

    Yields:
        Frames (720, 1280, 3) in RGB.
    """
    if not snapshots:
        return
    stage = _Stage(_box(snapshots))
    reckoned = np.empty((0, 2)) if dead_reckoning is None else dead_reckoning.pose[:, :2]
    before = 0
    for snapshot in snapshots:
        after = snapshot.step + 1
        frame = stage.draw(snapshot, reckoned[before:after], float(time[snapshot.step] - time[0]))
        before = after
        yield frame
    for _ in range(HELD):
        yield frame


class _Stage:
    """Axes that are drawn once, and what moves on them."""

    def __init__(self, box: FloatArray) -> None:
        figure = Figure(figsize=(WIDTH / 100, HEIGHT / 100), dpi=100)
        axes = figure.add_axes((0.06, 0.08, 0.92, 0.84))
        map_axes(axes, _shaped(box, 0.92 * WIDTH / (0.84 * HEIGHT)))
        figure.legend(
            handles=_legend(), loc="upper right", ncols=5, frameon=False, borderaxespad=1.1
        )
        canvas = cast("Any", FigureCanvasAgg(figure))
        canvas.draw()
        self.ground = np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:, :, :3])
        pixels, (x, y) = axes.get_window_extent(), (axes.get_xlim(), axes.get_ylim())
        left, right, top, bottom = (
            round(each) for each in (pixels.x0, pixels.x1, HEIGHT - pixels.y1, HEIGHT - pixels.y0)
        )
        self.panel = (slice(top, bottom), slice(left, right))  # nothing is drawn outside of it
        self.corner = np.array([x[0], y[1]])
        self.scale = np.array([(right - left) / (x[1] - x[0]), -(bottom - top) / (y[1] - y[0])])
        self.font = ImageFont.truetype(findfont("DejaVu Sans"), 17)
        self.here = self.astray = np.empty((0, 2))

    def draw(self, snapshot: MapSnapshot, astray: FloatArray, time: float) -> npt.NDArray[np.uint8]:
        """The next frame; drives are added to the ground, for they stay.

        Args:
            snapshot: what to draw.
            astray: (m, 2) odometry alone, since the last snapshot.
            time: to be written on it.
        """
        pose, landmarks = snapshot.path[-1], snapshot.landmarks
        self.astray = np.concatenate([self.astray[-1:], astray])
        self.here = np.concatenate([self.here[-1:], snapshot.path[:, :2]])
        ground = self.ground[self.panel]
        _draw_lines(ground, [self._pixels(self.astray)], GRAY)
        for offset in THICK:
            _draw_lines(ground, [self._pixels(self.here) + offset], BLUE)
        frame = self.ground.copy()
        inside = frame[self.panel]
        self._draw_ellipses(inside, landmarks, snapshot.landmark_covariance, ORANGE)
        seen = landmarks[snapshot.observed]
        lines = np.stack([np.broadcast_to(pose[:2], seen.shape), seen], 1)  # (s, 2, 2)
        _draw_lines(inside, [*self._pixels(lines)], GREEN)
        _fill(inside, [*(self._pixels(landmarks)[:, None] + DOT)], "black")
        self._draw_ellipses(inside, pose[None, :2], snapshot.covariance[None, :2, :2], BLUE)
        robot = self._pixels(pose[:2]) + ROBOT @ _turn(-pose[2])
        _fill(inside, [robot], RED)
        _draw_lines(inside, [robot], "white", closed=True)
        picture = PIL.Image.fromarray(frame)
        words = (f"{time:.0f} s", f"pose {snapshot.step}", f"{len(landmarks)} landmarks")
        for column, word in enumerate(words):
            at = (0.06 * WIDTH + 120 * column, 0.04 * HEIGHT)
            ImageDraw.Draw(picture).text(at, word, font=self.font, fill="#333333", anchor="lm")
        return np.asarray(picture)

    def _draw_ellipses(
        self, frame: Image, centers: FloatArray, covariance: FloatArray, color: str
    ) -> None:
        outlines = [*self._pixels(ellipse_outlines(centers, covariance))]
        filled = frame.copy()
        _fill(filled, outlines, color)
        cv2.addWeighted(filled, 0.2, frame, 0.8, 0, dst=frame)
        _draw_lines(frame, outlines, color, closed=True)

    def _pixels(self, xy: FloatArray) -> FloatArray:
        """Places (..., 2) in metres, in the pixels of the panel."""
        return np.asarray(((xy - self.corner) * self.scale).clip(-FAR, FAR))


def _draw_lines(frame: Image, lines: list[FloatArray], color: str, closed: bool = False) -> None:
    cv2.polylines(frame, [*map(_fixed, lines)], closed, _rgb(color), 1, cv2.LINE_AA, SHIFT)


def _fill(frame: Image, shapes: list[FloatArray], color: str) -> None:
    for shape in shapes:  # one by one: together they would cut holes into each other
        cv2.fillPoly(frame, [_fixed(shape)], _rgb(color), cv2.LINE_AA, SHIFT)


def _fixed(pixels: FloatArray) -> npt.NDArray[np.int32]:
    """Pixels (n, 2) as OpenCV's fixed-point numbers."""
    return np.asarray((pixels * 2**SHIFT).round(), np.int32)


def _turn(angle: float) -> FloatArray:
    """What turns rows of (x, y) by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [-s, c]])


def _legend() -> list[Artist]:
    return [
        Line2D([], [], color=BLUE, linewidth=2, label="estimate"),
        Line2D([], [], color=GRAY, linewidth=1, label="odometry alone"),
        Patch(**ELLIPSE, label=f"landmarks, {SIGMAS:.0f} sigma"),
        Line2D([], [], color=GREEN, linewidth=1, label="in sight"),
    ]


def _rgb(color: str) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in to_rgb(color))
    return red, green, blue


def _box(snapshots: Sequence[MapSnapshot]) -> FloatArray:
    """What the film shows: the whole drive, the landmarks where they end, and their ellipses.

    Those on the way may be much larger; they widen it by so much and no more.
    """
    last = snapshots[-1]
    drive = np.concatenate([each.path[:, :2] for each in snapshots])
    outlines = ellipse_outlines(last.landmarks, last.landmark_covariance).reshape(-1, 2)
    low, high = bounds(np.concatenate([drive, outlines]))
    places = np.concatenate([each.landmarks for each in snapshots])
    spread = np.concatenate([each.landmark_covariance for each in snapshots])
    reach = SIGMAS * np.sqrt(np.diagonal(spread, axis1=1, axis2=2).clip(0))  # (n, 2) half of a box
    every = bounds(np.concatenate([drive, places - reach, places + reach]))
    more = GROWN * (high - low)
    return np.array([every[0].clip(low - more, low), every[1].clip(high, high + more)])


def _shaped(box: FloatArray, shape: float) -> FloatArray:
    """The smallest box around another that is `shape` times as wide as it is high."""
    wide, high = (box[1] - box[0]).tolist()
    half = np.array([max(wide, shape * high), max(high, wide / shape)]) / 2
    return np.asarray(box.mean(0) + np.array([-half, half]))
