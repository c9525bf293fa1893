"""Films of a map over time and of a drive, frame by frame."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, cast

import cv2
import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Polygon
from matplotlib.transforms import Affine2D

from saccade.types import Float32Array, FloatArray, Image, IntArray, MapSnapshot, Trajectory
from saccade.viewing.attention import heat_colors
from saccade.viewing.report_map import ObservedLandmarks
from saccade.viewing.slam import (
    ELLIPSE,
    ELLIPSE_LABEL,
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
    rgb_levels,
)

MAP_WIDTH = 1280
"""Width of a frame of the map in pixels."""
MAP_HEIGHT = 720
"""Height of a frame in pixels."""
CAMERA_WIDTH = 640
"""Width of the camera image beside the map, in pixels."""
ROBOT = [(14, 0), (-9, 8), (-5, 0), (-9, -8), (14, 0)]
"""Outline of an arrowhead that points along x."""
LAST_FRAMES = 36
"""Number of times the last frame of a map is repeated."""
CIRCLE_RADIUS = 4
"""Radius of the circle around a landmark in the camera image, in pixels."""
KINDS = (("new", ORANGE), ("tracked", GREEN), ("re-identified", RED))
"""Label and color of each `ObservedLandmarks.kind`."""
REIDENTIFIED = 2
"""The kind of a landmark that was lost and found again."""
LIT_COLOR = rgb_levels(RED)
"""RGB of a lit landmark in the camera image."""
HEAT_OPACITY = 0.55
"""Opacity of the saliency map over the camera image."""
LIT_FRAMES = 10
"""Number of frames for which a re-identified landmark is lit."""
LIT_RADIUS = 7
"""Radius of a lit landmark in the camera image, in pixels."""
VIEW_LENGTH = 150.0
"""Length of the wedge that shows the viewing direction, in pixels."""
Frame = npt.NDArray[np.uint8]
"""(h, w, 3) RGB."""


class Eye(NamedTuple):
    """Viewing direction of a camera."""

    pan: float
    """Radians to the left of ahead."""
    field_of_view: float
    """Width of the view in radians."""
    reason: str = ""
    """Reason, shown on the frame."""


def map_frames(
    snapshots: Sequence[MapSnapshot],
    time: FloatArray,
    dead_reckoning: Trajectory | None = None,
    eye_at: Callable[[int], Eye | None] | None = None,
    observed: ObservedLandmarks | None = None,
) -> Iterator[Frame]:
    """Frames of the map, one per snapshot, with the last frame repeated.

    Each shows the trajectory so far, the robot and the landmarks with their ellipses, lines to the
    observed landmarks, and dead reckoning. All of the trajectory and of the last ellipses fits in.

    Args:
        snapshots: of one log, in order.
        time: (t,) of each pose of the log.
        dead_reckoning: from odometry alone.
        eye_at: where the camera looks at each pose; None for a fixed one.
        observed: landmarks with kinds; those re-identified in the last frames are lit.

    Yields:
        Frames (720, 1280, 3) in RGB.
    """
    if not snapshots:
        return
    last = snapshots[-1]
    outlines = ellipse_outlines(last.landmarks, last.landmark_covariance).reshape(-1, 2)
    box = bounds(np.concatenate([*(each.path[:, :2] for each in snapshots), outlines]))
    canvas = _MapCanvas(box, has_odometry=dead_reckoning is not None)
    odometry = np.empty((0, 2)) if dead_reckoning is None else dead_reckoning.pose[:, :2]
    begin = 0
    for snapshot in snapshots:
        end = snapshot.step + 1
        eye = None if eye_at is None else eye_at(snapshot.step)
        seconds = float(time[snapshot.step] - time[0])
        lit = np.isin(snapshot.ids, lit_landmarks(observed, snapshot.step))
        frame = canvas.draw(snapshot, odometry[begin:end], seconds, eye, snapshot.landmarks[lit])
        begin = end
        yield frame
    for _ in range(LAST_FRAMES):
        yield frame


def lit_landmarks(observed: ObservedLandmarks | None, step: int) -> IntArray:
    """Ids of the landmarks that were re-identified in the last `LIT_FRAMES` frames."""
    if observed is None or observed.kind is None:
        return np.zeros(0, np.int64)
    rows = slice(*np.searchsorted(observed.step, [step - LIT_FRAMES + 1, step + 1]))
    return np.asarray(observed.id[rows][observed.kind[rows] == REIDENTIFIED])


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
    camera = np.zeros((MAP_HEIGHT, CAMERA_WIDTH, 3), np.uint8)
    for number, map_frame in enumerate(map_frames(snapshots, time, odometry, eye_at, observed)):
        if number < len(snapshots):
            step = snapshots[number].step
            camera = _camera_panel(image_at(step), step, attention, observed)
        yield np.concatenate([camera, map_frame], 1)


class _MapCanvas:
    """A figure whose background is drawn once; each frame redraws the rest."""

    def __init__(self, box: FloatArray, *, has_odometry: bool) -> None:
        figure = Figure(figsize=(MAP_WIDTH / 100, MAP_HEIGHT / 100), dpi=100)
        self.canvas = cast("Any", FigureCanvasAgg(figure))
        axes = self.axes = figure.add_axes((0.06, 0.08, 0.92, 0.84))
        width, height = (box[1] - box[0]).tolist()
        aspect = 0.92 * MAP_WIDTH / (0.84 * MAP_HEIGHT)
        half = np.array([max(width, aspect * height), max(height, width / aspect)]) / 2
        map_axes(axes, box.mean(0) + np.array([-half, half]))
        self.view_length = VIEW_LENGTH * 2 * half[0] / (0.92 * MAP_WIDTH)
        (self.odometry,) = axes.plot([], [], color=GRAY, linewidth=1, label="odometry alone")
        (self.path,) = axes.plot([], [], color=BLUE, linewidth=2, label="estimate")
        self.view = Polygon(np.zeros((1, 2)), fc=(BLUE, 0.25), ec=BLUE)
        axes.add_patch(self.view)
        self.ellipses = PolyCollection([], **ELLIPSE, label=f"landmarks, {ELLIPSE_LABEL}")
        self.lines = LineCollection([], colors=GREEN, linewidths=1, label="observed")
        (self.landmarks,) = axes.plot([], [], ".", color="black", markersize=5)
        (self.lit,) = axes.plot([], [], "o", color=RED, mec="white", markersize=11)
        self.pose = PolyCollection([], facecolor=(BLUE, 0.2), edgecolor=BLUE)
        (self.robot,) = axes.plot([], [], color=RED, mec="white", markersize=20)
        for collection in (self.ellipses, self.lines, self.pose):
            axes.add_collection(collection, autolim=False)
        self.title = figure.text(0.06, 0.95, "", fontsize=12, color="0.2")
        self.reason, self.lost = (
            axes.text(0.015, y, "", color=color, fontsize=12, transform=axes.transAxes)
            for y, color in ((0.03, BLUE), (0.95, RED))
        )
        handles = [self.path, *[self.odometry] * has_odometry, self.ellipses, self.lines]
        figure.legend(handles=handles, loc="upper right", ncols=5, frameon=False, borderaxespad=1.1)
        self.moving = [
            *(self.odometry, self.path, self.view, self.ellipses, self.lines, self.landmarks),
            self.lit,
            *(self.pose, self.robot, self.title, self.reason, self.lost),
        ]
        for artist in self.moving:
            artist.set_animated(True)
        self.canvas.draw()
        self.background = self.canvas.copy_from_bbox(figure.bbox)

    def draw(
        self,
        snapshot: MapSnapshot,
        odometry: FloatArray,
        time: float,
        eye: Eye | None,
        lit: FloatArray,
    ) -> Frame:
        """The next frame; it extends the trajectories of earlier frames.

        Args:
            snapshot: what to draw.
            odometry: (m, 2) dead reckoning since the last snapshot.
            time: written on the frame.
            eye: where the camera looks.
            lit: (l, 2) positions of the lit landmarks.
        """
        pose, landmarks = snapshot.path[-1], snapshot.landmarks
        for line, xy in ((self.odometry, odometry), (self.path, snapshot.path[:, :2])):
            line.set_data(*np.concatenate([line.get_xydata(), xy]).T)
        self.ellipses.set_verts([*ellipse_outlines(landmarks, snapshot.landmark_covariance)])
        self.pose.set_verts([*ellipse_outlines(pose[None, :2], snapshot.covariance[None, :2, :2])])
        self.lines.set_segments([np.stack([pose[:2], landmarks[i]]) for i in snapshot.observed])
        self.landmarks.set_data(*landmarks.T)
        self.lit.set_data(*lit.T)
        self.robot.set_data(*pose[:2, None])
        self.robot.set_marker(MarkerStyle(ROBOT, transform=Affine2D().rotate(pose[2])))
        if eye is not None:
            angle = pose[2] + eye.pan + eye.field_of_view * np.linspace(-0.5, 0.5, 9)
            rim = pose[:2] + self.view_length * np.stack([np.cos(angle), np.sin(angle)], 1)
            self.view.set_xy(np.concatenate([pose[None, :2], rim]))
        self.view.set_visible(eye is not None)
        self.title.set_text(
            f"{time:.0f} s      pose {snapshot.step}      {len(landmarks)} landmarks"
        )
        self.reason.set_text(f"gaze: {eye.reason}" if eye is not None and eye.reason else "")
        self.lost.set_text("lost" if len(snapshot.hypotheses) else "")
        self.canvas.restore_region(self.background)
        for artist in self.moving:
            self.axes.draw_artist(artist)
        return np.array(self.canvas.buffer_rgba())[:, :, :3]


def _camera_panel(
    image: Image | None,
    step: int,
    attention: Callable[[Image], Float32Array] | None,
    observed: ObservedLandmarks,
) -> Frame:
    """The image with its landmarks, and below it with its saliency map."""
    panel = np.full((MAP_HEIGHT, CAMERA_WIDTH, 3), 255, np.uint8)
    if image is None:
        return panel
    rgb = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image[:, :, :3]
    height, width = rgb.shape[:2]
    scale = min(CAMERA_WIDTH / width, (MAP_HEIGHT / 2 - 30) / height)
    size = (round(width * scale), round(height * scale))
    small = cv2.resize(np.ascontiguousarray(rgb), size, interpolation=cv2.INTER_AREA)
    marked = small.copy()
    if observed.xy is not None and observed.kind is not None:
        rows = slice(*np.searchsorted(observed.step, [step, step + 1]))
        kinds, lit = observed.kind[rows], np.isin(observed.id[rows], lit_landmarks(observed, step))
        for kind, is_lit, xy in zip(kinds.tolist(), lit, observed.xy[rows], strict=True):
            center = ((xy + 0.5) * scale - 0.5).round().astype(int).tolist()
            if is_lit:
                cv2.circle(marked, center, LIT_RADIUS, (255, 255, 255), -1, cv2.LINE_AA)
                cv2.circle(marked, center, LIT_RADIUS - 2, LIT_COLOR, -1, cv2.LINE_AA)
            else:
                cv2.circle(
                    marked, center, CIRCLE_RADIUS, rgb_levels(KINDS[kind][1]), 2, cv2.LINE_AA
                )
    left = (CAMERA_WIDTH - size[0]) // 2
    shown = [("landmarks", marked)]
    if attention is not None:
        saliency = cv2.resize(attention(image), size, interpolation=cv2.INTER_LINEAR).clip(0, 1)
        heat = heat_colors(np.asarray((saliency * 255).round(), np.uint8))
        shown += [("attention", cv2.addWeighted(small, 1 - HEAT_OPACITY, heat, HEAT_OPACITY, 0))]
    for top, (title, picture) in zip((0, MAP_HEIGHT // 2), shown, strict=False):
        panel[top + 26 : top + 26 + size[1], left : left + size[0]] = picture
        _write(panel, title, left + 4, top, "0.2")
    for column, (label, color) in enumerate(KINDS):
        _write(panel, label, left + 130 + 120 * column, 0, color)
    return panel


def _write(panel: Frame, text: str, left: int, top: int, color: str) -> None:
    origin, levels = (left, top + 18), rgb_levels(color)
    cv2.putText(panel, text, origin, cv2.FONT_HERSHEY_SIMPLEX, 0.5, levels, 1, cv2.LINE_AA)
