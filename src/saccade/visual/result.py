"""Results of visual SLAM, and the log of a run."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from itertools import accumulate
from typing import Literal

import numpy as np

from saccade.errors import LogError
from saccade.frames import Drive
from saccade.pictured import Pictured
from saccade.slam.filter.robot_models import compose
from saccade.types import (
    BoolArray,
    FloatArray,
    IntArray,
    LandmarkMap,
    Table,
    Trajectory,
    column,
)
from saccade.visual.contradictions import OBJECT_MEMORY, StepSource
from saccade.visual.egomotion import MotionEstimate
from saccade.visual.optical_flow import ByteArray
from saccade.visual.points import RangeBearings, TrackedPoints
from saccade.visual.self_calibration import CalibrationDrift, CalibrationReport
from saccade.visual.visual_map import VisualMap

MAX_REMARKS = 5
"""Maximum number of remarks on frames; further frames are counted."""


class ObservationKind(IntEnum):
    """How a landmark was observed."""

    INITIALIZED = 0
    TRACKED = 1
    REIDENTIFIED = 2


@dataclass(frozen=True, eq=False, repr=False)
class LandmarkObservations(Table):
    """k observations of landmarks, in the order of the frames."""

    frame: IntArray = column(dtype=np.int64)
    """(k,) number of the frame."""
    landmark: IntArray = column(dtype=np.int64)
    """(k,) id of the landmark."""
    kind: IntArray = column(dtype=np.int64)
    """(k,) `ObservationKind`: 0 if the landmark was initialized, 1 if it was tracked, 2 if it was
    re-identified."""
    xy: FloatArray = column(2)
    """(k, 2) pixels."""
    z: FloatArray = column(2)
    """(k, 2) range in meters, bearing in radians."""
    sigma: FloatArray = column(2)
    """(k, 2) standard deviations of `z`."""
    innovation: FloatArray = column(2)
    """(k, 2) innovations; NaN where the filter was not updated."""
    innovation_covariance: FloatArray = column(2, 2)
    """(k, 2, 2) covariances of the innovations; NaN where the filter was not updated."""

    def __repr__(self) -> str:
        return f"LandmarkObservations({len(self)} of {len(np.unique(self.landmark))} landmarks)"


@dataclass(frozen=True, eq=False, repr=False)
class VisualResult(Pictured):
    """Trajectory, map and observations of a drive of n frames."""

    trajectory: Trajectory
    """(n,) poses with covariances, smoothed or filtered (see `estimate`)."""
    filtered: Trajectory
    """(n,) poses of the filter with covariances, each estimated from the frames up to then."""
    odometry: Trajectory
    """(n,) poses by odometry alone."""
    visual_odometry: Trajectory
    """(n,) poses with covariances by visual odometry. Steps without egomotion are bridged by the
    sliding window, or by odometry if there is none."""
    map: LandmarkMap
    """m landmarks, smoothed or as in the filter after the last frame."""
    descriptors: ByteArray
    """(m, 128) descriptors of the landmarks."""
    height: FloatArray
    """(m,) heights of the landmarks above the robot's origin, in meters."""
    observations: LandmarkObservations
    """Every observation of a landmark."""
    missed: int
    """Number of times that a lost landmark was expected in view and not re-identified."""
    frame_seconds: FloatArray
    """(n,) computation times of the frames, in seconds."""
    lost: BoolArray
    """(n,) whether the robot was known to be lost after each frame."""
    sources: IntArray
    """(n,) `StepSource` of the step to each frame; 0 for the first."""
    scale_drift: FloatArray
    """(n,) relative standard deviations of the scale, compared with that of the first steps; 0
    where lengths are measured."""
    calibration: CalibrationReport | None
    """Estimated calibration errors; None if no sliding window is adjusted."""
    remarks: tuple[str, ...]
    """Warnings, one sentence each."""
    tags: Mapping[int, str] = field(default_factory=dict)
    """Labels of the landmarks that are tags, by the ids of `observations`."""
    estimate: Literal["smoothed", "filtered"] = "filtered"
    """Kind of the trajectory and the map: "smoothed" over the whole drive, or "filtered"."""

    def __repr__(self) -> str:
        return (
            f"VisualResult({self.estimate}, {self.trajectory!r}, {self.map!r}, "
            f"{self.observations!r})"
        )


