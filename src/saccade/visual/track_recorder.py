"""Records the points that a run tracks, as a drive of tracks."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.distance import cdist

from saccade.frames import CameraTurn, Drive, Frame, Tracks
from saccade.types import FloatArray, IntArray, Table, column
from saccade.visual.depth import first_frame
from saccade.visual.optical_flow import ByteArray
from saccade.visual.reidentification import REMATCH_RADIUS
from saccade.visual.tables import TrackedPoints

DEPTH_BASELINE = 0.075
"""Metres between the cameras of the stereo rig as which a depth camera is recorded: Kinect's."""


@dataclass(frozen=True, eq=False)
class RecordedPoints(Table):
    """k points, in the order of the frames."""

    frame: IntArray = column(dtype=np.int64)
    """(k,) number of the frame."""
    id: IntArray = column(dtype=np.int64)
    """(k,) ids of the points."""
    xyz: FloatArray = column(3)
    """(k, 3) pixels, and depth in metres."""
    descriptor: ByteArray = column(128, dtype=np.uint8)
    """(k, 128); 0 where the point was not detected."""


class TrackRecorder:
    """Records the points that are tracked in each frame.

    They have descriptors in those frames in which they are also detected. A landmark that is
    re-identified is recorded as a new track.
    """

    def __init__(self) -> None:
        self._points = [RecordedPoints()]
        self._turn: list[FloatArray] = []  # of each frame; NaN where the camera is as mounted
        self._reason: list[str] = []  # of each turn

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
        descriptor = np.zeros((len(points), 128), np.uint8)
        if detected is not None and len(detected) and len(points):
            distance = cdist(points.xy, detected.xy)
            difference = cdist(points.descriptor, detected.descriptor)
            nearest = np.where(distance < REMATCH_RADIUS, difference, np.inf).argmin(1)
            again = distance[np.arange(len(points)), nearest] < REMATCH_RADIUS
            descriptor[again] = detected.descriptor[nearest[again]]
        frame = np.full(len(points), len(self._turn))
        xyz = np.column_stack([points.xy, points.depth])
        self._points.append(RecordedPoints(frame, points.id, xyz, descriptor))
        *angles, reason = turn or CameraTurn(np.nan)
        self._turn.append(np.array(angles))
        self._reason.append(reason)

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
        points = RecordedPoints.concatenate(self._points)
        start = np.searchsorted(points.frame, np.arange(len(self._turn) + 1))

        def load(number: int) -> Frame:
            seen = points[slice(*start[number : number + 2])]
            measured = np.where(camera.baseline > 0, seen.xyz[:, 2], np.nan)
            disparity = camera.fx * camera.baseline / measured
            tracks = Tracks(seen.id, seen.xyz[:, :2], disparity, seen.descriptor)
            pan, tilt, sigma = self._turn[number].tolist()
            turn = CameraTurn(pan, tilt, sigma, self._reason[number]) if np.isfinite(pan) else None
            return Frame(float(recorded.time[number]), tracks=tracks, turn=turn)

        return replace(recorded, camera=camera, load=load)
