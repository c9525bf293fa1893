"""A landmark log in, a trajectory and a map out."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from saccade.errors import LogError, require
from saccade.slam.association import NEW, Association, KnownIdentity, NearestNeighbor
from saccade.slam.checkpoint import Checkpoint
from saccade.slam.consistency import Consistency, summarize
from saccade.slam.ekf import EkfSlam
from saccade.slam.landmarks import Candidates
from saccade.slam.models import RANGE_BEARING, Motion, Sensor, compose, drive
from saccade.slam.recording import Recorder
from saccade.slam.retraction import INVARIANT, STANDARD, Retraction
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

MOTIONS: dict[str, Motion] = {"drive": drive, "compose": compose}
"""The motion model of each kind of control that a log may hold."""
RETRACTIONS: dict[str, Retraction] = {"invariant": INVARIANT, "standard": STANDARD}
"""How each kind of filter measures errors."""
FINEST = 1e-4
"""Metres and radians. What claims to be exact leaves a filter no room for its own linearization
and drives it off; it is taken to be as good as this."""
FARTHEST = 1e9
"""Metres from the origin at which an estimate has gone astray."""


@dataclass(frozen=True)
class EkfConfig:
    """How a log is filtered."""

    filter: Literal["invariant", "standard"] = "invariant"
    """How errors are measured: in SE(2), which stays consistent, or as the source does."""
    association: Literal["auto", "known", "nearest"] = "auto"
    """Whose word is taken for what was seen: the log's, or the nearest landmark's; "auto"
    takes the log's where it names every landmark."""
    gate: float = 0.99
    """Nearest neighbor: probability with which an observation of a landmark is accepted."""
    new_gate: float = 0.9999
    """Nearest neighbor: what is outside this probability for every landmark is new."""
    sightings: int = 5
    """Nearest neighbor: a landmark enters the map at this sighting; 1 takes the first."""
    lifetime: float = 2.0
    """Nearest neighbor: units of the log's time for which a new place waits to be seen again."""
    motion_noise_scale: float = 1.0
    """Factor on the standard deviations of the controls."""
    sensor_noise_scale: float = 1.0
    """Factor on the standard deviations of the observations."""
    start_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Standard deviation of the first pose: metres, metres, radians."""

    def __post_init__(self) -> None:
        require(self.filter in RETRACTIONS, "filter", f"one of {(*RETRACTIONS,)}", self.filter)
        kinds = ("auto", "known", "nearest")
        require(self.association in kinds, "association", f"one of {kinds}", self.association)
        require(0 < self.gate < 1, "gate", "a probability between 0 and 1", self.gate)
        require(self.gate <= self.new_gate < 1, "new_gate", "from `gate` to under 1", self.new_gate)
        require(self.sightings >= 1, "sightings", "at least 1", self.sightings)
        require(self.lifetime > 0, "lifetime", "over 0", self.lifetime)
        for name in ("motion_noise_scale", "sensor_noise_scale"):
            value = getattr(self, name)
            require(0 < value < 1e6, name, "over 0 and under 1e6", value)
        require(
            len(self.start_sigma) == 3 and all(0 <= s < 1e6 for s in self.start_sigma),
            "start_sigma",
            "three numbers from 0 to under 1e6",
            self.start_sigma,
        )


@dataclass(frozen=True, eq=False, repr=False)
class SlamResult:
    """What a log says about where the robot was and where the landmarks are."""

    trajectory: Trajectory
    """(t + 1) poses with covariance, each as it was believed at its own time."""
    map: LandmarkMap
    """Landmarks with covariance at the end of the log."""
    consistency: Consistency
    """Whether the innovations are as large as the filter expected."""
    association: IntArray
    """(k,) number of the landmark in the map for each observation, -1 where it was not used."""
    innovation: FloatArray
    """(k, 2) of each observation, as the filter has it (see `Innovation`); NaN as the NIS is."""
    innovation_covariance: FloatArray
    """(k, 2, 2) before the update."""
    dead_reckoning: Trajectory
    """(t + 1) poses from the controls alone, with covariance."""

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

    Args:
        log: controls and observations.
        config: association and noise.
        progress: called with the number of poses done and of all poses, some
            hundred times in all.
        motion: what the controls mean; the log says it unless told otherwise.
        sensor: what the observations mean; range and bearing unless told otherwise.
        associate: a rule in the place of the one that `config` names.
        recorder: takes snapshots of the map while it grows.
        checkpoint: where the run saves itself, and goes on if it was interrupted.

    Returns:
        Trajectory, map, consistency and association.

    Raises:
        LogError: known association is asked of a log that does not name its landmarks, a
            model of its own is not given, or the estimate goes astray; names the pose.
    """
    poses = len(log.time)
    ekf = _filter(log, config, motion, sensor)
    associate, candidates = _association(log, config, associate)
    U = log.control_covariance * config.motion_noise_scale**2  # (t, c, c)
    R = _believed(log.observation_covariance * config.sensor_noise_scale**2)  # (k, 2, 2)
    scans = np.searchsorted(log.observation_pose, np.arange(poses + 1))
    pose, covariance = np.empty((poses, 3)), np.empty((poses, 3, 3))
    association = np.empty(len(log.observation), np.int64)
    nis = np.full(len(log.observation), np.nan)
    innovation, spread = np.full((len(nis), 2), np.nan), np.full((len(nis), 2, 2), np.nan)
    state = {
        "ekf": ekf,
        "associate": associate,
        "candidates": candidates,
        "pose": pose,
        "covariance": covariance,
        "association": association,
        "nis": nis,
        "innovation": innovation,
        "spread": spread,
        "recorder": recorder,
    }
    models = (config, motion, sensor, associate)
    done = 0 if checkpoint is None else checkpoint.resume(log, models, state)

    for step in range(done, poses):
        if step > 0:
            ekf.predict(log.control[step - 1], U[step - 1])  # C.5-C.9
        scan = np.arange(scans[step], scans[step + 1])
        if len(scan) > 0:
            found = associate(ekf, log.observation[scan], R[scan], log.landmark[scan])
            for k, landmark in zip(scan[found >= 0], found[found >= 0].tolist(), strict=True):
                innovation[k], spread[k], nis[k] = ekf.update(
                    log.observation[k], R[k], landmark
                )  # C.10-C.14
            new = scan[found == NEW]
            confirmed = candidates.confirm(ekf, log.observation[new], R[new], log.time[step])
            association[scan] = np.maximum(found, -1)
            for k in new[confirmed]:
                association[k] = ekf.augment(log.observation[k], R[k])  # C.15-C.18
                associate.added(int(association[k]), int(log.landmark[k]))
        pose[step], covariance[step] = ekf.pose, ekf.pose_covariance
        if not np.abs(pose[step]).max() < FARTHEST:
            raise LogError(
                f"pose {step}: expected an estimate on this planet, found that it has gone "
                "astray; observations or controls contradict the deviations they are said to have"
            )
        if recorder is not None:
            recorder.add(step, poses, ekf, association[scan])
        if checkpoint is not None:
            checkpoint.keep(step + 1, state)
        if progress is not None and (step % (poses // 100 + 1) == 0 or step == poses - 1):
            progress(step + 1, poses)

    return SlamResult(
        trajectory=Trajectory(log.time, pose, covariance),
        map=_landmark_map(ekf, log, association),
        consistency=summarize(nis),
        association=association,
        innovation=innovation,
        innovation_covariance=spread,
        dead_reckoning=dead_reckon(log, config, motion),
    )


def dead_reckon(
    log: LandmarkLog, config: EkfConfig = EkfConfig(), motion: Motion | None = None
) -> Trajectory:
    """Where the controls alone lead, with the covariance that grows on the way."""
    ekf = _filter(log, config, motion, RANGE_BEARING)
    U = log.control_covariance * config.motion_noise_scale**2
    pose, covariance = np.empty((len(log.time), 3)), np.empty((len(log.time), 3, 3))
    pose[0], covariance[0] = ekf.pose, ekf.pose_covariance
    for step, control in enumerate(log.control):
        ekf.predict(control, U[step])
        pose[step + 1], covariance[step + 1] = ekf.pose, ekf.pose_covariance
    return Trajectory(log.time, pose, covariance)


def motion_of(log: LandmarkLog, own: Motion | None) -> Motion:
    """The motion model of a log.

    Raises:
        LogError: its controls are of a model of its own, and that is not given.
    """
    if own is not None:
        return own
    if log.motion not in MOTIONS:
        raise LogError(f"motion: expected the model of {log.motion} controls, found none given")
    return MOTIONS[log.motion]


def _filter(log: LandmarkLog, config: EkfConfig, motion: Motion | None, sensor: Sensor) -> EkfSlam:
    return EkfSlam(
        log.start,
        np.diag(np.square(config.start_sigma)),
        motion=motion_of(log, motion),
        sensor=sensor,
        retraction=RETRACTIONS[config.filter],
    )


def _believed(R: FloatArray) -> FloatArray:
    """Covariances (k, 2, 2), singular ones with `FINEST` in every direction."""
    a, b, d = R[:, 0, 0], R[:, 0, 1], R[:, 1, 1]
    least = (a + d) / 2 - np.hypot((a - d) / 2, b)
    return R + FINEST**2 * (least < FINEST**2)[:, None, None] * np.eye(2)


def _association(
    log: LandmarkLog, config: EkfConfig, own: Association | None
) -> tuple[Association, Candidates]:
    if own is not None:
        return own, Candidates(config.sightings, config.lifetime, config.gate)
    named = log.landmark >= 0
    if config.association == "known" and not named.any() and len(named) > 0:
        raise LogError(
            "association: expected nearest, found known, but the log does not name "
            "the landmarks it sees"
        )
    if config.association == "known" or (config.association == "auto" and named.all()):
        return KnownIdentity(), Candidates(sightings=1, lifetime=config.lifetime)
    return (
        NearestNeighbor(config.gate, config.new_gate),
        Candidates(config.sightings, config.lifetime, config.gate),
    )


def _landmark_map(ekf: EkfSlam, log: LandmarkLog, association: IntArray) -> LandmarkMap:
    used = association >= 0
    first = np.unique(association[used], return_index=True)[1]  # (N,)
    identity = log.landmark[used][first]
    return LandmarkMap(
        id=identity if (identity >= 0).all() else np.arange(len(ekf)),
        xy=ekf.landmarks,
        covariance=ekf.landmark_covariances,
        sightings=np.bincount(association[used], minlength=len(ekf)),
    )
