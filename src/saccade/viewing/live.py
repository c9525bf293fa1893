"""The map in the rerun viewer, live or from a file."""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from saccade.errors import ConfigError
from saccade.extras import import_optional
from saccade.io.files import atomic_write
from saccade.types import FloatArray, Image, MapSnapshot, Trajectory
from saccade.viewing.slam import bounds, ellipse_outlines
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED, rgb_levels

PLAYBACK_RATE = 24
"""Snapshots per second."""
ARROW_FRACTION = 0.03
"""Length of the robot, as a fraction of the size of the map."""
UNKNOWN_AREA = np.array([[-20.0, -20.0], [20.0, 20.0]])
"""Box (2, 2) in meters that is shown while the size of the map is unknown."""
MAX_POINTS = 2000
"""Poses of a trajectory: it is sent again with each snapshot."""


class LiveMap:
    """A rerun viewer, opened at once, that shows each snapshot of a map.

    The ground is z = 0, since rerun's 2D view has y down.

    Args:
        name: of the log.
        time: (t,) of each pose of the log.
        dead_reckoning: from odometry alone; None without odometry.
        in_browser: open the viewer as a page in the browser, which this process serves.
        image_at: gives the image of a pose, (H, W) or (H, W, 3) uint8, or None; None shows none.
        box: (2, 2) meters that are shown; by default the bounds of dead reckoning.
        file: written in place of a viewer.

    Raises:
        ConfigError: rerun is not installed, or its viewer cannot be started.
    """

    def __init__(
        self,
        name: str,
        time: FloatArray,
        dead_reckoning: Trajectory | None,
        *,
        in_browser: bool = False,
        image_at: Callable[[int], Image | None] | None = None,
        box: FloatArray | None = None,
        file: Path | None = None,
    ) -> None:
        self.rerun, self.stream = _open_recording("saccade_slam", name, in_browser, file)
        self.time, self.dead_reckoning, self.image_at = time, dead_reckoning, image_at
        self.path, self.num_shown = np.empty((0, 2)), 0
        if box is None:
            box = UNKNOWN_AREA if dead_reckoning is None else bounds(dead_reckoning.pose[:, :2])
        self.arrow_length = ARROW_FRACTION * float((box[1] - box[0]).max())
        self._lay_out(box)

    def _lay_out(self, box: FloatArray) -> None:
        """Lay out the views, the map seen from above."""
        layout = self.rerun.blueprint
        (x, y), size = box.mean(0).tolist(), float((box[1] - box[0]).max())
        position = [x, y - 0.01 * size, 1.1 * size]
        eye = layout.EyeControls3D(position=position, look_target=[x, y, 0.0], eye_up=[0, 1, 0])
        view = layout.Spatial3DView(origin="map", background=[255] * 3, eye_controls=eye)
        beside = [layout.Spatial2DView(origin="camera")] if self.image_at is not None else []
        beside += [
            layout.TimeSeriesView(origin=f"plots/{name.split()[0]}", name=name)
            for name in ("sigma of the position [m]", "landmarks")
        ]
        self.stream.send_blueprint(
            layout.Blueprint(
                layout.Horizontal(view, layout.Vertical(*beside), column_shares=[3, 1]),
                layout.TimePanel(timeline="frame", fps=PLAYBACK_RATE, state="collapsed"),
                collapse_panels=True,
            )
        )
        self.stream.log("map", self.rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def __call__(self, snapshots: Sequence[MapSnapshot]) -> None:
        """Show the snapshots that are new."""
        for snapshot in snapshots[self.num_shown :]:
            self._log(snapshot)
            self.num_shown += 1

    def _log(self, snapshot: MapSnapshot) -> None:
        rerun, log = self.rerun, self.stream.log
        step, landmarks, pose = snapshot.step, snapshot.landmarks, snapshot.path[-1]
        self.path = np.concatenate([self.path, snapshot.path[:, :2]])
        self.stream.set_time("frame", sequence=self.num_shown)
        self.stream.set_time("pose", sequence=step)
        self.stream.set_time("time", duration=float(self.time[step] - self.time[0]))
        paths = [("map/trajectory", self.path, BLUE)]
        if self.dead_reckoning is not None:
            paths.insert(0, ("map/odometry", self.dead_reckoning.pose[: step + 1, :2], GRAY))
        for entity, path, color in paths:
            thinned = path[:: len(path) // MAX_POINTS + 1]
            self._log_lines(entity, [np.concatenate([thinned, path[-1:]])], color)
        rays = [np.stack([pose[:2], landmarks[i]]) for i in snapshot.observed]
        self._log_lines("map/observed", rays, GREEN)
        covariance = snapshot.covariance[:2, :2]
        for entity, centers, covariances, color in (
            ("map/landmarks/sigma", landmarks, snapshot.landmark_covariance, ORANGE),
            ("map/robot/sigma", pose[None, :2], covariance[None], BLUE),
        ):
            outlines = ellipse_outlines(centers, covariances)
            self._log_lines(entity, np.concatenate([outlines, outlines[:, :1]], 1), color)
        radius = rerun.Radius.ui_points(3)
        log("map/landmarks", rerun.Points3D(_on_ground(landmarks), colors=[0, 0, 0], radii=radius))
        image = None if self.image_at is None else self.image_at(step)
        if image is not None:
            log("camera", rerun.Image(image).compress())
        self._log_arrows("map/robot", pose[None], colors=rgb_levels(RED))
        probability = snapshot.hypotheses[:, 3]
        opacity = (55 + 200 * np.clip(probability, 0, 1)).astype(np.int64).tolist()
        colors = [[*rgb_levels(GREEN), each] for each in opacity]
        labels = [f"{each:.2f}" for each in probability.tolist()]
        self._log_arrows("map/hypotheses", snapshot.hypotheses, colors=colors, labels=labels)
        largest = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        log("plots/sigma", rerun.Scalars(largest))
        log("plots/landmarks", rerun.Scalars(len(landmarks)))

    def _log_arrows(self, entity: str, poses: FloatArray, **style: Any) -> None:
        """Arrows at poses (n, 3 or more)."""
        heading = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], 1)
        origins, vectors = _on_ground(poses[:, :2]), _on_ground(self.arrow_length * heading)
        self.stream.log(entity, self.rerun.Arrows3D(origins=origins, vectors=vectors, **style))

    def _log_lines(self, entity: str, lines: Iterable[FloatArray], color: str) -> None:
        strips = [_on_ground(each) for each in lines]
        radius = self.rerun.Radius.ui_points(1)
        lines3d = self.rerun.LineStrips3D(strips, colors=rgb_levels(color), radii=radius)
        self.stream.log(entity, lines3d)


