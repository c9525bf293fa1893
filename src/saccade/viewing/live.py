"""The map in the rerun viewer, while it grows or from a file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb

from saccade.extras import extra
from saccade.files import whole_file
from saccade.types import FloatArray, MapSnapshot, Trajectory
from saccade.viewing.maps import ellipse_outlines
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED

MOST_POINTS = 2000
"""Of a drive: it is sent again with each snapshot."""


class LiveMap:
    """A viewer that is opened now and told of each snapshot.

    Args:
        name: of the log.
        time: (t,) of each pose of the log.
        dead_reckoning: the same drive from odometry alone.

    Raises:
        ConfigError: rerun is not installed.
    """

    def __init__(self, name: str, time: FloatArray, dead_reckoning: Trajectory) -> None:
        self._stage = _Stage(name, time, dead_reckoning)
        self._stage.stream.spawn()
        self._stage.begin()
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
    with whole_file(path) as temporary:
        stage.stream.save(temporary)
        stage.begin()
        for snapshot in snapshots:
            stage.show(snapshot)
        stage.stream.flush()
        stage.stream.disconnect()
    return Path(path)


class _Stage:
    """What is drawn: the ground is z = 0, since rerun's flat view turns y down."""

    def __init__(self, name: str, time: FloatArray, dead_reckoning: Trajectory) -> None:
        self.rerun = extra("rerun", "live")
        self.stream = self.rerun.RecordingStream("saccade_slam")
        self.name, self.time, self.dead_reckoning = name, time, dead_reckoning
        self.path = np.empty((0, 2))

    def begin(self) -> None:
        self.stream.send_recording_name(self.name)
        blueprint = self.rerun.blueprint
        self.stream.send_blueprint(
            blueprint.Blueprint(
                blueprint.Horizontal(
                    blueprint.Spatial3DView(origin="map", name="map", background=[255, 255, 255]),
                    blueprint.Vertical(
                        blueprint.TimeSeriesView(origin="plots/sigma", name="sigma of the place"),
                        blueprint.TimeSeriesView(origin="plots/landmarks", name="landmarks"),
                    ),
                    column_shares=[3, 1],
                )
            )
        )
        self.stream.log("map", self.rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def show(self, snapshot: MapSnapshot) -> None:
        step, landmarks, pose = snapshot.step, snapshot.landmarks, snapshot.path[-1]
        self.path = np.concatenate([self.path, snapshot.path[:, :2]])
        self.stream.set_time("pose", sequence=step)
        self.stream.set_time("time", duration=float(self.time[step] - self.time[0]))
        reckoned = self.dead_reckoning.pose[: step + 1, :2]
        self._lines("map/odometry", [_thinned(reckoned)], GRAY)
        self._lines("map/drive", [_thinned(self.path)], BLUE)
        self._lines("map/in_sight", [[pose[:2], landmarks[i]] for i in snapshot.seen], GREEN)
        outlines = ellipse_outlines(landmarks, snapshot.landmark_covariance)
        self._lines("map/landmarks/sigma", _closed(outlines), ORANGE)
        covariance = snapshot.covariance[:2, :2]
        doubt = ellipse_outlines(pose[None, :2], covariance[None])
        self._lines("map/robot/sigma", _closed(doubt), BLUE)
        points = self.rerun.Points3D
        black, dot = [0, 0, 0], self.rerun.Radius.ui_points(3)
        self.stream.log("map/landmarks", points(_flat(landmarks), colors=black, radii=dot))
        ahead = [[np.cos(pose[2]), np.sin(pose[2])]]
        self.stream.log(
            "map/robot",
            self.rerun.Arrows3D(
                origins=_flat(pose[None, :2]), vectors=_flat(np.array(ahead)), colors=_rgb(RED)
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
    step = len(path) // MOST_POINTS + 1
    return np.concatenate([path[::step], path[-1:]])


def _closed(outlines: FloatArray) -> FloatArray:
    return np.concatenate([outlines, outlines[:, :1]], 1)


def _flat(xy: FloatArray) -> FloatArray:
    return np.concatenate([xy, np.zeros((*xy.shape[:-1], 1))], -1)


def _rgb(color: str) -> list[int]:
    return [round(255 * part) for part in to_rgb(color)]
