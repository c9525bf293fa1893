"""Records the points that a run tracks, as a drive of tracks."""

from dataclasses import replace

import numpy as np
from scipy.spatial.distance import cdist

from saccade.frames import CameraTurn, Drive, Frame, Tracks
from saccade.io.checkpoint import Arrays
from saccade.types import FloatArray, IntArray
from saccade.visual.depth import first_frame
from saccade.visual.optical_flow import ByteArray
from saccade.visual.reidentification import REMATCH_RADIUS
from saccade.visual.tables import TrackedPoints

DEPTH_BASELINE = 0.075
"""Metres between the cameras of the stereo rig as which a depth camera is recorded: Kinect's."""


class TrackRecorder:
    """Records the points that are tracked in each frame.

    They have descriptors in those frames in which they are also detected. A landmark that is
    re-identified is recorded as a new track.
    """

    def __init__(self) -> None:
        self._id: list[IntArray] = []
        self._xyz: list[FloatArray] = []
        self._turn: list[CameraTurn | None] = []
        self._row: list[IntArray] = []  # of its descriptor
        self._descriptors: list[ByteArray] = [np.zeros((1, 128), np.uint8)]
        self._rows = 1

    def add(
        self,
        points: TrackedPoints,
        detected: TrackedPoints | None,
        turn: CameraTurn | None = None,
    ) -> None:
        """Record the points of the next frame.

        Args:
            points: that are tracked.
            detected: in the same frame, if any; one at the place of a tracked point is that point.
            turn: of the camera, if it is not as mounted.
        """
        row = np.zeros(len(points), np.int64)
        if detected is not None and len(detected) and len(points):
            distance = cdist(points.xy, detected.xy)
            difference = cdist(points.descriptor, detected.descriptor)
            nearest = np.where(distance < REMATCH_RADIUS, difference, np.inf).argmin(1)
            again = distance[np.arange(len(points)), nearest] < REMATCH_RADIUS
            row[again] = self._rows + np.arange(again.sum())
            self._rows += int(again.sum())
            self._descriptors.append(detected.descriptor[nearest[again]])
        self._turn.append(turn)
        self._id.append(points.id)
        self._xyz.append(np.column_stack([points.xy, points.depth]))
        self._row.append(row)

    def drive(self, recorded: Drive) -> Drive:
        """The recorded drive with tracks in place of its images.

        Depths that were measured become disparities; those of a depth camera, disparities of a
        stereo rig with `DEPTH_BASELINE`. Depths that were triangulated are not part of the tracks.

        Args:
            recorded: the drive of the run.
        """
        camera = recorded.camera
        has_depth = any(frame.depth is not None for frame in first_frame(recorded).values())
        if camera.baseline == 0 and has_depth:
            camera = replace(camera, baseline=DEPTH_BASELINE)

        descriptors = np.concatenate(self._descriptors)

        def load(number: int) -> Frame:
            xyz = self._xyz[number]
            measured = np.where(camera.baseline > 0, xyz[:, 2], np.nan)
            disparity = camera.fx * camera.baseline / measured
            descriptor = descriptors[self._row[number]]
            tracks = Tracks(self._id[number], xyz[:, :2], disparity, descriptor)
            turn = self._turn[number]
            return Frame(float(recorded.time[number]), tracks=tracks, turn=turn)

        return replace(recorded, camera=camera, load=load)

    def to_arrays(self) -> Arrays:
        """The state as named arrays, for a checkpoint."""
        return {
            "count": np.array([len(id) for id in self._id]),
            "turn": np.array([turn[:3] if turn else (np.nan,) * 3 for turn in self._turn]),
            "id": np.concatenate(self._id),
            "xyz": np.concatenate(self._xyz),
            "row": np.concatenate(self._row),
            "descriptors": np.concatenate(self._descriptors),
        }

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore the state from the arrays of `to_arrays`."""
        parts = np.cumsum(arrays["count"])[:-1]
        self._id, self._xyz, self._row = (
            np.split(arrays[name], parts) for name in ("id", "xyz", "row")
        )
        known = [turn if np.isfinite(turn).all() else None for turn in arrays["turn"]]
        self._turn = [None if turn is None else CameraTurn(*turn.tolist()) for turn in known]
        self._descriptors, self._rows = [arrays["descriptors"]], len(arrays["descriptors"])
