"""Films, frame by frame: of a scanpath, of a map over time, and of a drive."""

from collections.abc import Callable, Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple, cast

import cv2
import numpy as np
import numpy.typing as npt
import PIL.Image
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import ImageDraw, ImageFont

from saccade.io.files import atomic_write
from saccade.types import Float32Array, FloatArray, Image, MapSnapshot, Scanpath, Trajectory
from saccade.viewing.attention import draw_scanpath, heat_colors
from saccade.viewing.report_map import ObservedLandmarks
from saccade.viewing.slam import (
    ELLIPSE,
    ELLIPSE_LABEL,
    ELLIPSE_SCALE,
    bounds,
    ellipse_outlines,
    map_axes,
)
from saccade.viewing.style import (
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    RED,
    draw_panel,
    figure_for,
    png_bytes,
    rgb_levels,
)

FOVEA_SIGMA = 0.08
"""Standard deviation of the bright region around a fixation, of the longer side of the image."""
SLOWDOWN, LAST_SECONDS = 4.0, 1.5
"""Slow motion of the film of a scanpath, and duration of its last frame."""
WIDTH, HEIGHT, CAMERA_WIDTH = 1280, 720, 640
"""Pixels of a frame of the map, and of the camera image on its left."""
ROBOT = np.array([[14.0, 0.0], [-9.0, 8.0], [-5.0, 0.0], [-9.0, -8.0]])
"""Pixels; an arrowhead that points along x."""
DOT = 2.2 * np.array([[np.cos(a), np.sin(a)] for a in np.arange(12) * np.pi / 6])
"""Pixels; a landmark on the map."""
LINE_OFFSETS = 0.45 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
"""Pixels; a line drawn at each of them is twice as thick, and smooth."""
LAST_FRAMES = 36
"""Number of times the last frame of a map is repeated."""
SUBPIXEL_BITS = 4
"""Fractional bits of OpenCV's coordinates."""
MAX_GROWTH = 0.2
"""Fraction of its sides by which earlier ellipses may enlarge the map."""
MAX_PIXEL = 1e4
"""Coordinates beyond are clipped."""
RADIUS = 4
"""Pixels, of the circle around a landmark in the camera image."""
KINDS = (("new", ORANGE), ("tracked", GREEN), ("re-identified", RED))
"""Label and color of each `ObservedLandmarks.kind`."""
HEAT_OPACITY = 0.55
"""Opacity of the saliency map over the camera image."""
Frame = npt.NDArray[np.uint8]
VIEW_LENGTH, VIEW_OPACITY = 150.0, 0.25
"""Pixels of the wedge that shows where the camera looks, and its opacity."""


class Eye(NamedTuple):
    """Where a camera looks."""

    pan: float
    """Radians to the left of ahead."""
    field_of_view: float
    """Width of the view in radians."""
    reason: str = ""
    """Why, as it is written on the frame."""


def scanpath_frames(image: Float32Array, path: Scanpath) -> tuple[list[Frame], list[float]]:
    """One frame before the first fixation and one for each, titled with the model's time.

    Args:
        image: (H, W, 3) in [0, 1].
        path: n fixations.

    Returns:
        n + 1 frames, each (h, w, 3), and their (n + 1) durations in seconds.
    """
    starts = np.concatenate([[0.0], path.time])
    durations = [*np.diff(starts).tolist(), LAST_SECONDS]
    height, width = image.shape[:2]
    y, x = np.ogrid[:height, :width]
    sigma, frames = FOVEA_SIGMA * max(height, width), []
    for count, time in enumerate(starts.tolist()):
        shown = image
        if count:
            fixation = path.xy[count - 1]
            d2 = (x - fixation[0]) ** 2 + (y - fixation[1]) ** 2
            weight = np.asarray(0.35 + 0.65 * np.exp(-d2 / (2 * sigma**2)), np.float32)
            shown = image * weight[:, :, None]
        figure = figure_for(width, height, panel=6)
        axes = figure.subplots()
        draw_panel(axes, shown, f"{1000 * time:.0f} ms")
        draw_scanpath(axes, Scanpath(path.xy[:count], path.time[:count], path.saliency[:count]))
        frames.append(np.array(PIL.Image.open(BytesIO(png_bytes(figure))).convert("RGB")))
    return frames, durations


def save_film(frames: Sequence[Frame], durations: Sequence[float], file: str | Path) -> Path:
    """Write frames as an animated GIF that repeats, `SLOWDOWN` times slower than the model.

    Args:
        frames: each (h, w, 3).
        durations: seconds of each; the last is not slowed down.
        file: the GIF.

    Raises:
        OutputError: the file cannot be written.
    """
    milliseconds = [1000 * SLOWDOWN * each for each in durations[:-1]] + [1000 * durations[-1]]
    first, *others = [PIL.Image.fromarray(frame) for frame in frames]
    with atomic_write(file) as temporary:
        first.save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=others,
            duration=[max(20, round(each)) for each in milliseconds],
            loop=0,
        )
    return Path(file)


