"""The film of the README: a robot that decides where to look, in a hall with posters and tags."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
import PIL.Image
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Polygon
from matplotlib.transforms import Affine2D

from saccade import visual
from saccade.frames import Drive
from saccade.simulation import DriveConfig, PanCamera, simulate_drive
from saccade.simulation.floor_plan import wall_outlines
from saccade.tags import TagConfig
from saccade.types import MapSnapshot
from saccade.viewing.film import ROBOT
from saccade.viewing.slam import bounds, ellipse_outlines
from saccade.viewing.snapshots import SnapshotRecorder
from saccade.viewing.style import BLUE, GRAY, ORANGE, RED, rgb_levels
from saccade.visual import VisualConfig, VisualResult
from saccade.visual.gaze_control import GazeControl

DRIVE = DriveConfig(
    size=(9.0, 7.4),
    corridor=2.8,
    poster_spacing=1.3,
    tags=10,
    frames=192,
    frames_per_lap=96,
    frame_rate=5.0,
    image_size=(560, 420),
    field_of_view_deg=60.0,
    color=True,
)
SETTINGS = VisualConfig(recover=False, egomotion="wheels", new_per_frame=4, max_landmarks=200)
"""Settings of the mapping: fewer landmarks than by default, as the map is small on the page."""
SEED = 0
"""Seed of the drive."""
STRIDE = 3
"""Interval in frames of the drive between frames of the film."""
FIRST = 36
"""The first frame of the film, sharp and in the second lap; those before it follow the last."""
CAMERA = (520, 390)
"""Width and height of the camera image in pixels; the map has the same height."""
MAP_WIDTH = 380
"""Width of the map in pixels."""
LEGEND = (
    (0.02, 0.92, "gaze", BLUE),
    (0.31, 0.92, "landmarks", ORANGE),
    (0.02, 0.84, "odometry", GRAY),
)
"""Position, text and color of each word above the map."""
MARGIN = 0.03
"""Margin around the walls, as a fraction of the hall."""
VIEW = 2.4
"""Length of the drawn view in meters."""
RADIUS = 7
"""Radius in pixels of the circle around a landmark in the camera image."""
MILLISECONDS = 200
"""Duration of a frame of the film."""
QUALITY = 35
"""Quality of the WebP."""


def write_film(path: Path) -> None:
    """Simulate the drive, map it, and write the film as an animated WebP.

    It starts in the second lap, where the map is full, and goes on from the start of the drive.
    """
    frames = [PIL.Image.fromarray(frame) for frame in film_frames()]
    first, *others = frames[FIRST:] + frames[:FIRST]
    first.save(
        path,
        save_all=True,
        append_images=others,
        duration=MILLISECONDS,
        loop=0,
        quality=QUALITY,
        method=6,
    )


def film_frames() -> Iterator[npt.NDArray[np.uint8]]:
    """Frames (h, w, 3): the camera image with its landmarks, and the map beside it."""
    drive, result, snapshots = _map_drive()
    for snapshot in snapshots[::STRIDE]:
        camera = _camera_image(drive, result, snapshot.step)
        yield np.concatenate([camera, _map_image(drive, result, snapshots, snapshot.step)], 1)


def _map_drive() -> tuple[Drive, VisualResult, list[MapSnapshot]]:
    """The drive, whose camera the active policy turns, mapped with a snapshot of each frame."""
    pan = PanCamera(seed=SEED)
    drive = simulate_drive(DRIVE, SEED, pan)
    control = GazeControl("active", drive.camera, pan.limits, pan.turn_to, SEED)
    recorder = SnapshotRecorder(DRIVE.frames)
    tags = TagConfig(size=DRIVE.tag_size)
    result = visual.run(drive, SETTINGS, recorder=recorder, gaze=control, tags=tags)
    return drive, result, recorder.snapshots


def _camera_image(drive: Drive, result: VisualResult, step: int) -> npt.NDArray[np.uint8]:
    image = np.ascontiguousarray(drive.load(step).image)
    observed = result.observations
    for x, y in 8 * observed.xy[observed.frame == step]:  # in eighths of a pixel
        for color, width in (((255, 255, 255), 4), (rgb_levels(ORANGE), 2)):
            cv2.circle(image, (round(x), round(y)), 8 * RADIUS, color, width, cv2.LINE_AA, 3)
    return np.asarray(cv2.resize(image, CAMERA, interpolation=cv2.INTER_AREA), np.uint8)


def _map_image(
    drive: Drive, result: VisualResult, snapshots: list[MapSnapshot], step: int
) -> npt.NDArray[np.uint8]:
    """The hall, landmarks with 3-sigma ellipses, both trajectories up to a step, and the view."""
    figure = Figure(figsize=(MAP_WIDTH / 100, CAMERA[1] / 100), dpi=100)
    canvas = cast("Any", FigureCanvasAgg(figure))
    axes = figure.add_axes((0, 0, 1, 0.82))
    axes.set_axis_off()
    axes.set_aspect("equal")
    walls = wall_outlines(DRIVE, np.random.default_rng())
    for corners in walls:
        axes.plot(*corners.T, color="0.75", linewidth=5, solid_joinstyle="miter", zorder=0)
    (left, low), (right, high) = bounds(walls[0], MARGIN)
    axes.set(xlim=(left, right), ylim=(low, high))
    axes.plot(*result.odometry.pose[: step + 1, :2].T, ":", color=GRAY, linewidth=2)
    snapshot = snapshots[step]
    ellipses = ellipse_outlines(snapshot.landmarks, snapshot.landmark_covariance)
    colors = {"facecolor": (ORANGE, 0.3), "edgecolor": (ORANGE, 0.3)}
    axes.add_collection(PolyCollection([*ellipses], **colors), autolim=False)
    path = np.concatenate([each.path for each in snapshots[: step + 1]])
    axes.plot(*path[:, :2].T, color=BLUE, linewidth=3)
    x, y, heading = path[-1].tolist()
    half = np.radians(DRIVE.field_of_view_deg) / 2
    angle = heading + drive.load(step).gaze.pan + np.linspace(-half, half, 9)
    rim = path[-1, :2] + VIEW * np.stack([np.cos(angle), np.sin(angle)], 1)
    axes.add_patch(Polygon([(x, y), *rim], facecolor=(BLUE, 0.3), edgecolor=BLUE, linewidth=1.5))
    arrow = MarkerStyle(ROBOT, transform=Affine2D().rotate(heading))
    axes.plot(x, y, marker=arrow, markersize=26, color=RED, markeredgecolor="white")
    for x, y, word, color in LEGEND:
        figure.text(x, y, word, color=color, fontsize=20, fontweight="bold")
    canvas.draw()
    return np.array(canvas.buffer_rgba())[:, :, :3]
