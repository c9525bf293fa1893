"""EKF-SLAM on a landmark log."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from saccade.errors import LogError
from saccade.slam._step_kernels import Steps
from saccade.slam.association.rule import Association
from saccade.slam.checkpoint import Checkpoint, Stateful, StoredArrays
from saccade.slam.config import EkfConfig
from saccade.slam.consistency import Consistency, summarize
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.map_management.culling import field_of_view
from saccade.slam.models import RANGE_BEARING, Motion, Sensor, compose, drive
from saccade.slam.online import Slam, new_results
from saccade.slam.snapshots import Recorder
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

MOTIONS: dict[str, Motion] = {"drive": drive, "compose": compose}
"""The motion model of each kind of control of a log."""


@dataclass(frozen=True, eq=False, repr=False)
class SlamResult:
    """Trajectory, map and consistency of a filtered log."""

    trajectory: Trajectory
    """(t + 1) filtered poses with covariance: each is the estimate at its own time."""
    map: LandmarkMap
    """Landmarks with covariance at the end of the log."""
    consistency: Consistency
    """Normalized innovations squared, and whether they agree with the filter's covariances."""
    association: IntArray
    """(k,) number of the landmark in the map for each observation, -1 if it was not used."""
    innovation: FloatArray
    """(k, 2) of each observation (see `Innovation`); NaN where the NIS is."""
    innovation_covariance: FloatArray
    """(k, 2, 2) before the update."""
    dead_reckoning: Trajectory
    """(t + 1) poses from the controls alone, with covariance."""
    removed: int = 0
    """Landmarks that were removed from the map."""
    odometry_bias: FloatArray | None = None
    """(3,) estimated odometry biases (see `LandmarkLog.odometry_bias`); None if not estimated."""
    lost: BoolArray | None = None
    """(t + 1,) whether the robot found itself lost at each pose: that is by odometry alone."""

    def __repr__(self) -> str:
        return f"SlamResult({self.trajectory!r}, {self.map!r}, {self.consistency!r})"


def run(
    log: LandmarkLog,
    config: EkfConfig = EkfConfig(),
    progress: Callable[[int, int], None] | None = None,
    *,
    motion: Motion | None = None,
    sensor: Sensor = RANGE_BEARING,
    associate: Association | None = None,
    recorder: Recorder | None = None,
    checkpoint: Checkpoint | None = None,
) -> SlamResult:
    """Filter a landmark log with EKF-SLAM (C.1-C.18).

    With known association every pose depends on earlier measurements only. With unknown
    association, statistics of the whole log enter before its end: the field of view that culling
    checks (see `field_of_view`), and "auto" of `EkfConfig.association`, which looks for an
    observation without identity. At the end, `EkfConfig.min_observations` removes landmarks and
    their associations; poses and innovations stay as they were filtered.

    Args:
        log: controls and observations.
        config: filter, association and noise.
        progress: called with the number of poses done and of all poses, some
            hundred times in all.
        motion: the motion model; by default that of the log's controls.
        sensor: the sensor model; by default range and bearing.
        associate: a custom association rule instead of the one in `config`.
        recorder: records snapshots of the map while it grows.
        checkpoint: where the run saves its state, and from where it resumes.

    Returns:
        Trajectory, map, consistency and association.

    Raises:
        LogError: known association of a log that does not identify its landmarks, a custom
            motion model that is missing, or an estimate that diverges; names the pose.
    """
    slam, poses = slam_for(log, config, motion, sensor, associate), len(log.time)
    steps, out = _steps(slam, log), new_results(poses, len(log.observation))
    innovations = {f"innovation_{name}": array for name, array in out.innovations._asdict().items()}
    arrays = {"pose": out.pose, "covariance": out.covariance, "association": steps.landmark}

    parts: dict[str, Stateful | None] = {
        "slam": slam,
        "results": StoredArrays({**arrays, **innovations, "lost": out.lost}),
        "recorder": recorder,
    }
    identity = (log, config, motion, sensor, associate)
    done = 0 if checkpoint is None else checkpoint.resume(identity, parts)
    steps.position[0] = done
    hundredth = poses // 100 + 1
    stride = hundredth if slam.is_compiled and recorder is None else 1

    for start in range(done, poses, stride):
        end = min(start + stride, poses)
        slam.advance(steps, end, out)
        if recorder is not None:
            scan = slice(steps.edge[start], steps.edge[end])
            found = steps.landmark[scan]
            recorder.add(start, poses, slam.ekf, found, slam.recovery.hypotheses)
        if checkpoint is not None:
            checkpoint.save(end, parts)
        if progress is not None and (start % hundredth == 0 or end == poses):
            progress(end, poses)

    association, removed = np.maximum(steps.landmark, -1), slam.culling.removed
    if slam.culling.rule.enabled:
        count = np.bincount(association[association >= 0], minlength=len(slam.ekf))
        rare = np.flatnonzero(count < config.min_observations)
        slam.remove(rare, association)
        removed += len(rare)
    return SlamResult(
        trajectory=Trajectory(log.time, out.pose, out.covariance),
        map=_landmark_map(slam.ekf, log, association),
        consistency=summarize(out.innovations.nis),
        association=association,
        innovation=out.innovations.value,
        innovation_covariance=out.innovations.covariance,
        dead_reckoning=dead_reckon(log, config, motion),
        removed=removed,
        odometry_bias=slam.ekf.odometry_bias,
        lost=out.lost,
    )


