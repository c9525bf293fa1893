"""A landmark log in, a trajectory and a map out."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from saccade.errors import LogError, require
from saccade.slam.association import (
    NEW,
    Association,
    KnownIdentity,
    NearestNeighbor,
    number_by_first_sight,
)
from saccade.slam.consistency import Consistency, summarize
from saccade.slam.ekf import EkfSlam
from saccade.slam.landmarks import Candidates
from saccade.slam.models import Motion, compose, drive
from saccade.slam.retraction import FIRST_ESTIMATES, INVARIANT, STANDARD, Retraction
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

STRETCH = 1000
"""Poses that are filtered between two words about the progress."""
MOTIONS: dict[str, Motion] = {"drive": drive, "compose": compose}
"""The motion model of each kind of control that a log may hold."""
RETRACTIONS: dict[str, Retraction] = {
    "invariant": INVARIANT,
    "standard": STANDARD,
    "first-estimates": FIRST_ESTIMATES,
}
"""How each kind of filter measures errors."""


@dataclass(frozen=True)
class EkfConfig:
    """How a log is filtered."""

    filter: Literal["invariant", "standard", "first-estimates"] = "invariant"
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
    dead_reckoning: Trajectory
    """(t + 1) poses from the controls alone, with covariance."""

    def __repr__(self) -> str:
        return f"SlamResult({self.trajectory!r}, {self.map!r}, {self.consistency!r})"


def run(
    log: LandmarkLog,
    config: EkfConfig = EkfConfig(),
    progress: Callable[[int, int], None] | None = None,
) -> SlamResult:
    """Filter a landmark log with EKF-SLAM (C.1-C.18).

    Args:
        log: controls and observations.
        config: association and noise.
        progress: called with the number of poses done and of all poses, some
            hundred times in all.

    Returns:
        Trajectory, map, consistency and association.

    Raises:
        LogError: known association is asked of a log that does not name its landmarks.
    """
    poses = len(log.time)
    ekf = _filter(log, config)
    associate, candidates = _association(log, config)
    U = log.control_covariance * config.motion_noise_scale**2  # (t, c, c)
    R = log.observation_covariance * config.sensor_noise_scale**2  # (k, 2, 2)
    scans = np.searchsorted(log.observation_pose, np.arange(poses + 1))
    pose, covariance = np.empty((poses, 3)), np.empty((poses, 3, 3))
    association = np.empty(len(log.observation), np.int64)
    nis = np.full(len(log.observation), np.nan)

    if isinstance(associate, KnownIdentity):
        return _replayed(log, config, ekf, U, R, progress)
    for step in range(poses):
        if step > 0:
            ekf.predict(log.control[step - 1], U[step - 1])  # C.5-C.9
        scan = np.arange(scans[step], scans[step + 1])
        if len(scan) > 0:
            found = associate(ekf, log.observation[scan], R[scan], log.landmark[scan])
            for k, landmark in zip(scan[found >= 0], found[found >= 0].tolist(), strict=True):
                nis[k] = ekf.update(log.observation[k], R[k], landmark).nis  # C.10-C.14
            new = scan[found == NEW]
            confirmed = candidates.confirm(ekf, log.observation[new], R[new], log.time[step])
            association[scan] = np.maximum(found, -1)
            for k in new[confirmed]:
                association[k] = ekf.augment(log.observation[k], R[k])  # C.15-C.18
                associate.added(int(association[k]), int(log.landmark[k]))
        pose[step], covariance[step] = ekf.pose, ekf.pose_covariance
        if progress is not None and (step % (poses // 100 + 1) == 0 or step == poses - 1):
            progress(step + 1, poses)

    return SlamResult(
        trajectory=Trajectory(log.time, pose, covariance),
        map=_landmark_map(ekf, log, association),
        consistency=summarize(nis),
        association=association,
        dead_reckoning=dead_reckon(log, config),
    )


def _replayed(
    log: LandmarkLog,
    config: EkfConfig,
    ekf: EkfSlam,
    U: FloatArray,
    R: FloatArray,
    progress: Callable[[int, int], None] | None,
) -> SlamResult:
    """Filter a log whose association is known beforehand."""
    association = number_by_first_sight(log.landmark, log.observation_pose)
    parts = []
    poses = len(log.time)
    still = np.zeros((1, log.control.shape[1]))  # after which the first pose is left
    control = np.concatenate([still, log.control])
    U = np.concatenate([still[:, :, None] * still[:, None], U])
    for start in range(0, poses, STRETCH):
        end = min(start + STRETCH, poses)
        first, last = np.searchsorted(log.observation_pose, [start, end])
        parts.append(
            ekf.replay(
                control[start:end],
                U[start:end],
                log.observation_pose[first:last] - start,
                log.observation[first:last],
                R[first:last],
                association[first:last],
            )
        )
        if progress is not None:
            progress(end, poses)
    pose, covariance, _, _, nis = (np.concatenate(part) for part in zip(*parts, strict=True))
    return SlamResult(
        trajectory=Trajectory(log.time, pose, covariance),
        map=_landmark_map(ekf, log, association),
        consistency=summarize(nis),
        association=association,
        dead_reckoning=dead_reckon(log, config),
    )


def dead_reckon(log: LandmarkLog, config: EkfConfig = EkfConfig()) -> Trajectory:
    """Where the controls alone lead, with the covariance that grows on the way."""
    ekf = _filter(log, config)
    start, spread = ekf.pose, ekf.pose_covariance
    U = log.control_covariance * config.motion_noise_scale**2
    nothing = np.empty(0, np.int64)
    way = ekf.replay(log.control, U, nothing, np.empty((0, 2)), np.empty((0, 2, 2)), nothing)
    return Trajectory(
        log.time,
        np.concatenate([start[None], way.pose]),
        np.concatenate([spread[None], way.covariance]),
    )


def _filter(log: LandmarkLog, config: EkfConfig) -> EkfSlam:
    return EkfSlam(
        log.start,
        np.diag(np.square(config.start_sigma)),
        motion=MOTIONS[log.motion],
        retraction=RETRACTIONS[config.filter],
    )


def _association(log: LandmarkLog, config: EkfConfig) -> tuple[Association, Candidates]:
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