def map_frames(
    snapshots: Sequence[MapSnapshot],
    time: FloatArray,
    dead_reckoning: Trajectory | None = None,
    eye_at: Callable[[int], Eye | None] | None = None,
) -> Iterator[Frame]:
    """One frame for each snapshot, the last one repeated.

    Each shows the trajectory so far, the robot and the landmarks with their ellipses, lines to the
    observed landmarks, and dead reckoning.

    Args:
        snapshots: of one log, in order.
        time: (t,) of each pose of the log.
        dead_reckoning: from odometry alone.
        eye_at: where the camera looks at each pose; None for a fixed one.

    Yields:
        Frames (720, 1280, 3) in RGB.
    """
    if not snapshots:
        return
    canvas = _MapCanvas(_extent(snapshots), has_odometry=dead_reckoning is not None)
    odometry = np.empty((0, 2)) if dead_reckoning is None else dead_reckoning.pose[:, :2]
    begin = 0
    for snapshot in snapshots:
        end = snapshot.step + 1
        eye = None if eye_at is None else eye_at(snapshot.step)
        seconds = float(time[snapshot.step] - time[0])
        frame = canvas.draw(snapshot, odometry[begin:end], seconds, eye)
        begin = end
        yield frame
    for _ in range(LAST_FRAMES):
        yield frame


def drive_frames(
    snapshots: Sequence[MapSnapshot],
    time: FloatArray,
    odometry: Trajectory | None,
    image_at: Callable[[int], Image | None],
    attention: Callable[[Image], Float32Array] | None,
    observed: ObservedLandmarks,
    eye_at: Callable[[int], Eye | None] | None = None,
) -> Iterator[Frame]:
    """Frames of `map_frames` with the camera image and its saliency on their left.

    Args:
        snapshots: of the map, in order.
        time: (n,) of each frame of the drive.
        odometry: dead reckoning; None without any.
        image_at: gives the image of a frame, or None.
        attention: gives the saliency map of an image; None draws none.
        observed: landmarks with pixels and kinds.
        eye_at: where the camera looks in each frame; None for a fixed one.

    Yields:
        Frames (720, 1920, 3) in RGB.
    """
    camera = np.zeros((HEIGHT, CAMERA_WIDTH, 3), np.uint8)
    for number, map_frame in enumerate(map_frames(snapshots, time, odometry, eye_at)):
        if number < len(snapshots):
            step = snapshots[number].step
            camera = _camera_panel(image_at(step), step, attention, observed)
        yield np.concatenate([camera, map_frame], 1)