@dataclass(eq=False)
class RunLog:
    """Poses, motions and observations of the frames so far."""

    drive: Drive
    remarks: list[str] = field(default_factory=list)
    missed: int = 0
    sources: list[StepSource] = field(default_factory=lambda: [StepSource.CAMERA])
    """Sources of the steps to the frames."""
    scale_drift: list[float] = field(default_factory=lambda: [0.0])
    """Relative standard deviations of the scale in the frames."""
    poses: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray, float, bool]] = field(
        default_factory=list
    )
    """Pose after each frame; covariances by the filter, by constant errors, and by the search of a
    lost robot; computation time in seconds; and whether the robot is lost."""
    _observations: list[LandmarkObservations] = field(
        default_factory=lambda: [LandmarkObservations()]
    )

    def __post_init__(self) -> None:
        none = np.zeros((3, 3))
        # poses by visual odometry, and their covariances without and by the calibration
        self._visual = [(compose(self.drive.start, np.zeros(3))[0], none, none)]

    @property
    def objects_seen(self) -> bool:
        """Whether a part of a recent image contradicted odometry."""
        recent = self.sources[-OBJECT_MEMORY:]
        return StepSource.PART in recent or StepSource.REJECTED in recent

    def add_observations(
        self,
        number: int,
        kind: ObservationKind,
        points: TrackedPoints,
        observations: RangeBearings,
        innovation: tuple[FloatArray, FloatArray] | None = None,
    ) -> None:
        """Logs k observations in a frame, with the innovations and their covariances, if any."""
        k = len(points)
        values, covariances = innovation or (np.full((k, 2), np.nan), np.full((k, 2, 2), np.nan))
        table = LandmarkObservations(
            frame=np.full(k, number),
            landmark=points.landmark,
            kind=np.full(k, kind),
            xy=points.xy.astype(np.float64),
            z=observations.z,
            sigma=np.sqrt(np.diagonal(observations.covariance, axis1=1, axis2=2)),
            innovation=values,
            innovation_covariance=covariances,
        )
        self._observations.append(table)

    def add_motion(self, step: MotionEstimate, drift: CalibrationDrift | None) -> None:
        """Logs the step from the last frame by visual odometry.

        `drift` is the effect of calibration errors on the pose so far, where they are estimated.
        """
        last, C, _ = self._visual[-1]
        pose, Fx, Fu = compose(last, step[0])
        covariance, by_errors = Fx @ C @ Fx.T + Fu @ step[1] @ Fu.T, np.zeros((3, 3))
        if drift is not None:
            by_errors = drift.covariance(float(pose[2]), is_corrected=False)
        self._visual.append((pose, covariance, by_errors))

    def result(self, visual_map: VisualMap) -> VisualResult:
        """The result of the frames so far."""
        n = len(self.poses)
        time, steps = self.drive.time[:n], self.drive.control[: max(n - 1, 0)]
        odometry = accumulate(steps, lambda pose, u: compose(pose, u)[0], initial=self.drive.start)
        pose, covariance, constant, search, seconds, lost = map(
            np.array, zip(*self.poses, strict=True)
        )
        visual, visual_covariance, drift = map(np.array, zip(*self._visual, strict=True))
        landmarks, motion = visual_map.landmarks, visual_map.motion
        xy, covariances = visual_map.ekf.landmarks, visual_map.landmark_covariances
        more = len(self.remarks) - MAX_REMARKS
        others = [f"{more} more frames could not be used"] if more > 0 else []
        if len(landmarks) == 0:
            others.append("the map is empty: no tracked point became a landmark that was kept")
        return VisualResult(
            trajectory=(filtered := Trajectory(time, pose, covariance + constant + search)),
            filtered=filtered,
            odometry=Trajectory(time, np.array([*odometry])),
            visual_odometry=Trajectory(time, visual, visual_covariance + drift),
            map=LandmarkMap(landmarks.id, xy, covariances, landmarks.observations),
            descriptors=landmarks.descriptor,
            height=landmarks.height,
            observations=LandmarkObservations.concatenate(self._observations),
            missed=self.missed,
            frame_seconds=seconds,
            lost=lost,
            sources=np.array(self.sources[:n], np.int64),
            scale_drift=np.array(self.scale_drift[:n]),
            calibration=motion.drift.report() if motion.drift else None,
            remarks=(*self.remarks[:MAX_REMARKS], *others, *motion.planarity.remarks()),
        )

    def smoothed(self, result: VisualResult, visual_map: VisualMap) -> VisualResult:
        """The result with smoothed trajectory and map, or with a remark why it is filtered."""
        try:
            found = visual_map.log.smooth(result.filtered, result.map, result.lost)
        except LogError as error:
            remark = f"not {str(error).replace('smoothing:', 'smoothed:', 1)}"
            return replace(result, remarks=(*result.remarks, remark))
        _, _, constant, search, _, lost = map(np.array, zip(*self.poses, strict=True))
        found_again = lost & (np.arange(len(lost)) < np.flatnonzero(~lost).max(initial=0))
        search[found_again] = 0.0
        C, covariances = found.trajectory.covariance, found.map.covariance
        assert C is not None
        assert covariances is not None
        covariances = covariances + visual_map.scale_covariances(found.map.xy)
        return replace(
            result,
            trajectory=replace(found.trajectory, covariance=C + constant + search),
            map=replace(found.map, covariance=covariances),
            estimate="smoothed",
        )
