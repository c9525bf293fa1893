"""The map in the rerun viewer, while it grows or from a file."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb

from saccade.errors import ConfigError
from saccade.extras import import_optional
from saccade.files import atomic_write
from saccade.types import FloatArray, MapSnapshot, Trajectory
from saccade.viewing.maps import bounds, ellipse_outlines
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED

FILM_RATE = 24
"""Snapshots a second, when it is played."""
ARROW = 0.03
"""Length of the robot, by the size of the map."""
MAX_POINTS = 2000
"""Of a drive: it is sent again with each snapshot."""


class LiveMap:
    """A viewer that is opened now and told of each snapshot.

    Args:
        name: of the log.
        time: (t,) of each pose of the log.
        dead_reckoning: the same drive from odometry alone.

    Raises:
        ConfigError: rerun is not installed, or its viewer cannot be started.
    """

    def __init__(self, name: str, time: FloatArray, dead_reckoning: Trajectory) -> None:
        self._stage = _Stage(name, time, dead_reckoning)
        beside = str(Path(sys.executable).parent)  # the viewer of an environment not activated
        os.environ["PATH"] = os.pathsep.join([os.environ.get("PATH", ""), beside])
        try:
            self._stage.stream.spawn()
        except (RuntimeError, OSError) as error:
            reason = str(error).splitlines()[0]
            raise ConfigError(f"rerun: its viewer cannot be started: {reason}") from error
        self._stage.begin(bounds(dead_reckoning.pose[:, :2]))
        self._shown = 0

    def __call__(self, snapshots: Sequence[MapSnapshot]) -> None:
        """Show what has not been shown yet."""
        for snapshot in snapshots[self._shown :]:
            self._stage.show(snapshot)
        self._shown = len(snapshots)


def save_rrd(
    path: str | Path,
    name: str,
    snapshots: Sequence[MapSnapshot],
    time: FloatArray,
    dead_reckoning: Trajectory,
) -> Path:
    """Write a file that the rerun viewer plays.

    Args:
        path: the file.
        name: of the log.
        snapshots: of one drive, in order.
        time: (t,) of each pose of the log.
        dead_reckoning: the same drive from odometry alone.

    Raises:
        ConfigError: rerun is not installed.
        OutputError: the file cannot be written.
    """
    stage = _Stage(name, time, dead_reckoning)
    with atomic_write(path) as temporary:
        stage.stream.save(temporary)
        drives = [each.path[:, :2] for each in snapshots]
        stage.begin(bounds(np.concatenate([np.empty((0, 2)), *drives])))
        for snapshot in snapshots:
            stage.show(snapshot)
        stage.stream.flush()
        stage.stream.disconnect()
    return Path(path)


class _Stage:
    """What is drawn: the ground is z = 0, since rerun's flat view turns y down."""

    def __init__(self, name: str, time: FloatArray, dead_reckoning: Trajectory) -> None:
        self.rerun = import_optional("rerun", "live")
        self.stream = self.rerun.RecordingStream("saccade_slam")
        self.name, self.time, self.dead_reckoning = name, time, dead_reckoning
        self.path = np.empty((0, 2))
        self.frame, self.size = -1, 1.0

    def begin(self, box: FloatArray) -> None:
        """Look at a box (2, 2) from above."""
        self.stream.send_recording_name(self.name)
        blueprint = self.rerun.blueprint
        (x, y), self.size = box.mean(0).tolist(), float((box[1] - box[0]).max())
        eye = blueprint.EyeControls3D(
            position=[x, y - 0.01 * self.size, 1.1 * self.size],
            look_target=[x, y, 0.0],
            eye_up=[0.0, 1.0, 0.0],
        )
        self.stream.send_blueprint(
            blueprint.Blueprint(
                blueprint.Horizontal(
                    blueprint.Spatial3DView(
                        origin="map", name="map", background=[255, 255, 255], eye_controls=eye
                    ),
                    blueprint.Vertical(
                        blueprint.TimeSeriesView(
                            origin="plots/sigma", name="sigma of the place [m]"
                        ),
                        blueprint.TimeSeriesView(origin="plots/landmarks", name="landmarks"),
                    ),
                    column_shares=[3, 1],
                ),
                blueprint.TimePanel(timeline="frame", fps=FILM_RATE, state="collapsed"),
                blueprint.BlueprintPanel(state="collapsed"),
                blueprint.SelectionPanel(state="collapsed"),
            )
        )
        self.stream.log("map", self.rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def show(self, snapshot: MapSnapshot) -> None:
        step, landmarks, pose = snapshot.step, snapshot.landmarks, snapshot.path[-1]
        self.frame += 1
        self.path = np.concatenate([self.path, snapshot.path[:, :2]])
        self.stream.set_time("frame", sequence=self.frame)
        self.stream.set_time("pose", sequence=step)
        self.stream.set_time("time", duration=float(self.time[step] - self.time[0]))
        reckoned = self.dead_reckoning.pose[: step + 1, :2]
        self._lines("map/odometry", [_thinned(reckoned)], GRAY)
        self._lines("map/drive", [_thinned(self.path)], BLUE)
        self._lines("map/in_sight", [[pose[:2], landmarks[i]] for i in snapshot.observed], GREEN)
        outlines = ellipse_outlines(landmarks, snapshot.landmark_covariance)
        self._lines("map/landmarks/sigma", _closed(outlines), ORANGE)
        covariance = snapshot.covariance[:2, :2]
        doubt = ellipse_outlines(pose[None, :2], covariance[None])
        self._lines("map/robot/sigma", _closed(doubt), BLUE)
        points = self.rerun.Points3D
        black, dot = [0, 0, 0], self.rerun.Radius.ui_points(3)
        self.stream.log("map/landmarks", points(_flat(landmarks), colors=black, radii=dot))
        ahead = ARROW * self.size * np.array([[np.cos(pose[2]), np.sin(pose[2])]])
        self.stream.log(
            "map/robot",
            self.rerun.Arrows3D(
                origins=_flat(pose[None, :2]), vectors=_flat(ahead), colors=_rgb(RED)
            ),
        )
        sigma = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        self.stream.log("plots/sigma", self.rerun.Scalars(sigma))
        self.stream.log("plots/landmarks", self.rerun.Scalars(len(landmarks)))

    def _lines(self, where: str, lines: Any, color: str) -> None:
        strips = [_flat(np.asarray(line)) for line in lines]
        radius = self.rerun.Radius.ui_points(1)
        self.stream.log(where, self.rerun.LineStrips3D(strips, colors=_rgb(color), radii=radius))


def _thinned(path: FloatArray) -> FloatArray:
    step = len(path) // MAX_POINTS + 1
    return np.concatenate([path[::step], path[-1:]])


def _closed(outlines: FloatArray) -> FloatArray:
    return np.concatenate([outlines, outlines[:, :1]], 1)


def _flat(xy: FloatArray) -> FloatArray:
    return np.concatenate([xy, np.zeros((*xy.shape[:-1], 1))], -1)


def _rgb(color: str) -> list[int]:
    return [round(255 * part) for part in to_rgb(color)]
