"""The growing map in the rerun viewer, or in a file that the viewer plays."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from saccade.errors import ConfigError
from saccade.extras import import_optional
from saccade.types import FloatArray, Image, MapSnapshot, Trajectory
from saccade.viewing.slam import ellipse_outlines
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED, rgb_levels

ROBOT_LENGTH = 0.5
"""Length of the arrow that is the robot, in meters."""
MAX_LIVE_POSES = 2000
"""Maximum number of poses of a trajectory, which is sent again with each snapshot."""


class LiveMap:
    """Sends snapshots of the map to a rerun viewer, for a `SnapshotRecorder`; the ground is z = 0.

    Args:
        name: name of the recording.
        time: (t,) of each pose in seconds.
        dead_reckoning: trajectory by odometry alone; None without odometry.
        image_at: returns the image of a pose, (H, W) or (H, W, 3) uint8, or None.
        file: .rrd file to write; None opens a viewer at once.

    Raises:
        ConfigError: rerun is not installed, or its viewer cannot be started.
    """

    def __init__(
        self,
        name: str,
        time: FloatArray,
        dead_reckoning: Trajectory | None = None,
        image_at: Callable[[int], Image | None] | None = None,
        file: Path | None = None,
    ) -> None:
        self.rerun = import_optional("rerun", "live")
        self.stream = self.rerun.RecordingStream("saccade")
        self.time, self.dead_reckoning, self.image_at = time, dead_reckoning, image_at
        self.path, self.num_shown = np.empty((0, 2)), 0
        try:
            self.stream.spawn() if file is None else self.stream.save(file)
        except (RuntimeError, OSError) as error:
            reason = str(error).splitlines()[0]
            raise ConfigError(f"rerun: the viewer cannot be started: {reason}") from error
        self.stream.send_recording_name(name)
        self.stream.log("map", self.rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def __call__(self, snapshots: Sequence[MapSnapshot]) -> None:
        """Shows the snapshots that are new."""
        for snapshot in snapshots[self.num_shown :]:
            self._show(snapshot)
        self.num_shown = len(snapshots)

    def close(self) -> None:
        """Writes pending data and closes the file."""
        self.stream.flush()
        self.stream.disconnect()

    def _show(self, snapshot: MapSnapshot) -> None:
        step, landmarks, pose = snapshot.step, snapshot.landmarks, snapshot.path[-1]
        self.path = np.concatenate([self.path, snapshot.path[:, :2]])
        self.stream.set_time("pose", sequence=step)
        self.stream.set_time("time", duration=float(self.time[step] - self.time[0]))
        self._log_lines(
            "map/trajectory", [self.path[:: len(self.path) // MAX_LIVE_POSES + 1]], BLUE
        )
        if self.dead_reckoning is not None:
            odometry = self.dead_reckoning.pose[: step + 1, :2]
            self._log_lines("map/odometry", [odometry[:: step // MAX_LIVE_POSES + 1]], GRAY)
        rays = [np.stack([pose[:2], each]) for each in landmarks[snapshot.observed]]
        self._log_lines("map/observed", rays, GREEN)
        for entity, centers, covariances, color in (
            ("map/landmarks/sigma", landmarks, snapshot.landmark_covariance, ORANGE),
            ("map/robot/sigma", pose[None, :2], snapshot.covariance[None, :2, :2], BLUE),
        ):
            outlines = ellipse_outlines(centers, covariances)
            self._log_lines(entity, np.concatenate([outlines, outlines[:, :1]], 1), color)
        self.stream.log("map/landmarks", self.rerun.Points3D(_on_ground(landmarks), colors=[0] * 3))
        self._log_arrows("map/robot", pose[None], RED)
        self._log_arrows("map/hypotheses", snapshot.hypotheses, GREEN)
        image = None if self.image_at is None else self.image_at(step)
        if image is not None:
            self.stream.log("camera", self.rerun.Image(image).compress())
        largest = np.linalg.eigvalsh(snapshot.covariance[:2, :2])[-1]
        self.stream.log("plots/sigma of the position [m]", self.rerun.Scalars(np.sqrt(largest)))
        self.stream.log("plots/landmarks", self.rerun.Scalars(len(landmarks)))

    def _log_arrows(self, entity: str, poses: FloatArray, color: str) -> None:
        """Arrows at poses (n, 3 or more)."""
        vectors = ROBOT_LENGTH * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], 1)
        shape: dict[str, Any] = {
            "origins": _on_ground(poses[:, :2]),
            "vectors": _on_ground(vectors),
        }
        self.stream.log(entity, self.rerun.Arrows3D(**shape, colors=rgb_levels(color)))

    def _log_lines(self, entity: str, lines: Iterable[FloatArray], color: str) -> None:
        strips = [_on_ground(each) for each in lines]
        self.stream.log(entity, self.rerun.LineStrips3D(strips, colors=rgb_levels(color)))


def _on_ground(xy: FloatArray) -> FloatArray:
    """Positions (..., 3) at z = 0."""
    return np.concatenate([xy, np.zeros((*xy.shape[:-1], 1))], -1)
