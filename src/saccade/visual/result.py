"""Results of visual SLAM, and the log of a run from which they are made."""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from saccade.frames import Drive
from saccade.slam.models import compose
from saccade.types import (
    BoolArray,
    FloatArray,
    IntArray,
    LandmarkMap,
    Table,
    Trajectory,
    column,
)
from saccade.visual.egomotion import Egomotion, MotionEstimate
from saccade.visual.motion_estimator import MotionEstimator
from saccade.visual.optical_flow import ByteArray
from saccade.visual.self_calibration import CalibrationDrift, CalibrationReport
from saccade.visual.tables import RangeBearings, TrackedPoints
from saccade.visual.visual_map import VisualMap

MAX_REMARKS = 5
"""Remarks on frames that are given in full; the others are counted."""
MAX_TABLES = 512
"""Tables of observations before they are concatenated."""


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
    """(k,) `ObservationKind`: 0 where the landmark was initialized, 1 where it was tracked, 2 where
    it was re-identified after it had been lost."""
    xy: FloatArray = column(2)
    """(k, 2) pixels."""
    z: FloatArray = column(2)
    """(k, 2) range in metres, bearing in radians."""
    sigma: FloatArray = column(2)
    """(k, 2) standard deviations of `z`."""
    innovation: FloatArray = column(2)
    """(k, 2) `z` less its prediction; NaN where the filter was not corrected."""
    innovation_covariance: FloatArray = column(2, 2)
    """(k, 2, 2) predicted covariance of the innovation; NaN likewise."""

    def __repr__(self) -> str:
        return f"LandmarkObservations({len(self)} of {len(np.unique(self.landmark))} landmarks)"


@dataclass(frozen=True, eq=False, repr=False)
class VisualResult:
    """Trajectory, map and observations of a drive of n frames."""

    trajectory: Trajectory
    """(n,) poses with covariances, each estimated from the frames up to it."""
    odometry: Trajectory
    """(n,) poses by odometry alone."""
    visual_odometry: Trajectory
    """(n,) poses with covariances by visual odometry; by odometry in steps where it failed."""
    map: LandmarkMap
    """m landmarks at the end."""
    descriptors: ByteArray
    """(m, 128) descriptors of the landmarks."""
    height: FloatArray
    """(m,) heights of the landmarks above the robot's origin, in metres."""
    observations: LandmarkObservations
    """Every observation of a landmark."""
    off_plane: FloatArray
    """(n, 3) change of height in metres, roll and pitch in radians since the last frame, by visual
    odometry; NaN where it failed."""
    missed: int
    """Times that a lost landmark was expected in view and not re-identified."""
    frame_seconds: FloatArray
    """(n,) computation time of each frame."""
    lost: BoolArray
    """(n,) whether the robot knew that it was lost, after each frame."""
    calibration: CalibrationReport | None
    """What was learnt of the calibration; None where no window of frames is adjusted."""
    remarks: tuple[str, ...]
    """Warnings, one sentence each."""

    def __repr__(self) -> str:
        return f"VisualResult({self.trajectory!r}, {self.map!r}, {self.observations!r})"


@dataclass(eq=False)
class RunLog:
    """Poses, motions and observations of the frames so far."""

    drive: Drive
    remarks: list[str] = field(default_factory=list)
    missed: int = 0
    last_visible: int | None = None
    """Number of the last frame that was not blank."""
    _frame_seconds: list[float] = field(default_factory=list)
    _pose: list[FloatArray] = field(default_factory=list)
    _covariance: list[FloatArray] = field(default_factory=list)
    _lost: list[bool] = field(default_factory=list)
    _observations: list[LandmarkObservations] = field(
        default_factory=lambda: [LandmarkObservations()]
    )

    def __post_init__(self) -> None:
        self._visual_pose = [compose(self.drive.start, np.zeros(3))[0]]
        self._visual_covariance = [np.zeros((3, 3))]
        self._visual_drift = [np.zeros((3, 3))]
        self._off_plane = [np.full(3, np.nan)]

    def add_observations(
        self,
        number: int,
        kind: ObservationKind,
        points: TrackedPoints,
        observations: RangeBearings,
        innovation: tuple[FloatArray, FloatArray] | None = None,
    ) -> None:
        """Log k observations in a frame, with innovations and covariances of those of the map."""
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
        if len(self._observations) == MAX_TABLES:
            self._observations = [LandmarkObservations.concatenate(self._observations)]

    def add_motion(
        self, step: MotionEstimate, motion: Egomotion | None, drift: CalibrationDrift | None
    ) -> None:
        """Log the step from the last frame by the camera; by odometry where there is no motion.

        Errors of the calibration add to its covariance what they have done to the pose so far.
        """
        pose, Fx, Fu = compose(self._visual_pose[-1], step[0])
        self._visual_pose.append(pose)
        covariance = Fx @ self._visual_covariance[-1] @ Fx.T + Fu @ step[1] @ Fu.T
        self._visual_covariance.append(covariance)
        by_errors = np.zeros((3, 3))
        if drift is not None:
            by_errors = drift.covariance(float(pose[2]), is_corrected=False)
        self._visual_drift.append(by_errors)
        self._off_plane.append(np.full(3, np.nan) if motion is None else motion.off_plane)

    def add_pose(
        self, pose: FloatArray, covariance: FloatArray, seconds: float, lost: bool
    ) -> None:
        """Log the pose at a frame after all updates, the time the frame took, and if it is lost."""
        self._lost.append(lost)
        self._frame_seconds.append(seconds)
        self._pose.append(pose)
        self._covariance.append(covariance)

    def result(self, visual_map: VisualMap, motion: MotionEstimator) -> VisualResult:
        """The result of the frames so far."""
        time = self.drive.time[: len(self._pose)]
        odometry = [self.drive.start]
        for control in self.drive.control[: len(time) - 1]:
            odometry.append(compose(odometry[-1], control)[0])
        landmarks, ekf = visual_map.landmarks, visual_map.ekf
        covariances = visual_map.landmark_covariances(motion.scale_sigma)
        more = len(self.remarks) - MAX_REMARKS
        others = [f"{more} more frames could not be used"] if more > 0 else []
        return VisualResult(
            trajectory=Trajectory(time, np.array(self._pose), np.array(self._covariance)),
            odometry=Trajectory(time, np.array(odometry)),
            visual_odometry=Trajectory(
                time,
                np.array(self._visual_pose),
                np.array(self._visual_covariance) + self._visual_drift,
            ),
            map=LandmarkMap(landmarks.id, ekf.landmarks, covariances, landmarks.observations),
            descriptors=landmarks.descriptor,
            height=landmarks.height,
            observations=LandmarkObservations.concatenate(self._observations),
            off_plane=np.array(self._off_plane),
            missed=self.missed,
            frame_seconds=np.array(self._frame_seconds),
            lost=np.array(self._lost, np.bool_),
            calibration=motion.drift.report() if motion.drift else None,
            remarks=(*self.remarks[:MAX_REMARKS], *others, *motion.planarity.remarks()),
        )
