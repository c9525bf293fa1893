"""Smoothing of a drive over its joined motions and the observations that updated the filter."""

from dataclasses import dataclass, field

import numpy as np

from saccade.slam.config import EkfConfig
from saccade.slam.smoothing import Smoothed, smooth_log
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory
from saccade.visual.egomotion import MotionEstimate


@dataclass(eq=False)
class MapLog:
    """Motions and observations by which the filter of a drive was predicted and updated."""

    config: EkfConfig
    """Settings of the filter."""
    start: FloatArray
    """(3,) first pose."""
    odometry_bias: tuple[float, float, float]
    """Standard deviations of systematic odometry errors, see `LandmarkLog`."""
    motions: list[MotionEstimate] = field(default_factory=list)
    """Control (3,) and its covariance (3, 3) from each frame to the next."""
    observations: list[tuple[int, IntArray, FloatArray, FloatArray]] = field(default_factory=list)
    """Number of the frame, ids of landmarks (k,), their observations (k, 2), covariances
    (k, 2, 2)."""

    def rescale(self, factor: float) -> None:
        """Multiplies all distances by a factor."""
        S, r = np.diag([factor, factor, 1.0]), np.diag([factor, 1.0])
        self.motions = [(S @ u, S @ U @ S) for u, U in self.motions]
        self.observations = [(i, ids, z @ r, r @ R @ r) for i, ids, z, R in self.observations]

    def smooth(self, filtered: Trajectory, landmarks: LandmarkMap, lost: BoolArray) -> Smoothed:
        """Smooths the poses (n,) of the filter and its landmarks.

        Observations of landmarks that are not in the map are left out. Tracked landmarks have
        already been used by the motions, so that mainly re-identified ones count.

        Raises:
            LogError: as `saccade.slam.smooth`.
        """
        n = len(filtered)
        motions = [(np.zeros(3), np.zeros((3, 3))), *self.motions][1:n]
        control, U = (
            (np.array(each) for each in zip(*motions, strict=True))
            if motions
            else (np.empty((0, 3)), np.empty((0, 3, 3)))
        )
        none = (0, np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 2, 2)))
        frame, ids, z, R = zip(none, *self.observations, strict=True)
        landmark = np.concatenate(ids)
        rows = np.searchsorted(landmarks.id, landmark).clip(max=max(len(landmarks) - 1, 0))
        known = np.isin(landmark, landmarks.id)
        log = LandmarkLog(
            name="drive",
            start=self.start,
            time=filtered.time,
            control=control,
            control_covariance=U,
            observation_pose=np.repeat(frame, [len(each) for each in ids]),
            observation=np.concatenate(z),
            observation_covariance=np.concatenate(R),
            landmark=landmark,
            odometry_bias=self.odometry_bias,
        )
        return smooth_log(
            *(log, filtered.pose, landmarks, np.where(known, rows, -1), lost, self.config)
        )
