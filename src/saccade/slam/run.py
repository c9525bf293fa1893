"""A landmark log in, a trajectory and a map out."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, Self

import numpy as np

from saccade.errors import LogError, require
from saccade.slam.association.jcbb import JointCompatibility
from saccade.slam.association.nearest_neighbor import (
    Association,
    KnownIdentity,
    NearestNeighbor,
)
from saccade.slam.checkpoint import Checkpoint
from saccade.slam.consistency import Consistency, summarize
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.error_state import FIRST_ESTIMATES, INVARIANT, STANDARD, Retraction
from saccade.slam.map_management.candidates import Candidates
from saccade.slam.map_management.culling import Culling, FieldOfView
from saccade.slam.models import RANGE_BEARING, Motion, Sensor, compose, drive
from saccade.slam.passage import Passage
from saccade.slam.results import Replay
from saccade.slam.snapshots import Recorder
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

MOTIONS: dict[str, Motion] = {"drive": drive, "compose": compose}
"""The motion model of each kind of control that a log may hold."""
RETRACTIONS: dict[str, Retraction] = {
    "invariant": INVARIANT,
    "standard": STANDARD,
    "first-estimates": FIRST_ESTIMATES,
}
"""How each kind of filter measures errors."""
ASSOCIATION_RULES: dict[str, Callable[[float, float], Association]] = {
    "nearest": NearestNeighbor,
    "mutual": partial(NearestNeighbor, mutual=True),
    "joint": JointCompatibility,
}
"""How what a log does not name is told, given two gates."""
MIN_SIGMA = 1e-4
"""Metres and radians. What claims to be exact leaves a filter no room for its own linearization
and drives it off; it is taken to be as good as this."""


@dataclass(frozen=True)
class EkfConfig:
    """How a log is filtered."""

    filter: Literal["invariant", "standard", "first-estimates"] = "invariant"
    """How errors are measured: in SE(2), which stays consistent, or as the source does."""
    association: Literal["auto", "known", "nearest", "mutual", "joint"] = "auto"
    """Whose word is taken for what was seen: the log's, or that of the nearest landmark, of
    landmark and observation that are the nearest of each other, or of the largest set of pairs
    that fit together. "auto" takes the log's where it names every landmark, else "mutual"."""
    gate: float = 0.99
    """Unknown landmarks: probability with which an observation of a landmark is accepted."""
    new_gate: float = 0.9999
    """Unknown landmarks: what is outside this probability for every landmark is new."""
    confirm_after: int = 5
    """Unknown landmarks: one enters the map at this sighting; 1 takes the first."""
    candidate_timeout: float = 2.0
    """Unknown landmarks: units of the log's time for which a new place waits to be seen again."""
    min_observations: int = 10
    """Unknown landmarks: one that was seen less often in all is no part of the resulting map."""
    culling_ratio: float = 0.4
    """Unknown landmarks: one that is seen less often than this share of the times that it should
    have been is removed; 0 keeps all."""
    motion_noise_scale: float = 1.0
    """Factor on the standard deviations of the controls."""
    sensor_noise_scale: float = 1.0
    """Factor on the standard deviations of the observations."""
    huber: float = 1.345
    """Root of the normalized innovation squared beyond which an observation counts less, its
    covariance that many times larger. By the usual value deviations are a twentieth larger than
    they need be where all is well; infinite for never."""
    start_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Standard deviation of the first pose: metres, metres, radians."""
    estimate_odometry_bias: bool = True
    """Whether systematic odometry errors are states of the filter where the log gives their
    standard deviations (`LandmarkLog.odometry_bias`)."""

    def __post_init__(self) -> None:
        require(self.filter in RETRACTIONS, "filter", f"one of {(*RETRACTIONS,)}", self.filter)
        kinds = ("auto", "known", *ASSOCIATION_RULES)
        require(self.association in kinds, "association", f"one of {kinds}", self.association)
        require(0 < self.gate < 1, "gate", "a probability between 0 and 1", self.gate)
        require(self.gate <= self.new_gate < 1, "new_gate", "from `gate` to under 1", self.new_gate)
        require(self.confirm_after >= 1, "confirm_after", "at least 1", self.confirm_after)
        require(self.candidate_timeout > 0, "candidate_timeout", "over 0", self.candidate_timeout)
        require(self.min_observations >= 1, "min_observations", "at least 1", self.min_observations)
        require(
            0 <= self.culling_ratio < 1, "culling_ratio", "from 0 to under 1", self.culling_ratio
        )
        for name in ("motion_noise_scale", "sensor_noise_scale"):
            value = getattr(self, name)
            require(0 < value < 1e6, name, "over 0 and under 1e6", value)
        require(self.huber > 0, "huber", "over 0, infinite for never", self.huber)
        require(
            len(self.start_sigma) == 3 and all(0 <= s < 1e6 for s in self.start_sigma),
            "start_sigma",
            "three numbers from 0 to under 1e6",
            self.start_sigma,
        )

    @classmethod
    def kootstra2010(cls) -> Self:
        """Kootstra (2010): the filter of C.1-C.18 with known data association.

        Errors along the axes of the map, every observation with its full weight, no odometry
        bias, no landmark removed. The print is silent on two things: covariances R that are
        singular are made regular (`MIN_SIGMA`), and of a landmark that a scan shows twice when it
        is new, the second observation is dropped.
        """
        return cls(
            filter="standard",
            association="known",
            huber=np.inf,
            estimate_odometry_bias=False,
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
    removed: int = 0
    """Landmarks that were taken out of the map again."""
    odometry_bias: FloatArray | None = None
    """(3,) what the odometry turned out to be off by (see `LandmarkLog.odometry_bias`)."""

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
    associate, candidates = _association(log, config, associate)
    named = isinstance(associate, KnownIdentity) or config.culling_ratio == 0
    presence = None if named else Culling(FieldOfView.from_log(log), config.culling_ratio)
    passage = Passage(
        log=log,
        ekf=_filter(log, config, motion, sensor),
        associate=associate,
        candidates=candidates,
        presence=presence,
        U=log.control_covariance * config.motion_noise_scale**2,
        R=_regularized(log.observation_covariance * config.sensor_noise_scale**2),
        scans=np.searchsorted(log.observation_pose, np.arange(poses + 1)),
        said=Replay.empty(poses, len(log.observation)),
        association=np.full(len(log.observation), -1),
    )
    state = {
        "ekf": passage.ekf,
        "associate": associate,
        "candidates": candidates,
        "presence": presence,
        "association": passage.association,
        "recorder": recorder,
        **passage.said._asdict(),
    }
    identity = (log, config, motion, sensor, associate)
    done = 0 if checkpoint is None else checkpoint.resume(log, identity, state)
    hundredth = poses // 100 + 1
    stretch = hundredth if passage.in_stretches and recorder is None else 1

    for start in range(done, poses, stretch):
        end = min(start + stretch, poses)
        passage.go_on(start, end)
        if recorder is not None:
            recorder.add(start, poses, passage.ekf, passage.association[passage.scan(start, end)])
        if checkpoint is not None:
            checkpoint.save(end, state)
        if progress is not None and (start % hundredth == 0 or end == poses):
            progress(end, poses)

    if presence is not None:
        seen = np.bincount(
            passage.association[passage.association >= 0], minlength=len(passage.ekf)
        )
        presence.removed += int((seen < config.min_observations).sum())
        passage.forget(np.flatnonzero(seen < config.min_observations))
    pose, covariance, innovation, spread, nis = passage.said
    return SlamResult(
        trajectory=Trajectory(log.time, pose, covariance),
        map=_landmark_map(passage.ekf, log, passage.association),
        consistency=summarize(nis),
        association=passage.association,
        innovation=innovation,
        innovation_covariance=spread,
        dead_reckoning=dead_reckon(log, config, motion),
        removed=0 if presence is None else presence.removed,
        odometry_bias=passage.ekf.odometry_bias,
    )


def dead_reckon(
    log: LandmarkLog, config: EkfConfig = EkfConfig(), motion: Motion | None = None
) -> Trajectory:
    """Where the controls alone lead, with the covariance that grows on the way."""
    ekf = _filter(log, config, motion, RANGE_BEARING)
    start, spread = ekf.pose[None], ekf.pose_covariance[None]
    U = log.control_covariance * config.motion_noise_scale**2
    nothing = np.empty(0, np.int64)
    way = ekf.replay(log.control, U, nothing, np.empty((0, 2)), np.empty((0, 2, 2)), nothing)
    return Trajectory(
        log.time, np.concatenate([start, way.pose]), np.concatenate([spread, way.covariance])
    )


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
    own = motion is not None or log.motion not in MOTIONS or sensor is not RANGE_BEARING
    biased = config.estimate_odometry_bias and any(log.odometry_bias) and not own
    bias = log.odometry_bias if biased else ()
    return EkfSlam(
        np.concatenate([log.start, np.zeros(len(bias))]),
        np.diag(np.square([*config.start_sigma, *bias])),
        motion=motion_of(log, motion),
        sensor=sensor,
        retraction=RETRACTIONS[config.filter],
        huber=config.huber,
    )


def _regularized(R: FloatArray) -> FloatArray:
    """Covariances (k, 2, 2), singular ones with `MIN_SIGMA` in every direction."""
    a, b, d = R[:, 0, 0], R[:, 0, 1], R[:, 1, 1]
    least = (a + d) / 2 - np.hypot((a - d) / 2, b)
    return R + MIN_SIGMA**2 * (least < MIN_SIGMA**2)[:, None, None] * np.eye(2)


def _association(
    log: LandmarkLog, config: EkfConfig, own: Association | None
) -> tuple[Association, Candidates]:
    if own is not None:
        return own, Candidates(config.confirm_after, config.candidate_timeout, config.gate)
    named = log.landmark >= 0
    if config.association == "known" and not named.any() and len(named) > 0:
        raise LogError(
            "association: expected nearest, found known, but the log does not name "
            "the landmarks it sees"
        )
    if config.association == "known" or (config.association == "auto" and named.all()):
        return KnownIdentity(), Candidates(confirm_after=1, timeout=config.candidate_timeout)
    rule = ASSOCIATION_RULES["mutual" if config.association == "auto" else config.association]
    return (
        rule(config.gate, config.new_gate),
        Candidates(config.confirm_after, config.candidate_timeout, config.gate),
    )


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