class _MapCanvas:
    """Axes drawn once, with the trajectories so far; each frame is drawn on a copy."""

    def __init__(self, box: FloatArray, *, has_odometry: bool) -> None:
        figure = Figure(figsize=(WIDTH / 100, HEIGHT / 100), dpi=100)
        axes = figure.add_axes((0.06, 0.08, 0.92, 0.84))
        width, height = (box[1] - box[0]).tolist()
        aspect = 0.92 * WIDTH / (0.84 * HEIGHT)
        half = np.array([max(width, aspect * height), max(height, width / aspect)]) / 2
        map_axes(axes, box.mean(0) + np.array([-half, half]))
        handles = [
            Line2D([], [], color=BLUE, linewidth=2, label="estimate"),
            *([Line2D([], [], color=GRAY, linewidth=1, label="odometry alone")] * has_odometry),
            Patch(**ELLIPSE, label=f"landmarks, {ELLIPSE_LABEL}"),
            Line2D([], [], color=GREEN, linewidth=1, label="observed"),
        ]
        figure.legend(handles=handles, loc="upper right", ncols=5, frameon=False, borderaxespad=1.1)
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
        self, snapshot: MapSnapshot, odometry: FloatArray, time: float, eye: Eye | None = None
    ) -> Frame:
        """The next frame; its trajectories are added to the background.

        Args:
            snapshot: what to draw.
            odometry: (m, 2) dead reckoning since the last snapshot.
            time: written on the frame.
            eye: where the camera looks.
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
        if eye is not None:
            self._draw_view(panel, pose, eye)
        self._draw_ellipses(panel, landmarks, snapshot.landmark_covariance, ORANGE)
        observed = landmarks[snapshot.observed]
        lines = np.stack([np.broadcast_to(pose[:2], observed.shape), observed], 1)  # (s, 2, 2)
        _draw_lines(panel, [*self._pixels(lines)], GREEN)
        _fill(panel, [*(self._pixels(landmarks)[:, None] + DOT)], "black")
        self._draw_ellipses(panel, pose[None, :2], snapshot.covariance[None, :2, :2], BLUE)
        c, s = np.cos(-pose[2]), np.sin(-pose[2])  # of an image, whose y points down
        robot = self._pixels(pose[:2]) + ROBOT @ np.array([[c, s], [-s, c]])
        _fill(panel, [robot], RED)
        _draw_lines(panel, [robot], "white", closed=True)
        image = PIL.Image.fromarray(frame)
        labels = (f"{time:.0f} s", f"pose {snapshot.step}", f"{len(landmarks)} landmarks")
        for column, label in enumerate(labels):
            xy = (0.06 * WIDTH + 120 * column, 0.04 * HEIGHT)
            ImageDraw.Draw(image).text(xy, label, font=self.font, fill="#333333", anchor="lm")
        if eye is not None and eye.reason:
            xy = (0.06 * WIDTH + 20, 0.88 * HEIGHT)
            label = f"gaze: {eye.reason}"
            ImageDraw.Draw(image).text(xy, label, font=self.font, fill=BLUE, anchor="lm")
        if len(snapshot.hypotheses):
            xy = (0.06 * WIDTH + 20, 0.12 * HEIGHT)
            ImageDraw.Draw(image).text(xy, "lost", font=self.font, fill=RED, anchor="lm")
        return np.asarray(image)

    def _draw_ellipses(
        self, panel: Image, centers: FloatArray, covariance: FloatArray, color: str
    ) -> None:
        outlines = [*self._pixels(ellipse_outlines(centers, covariance))]
        filled = panel.copy()
        _fill(filled, outlines, color)
        cv2.addWeighted(filled, 0.2, panel, 0.8, 0, dst=panel)
        _draw_lines(panel, outlines, color, closed=True)

    def _draw_view(self, panel: Frame, pose: FloatArray, eye: Eye) -> None:
        """A wedge in the direction of the camera."""
        angle = pose[2] + eye.pan + eye.field_of_view * np.linspace(-0.5, 0.5, 9)
        rim = VIEW_LENGTH * np.stack([np.cos(angle), -np.sin(angle)], 1)
        center = self._pixels(pose[:2])
        shaded = panel.copy()
        outline = np.concatenate([center[None], center + rim])
        _fill(shaded, [outline], BLUE)
        cv2.addWeighted(shaded, VIEW_OPACITY, panel, 1 - VIEW_OPACITY, 0, dst=panel)
        _draw_lines(panel, [outline], BLUE, closed=True)

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


def _extent(snapshots: Sequence[MapSnapshot]) -> FloatArray:
    """The box (2, 2) of the trajectory, the final landmarks and their ellipses.

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


def _camera_panel(
    image: Image | None,
    step: int,
    attention: Callable[[Image], Float32Array] | None,
    observed: ObservedLandmarks,
) -> Frame:
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
        radius = RADIUS << SUBPIXEL_BITS
        for kind, xy in zip(observed.kind[rows].tolist(), observed.xy[rows], strict=True):
            x, y = _fixed_point((xy + 0.5) * scale - 0.5).tolist()
            color = rgb_levels(KINDS[kind][1])
            cv2.circle(marked, (x, y), radius, color, 2, cv2.LINE_AA, SUBPIXEL_BITS)
    left = _insert(panel, marked, 0, "landmarks")
    for column, (label, color_name) in enumerate(KINDS):
        _write(panel, label, left + 130 + 120 * column, 0, rgb_levels(color_name))
    if attention is not None:
        saliency = cv2.resize(attention(image), size, interpolation=cv2.INTER_LINEAR).clip(0, 1)
        heat = heat_colors(np.asarray((saliency * 255).round(), np.uint8))
        blended = cv2.addWeighted(small, 1 - HEAT_OPACITY, heat, HEAT_OPACITY, 0)
        _insert(panel, np.asarray(blended, np.uint8), HEIGHT // 2, "attention")
    return panel


def _insert(panel: Frame, image: Frame, top: int, title: str) -> int:
    """Draw an image under its title, centered; returns its left edge."""
    height, width = image.shape[:2]
    left = int(CAMERA_WIDTH - width) // 2
    panel[top + 26 : top + 26 + height, left : left + width] = image
    _write(panel, title, left + 4, top, (51, 51, 51))
    return left


def _write(panel: Frame, text: str, left: int, top: int, color: tuple[int, int, int]) -> None:
    origin = (left, top + 18)
    cv2.putText(panel, text, origin, cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, 1, cv2.LINE_AA)