class LiveImages:
    """A rerun viewer, opened at once, of a camera's images, saliency and interest points.

    Args:
        name: of the camera.
        in_browser: open the viewer as a page in the browser, which this process serves.

    Raises:
        ConfigError: rerun is not installed, or its viewer cannot be started.
    """

    def __init__(self, name: str, *, in_browser: bool = False) -> None:
        self.rerun, self.stream = _open_recording("saccade", name, in_browser)

    def __call__(
        self, time: float, image: Image, heat: Image | None = None, points: FloatArray | None = None
    ) -> None:
        """Show a frame.

        Args:
            time: in seconds.
            image: (H, W, 3) uint8.
            heat: (H, W, 3) uint8, such as saliency in colors.
            points: (k, 3) x, y and radius of interest points in pixels.
        """
        rerun, stream = self.rerun, self.stream
        stream.set_time("time", duration=time)
        stream.log("camera", rerun.Image(image).compress())
        if heat is not None:
            stream.log("saliency", rerun.Image(heat).compress())
        if points is not None:
            shown = rerun.Points2D(points[:, :2], radii=points[:, 2], colors=rgb_levels(ORANGE))
            stream.log("camera/keypoints", shown)


def save_rrd(
    path: str | Path,
    name: str,
    snapshots: Sequence[MapSnapshot],
    time: FloatArray,
    dead_reckoning: Trajectory,
) -> Path:
    """Write a file that the rerun viewer plays; arguments as of `LiveMap`.

    Raises:
        ConfigError: rerun is not installed.
        OutputError: the file cannot be written.
    """
    box = bounds(np.concatenate([np.empty((0, 2)), *(each.path[:, :2] for each in snapshots)]))
    with atomic_write(path) as temporary:
        written = LiveMap(name, time, dead_reckoning, box=box, file=temporary)
        written(snapshots)
        written.stream.flush()
        written.stream.disconnect()
    return Path(path)


def _open_recording(
    application: str, name: str, in_browser: bool, file: Path | None = None
) -> tuple[Any, Any]:
    """The module rerun, and a recording that a window, a page or a file receives."""
    rerun = import_optional("rerun", "live")
    stream = rerun.RecordingStream(application)
    if file is not None:
        stream.save(file)
    else:
        try:
            if in_browser:
                rerun.serve_web_viewer(connect_to=stream.serve_grpc())
            else:
                with _interpreter_folder_on_path():
                    stream.spawn()
        except (RuntimeError, OSError) as error:
            reason = str(error).splitlines()[0]
            raise ConfigError(f"rerun: its viewer cannot be started: {reason}") from error
    stream.send_recording_name(name)
    return rerun, stream


def _on_ground(xy: FloatArray) -> FloatArray:
    """(..., 3) positions at z = 0."""
    return np.concatenate([xy, np.zeros((*xy.shape[:-1], 1))], -1)


@contextmanager
def _interpreter_folder_on_path() -> Iterator[None]:
    """Lets rerun, which searches PATH, find its viewer in an environment that is not activated."""
    path = os.environ.get("PATH", os.defpath)
    os.environ["PATH"] = os.pathsep.join([path, str(Path(sys.executable).parent)])
    try:
        yield
    finally:
        os.environ["PATH"] = path