def slam_for(
    log: LandmarkLog,
    config: EkfConfig = EkfConfig(),
    motion: Motion | None = None,
    sensor: Sensor = RANGE_BEARING,
    associate: Association | None = None,
) -> Slam:
    """The `Slam` that `run` takes through a log: with its start, motion model and field of view.

    Raises:
        LogError: as `run`.
    """
    named = log.landmark >= 0
    if config.association == "known" and associate is None and not named.any() and len(named) > 0:
        raise LogError(
            "association: expected nearest, found known, but the log does not name "
            "the landmarks it sees"
        )
    if config.association == "auto" and named.all():
        config = replace(config, association="known")
    return Slam(
        config,
        start=log.start,
        motion=motion_of(log, motion),
        sensor=sensor,
        association=associate,
        field_of_view=field_of_view(log),
        odometry_bias=(0.0, 0.0, 0.0) if motion is not None else log.odometry_bias,
    )


def _steps(slam: Slam, log: LandmarkLog) -> Steps:
    """A whole log."""
    edge = np.searchsorted(log.observation_pose, np.arange(len(log.time) + 1))
    scans = edge, log.observation, log.observation_covariance, log.landmark
    return slam.prepare(log.time, log.control, log.control_covariance, *scans)


def dead_reckon(
    log: LandmarkLog, config: EkfConfig = EkfConfig(), motion: Motion | None = None
) -> Trajectory:
    """Dead reckoning: the trajectory by the controls alone, with its growing covariance."""
    none = log.observation_pose < 0
    blind = replace(
        log,
        observation_pose=log.observation_pose[none],
        observation=log.observation[none],
        observation_covariance=log.observation_covariance[none],
        landmark=log.landmark[none],
    )
    slam, out = slam_for(blind, config, motion), new_results(len(log.time), 0)
    slam.advance(_steps(slam, blind), len(log.time), out)
    return Trajectory(log.time, out.pose, out.covariance)


def motion_of(log: LandmarkLog, custom: Motion | None) -> Motion:
    """The motion model of a log.

    Raises:
        LogError: its controls are of a custom model, which is not given.
    """
    if custom is not None:
        return custom
    if log.motion not in MOTIONS:
        raise LogError(f"motion: expected the model of {log.motion} controls, found none given")
    return MOTIONS[log.motion]


def _landmark_map(ekf: EkfSlam, log: LandmarkLog, association: IntArray) -> LandmarkMap:
    used = association >= 0
    first = np.unique(association[used], return_index=True)[1]  # (N,)
    identity = log.landmark[used][first]
    return LandmarkMap(
        id=identity if (identity >= 0).all() else np.arange(len(ekf)),
        xy=ekf.landmarks,
        covariance=ekf.landmark_covariances,
        observations=np.bincount(association[used], minlength=len(ekf)),
    )
