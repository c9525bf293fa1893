"""Records the points that visual SLAM tracks, as a drive of tracks without images."""

from dataclasses import replace

import numpy as np
from scipy.spatial.distance import cdist

from saccade.frames import CameraTurn, Drive, Frame, Tracks
from saccade.visual import Pipeline, VisualConfig, VisualResult
from saccade.visual.frontend import FrameFeatures
from saccade.visual.points import TrackedPoints
from saccade.visual.reidentification import REMATCH_RADIUS


def record_tracks(drive: Drive) -> tuple[VisualResult, Drive]:
    """Result of visual SLAM on a drive, and the tracks recorded meanwhile."""
    recorder = TrackRecorder()
    with Pipeline(drive, VisualConfig()) as pipeline:
        for number in range(len(drive)):
            pipeline.step(number)
            recorder.add(pipeline.tracked, pipeline.features)
        return pipeline.result(), recorder.drive(drive)


class TrackRecorder:
    """Records the points that are tracked in each frame.

    They have descriptors in those frames in which they are also detected. A landmark that is
    re-identified is recorded as a new track.
    """

    def __init__(self) -> None:
        self._frames: list[tuple[Tracks, CameraTurn | None]] = []  # depths in place of disparities

    def add(self, points: TrackedPoints, features: FrameFeatures) -> None:
        """Record the points that are tracked in the next frame, and how its camera is turned.

        One that is detected at the position of a tracked point is that point.
        """
        descriptor, detected = np.zeros((len(points), 128), np.uint8), features.detected
        if detected is not None and len(detected) and len(points):
            distance = cdist(points.xy, detected.xy)
            difference = cdist(points.descriptor, detected.descriptor)
            nearest = np.where(distance < REMATCH_RADIUS, difference, np.inf).argmin(1)
            again = distance[np.arange(len(points)), nearest] < REMATCH_RADIUS
            descriptor[again] = detected.descriptor[nearest[again]]
        xy = points.xy.astype(np.float64)
        tracks = Tracks(points.id, xy, points.depth, descriptor)
        self._frames.append((tracks, features.frame.frame.turn))

    def drive(self, recorded: Drive) -> Drive:
        """The recorded drive, of a stereo rig, with tracks in place of its images."""
        camera = recorded.camera

        def load(number: int) -> Frame:
            seen, turn = self._frames[number]
            tracks = replace(seen, disparity=camera.fx * camera.baseline / seen.disparity)
            return Frame(float(recorded.time[number]), tracks=tracks, turn=turn)

        return replace(recorded, load=load)
