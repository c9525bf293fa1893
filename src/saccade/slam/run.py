"""EKF-SLAM on a landmark log."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, Self

import numpy as np

from saccade.errors import LogError, require
from saccade.slam.association.jcbb import JointCompatibility
from saccade.slam.association.known import KnownIdentity
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.association.rule import Association
from saccade.slam.checkpoint import Checkpoint, Stateful
from saccade.slam.consistency import Consistency, summarize
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.error_state import FIRST_ESTIMATES, INVARIANT, STANDARD, Retraction
from saccade.slam.map_management.candidates import Candidates
from saccade.slam.map_management.culling import Culling, field_of_view
from saccade.slam.models import RANGE_BEARING, Motion, Sensor, compose, drive
from saccade.slam.passage import Passage
from saccade.slam.snapshots import Recorder
from saccade.slam.stretch import new_replay
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

MOTIONS: dict[str, Motion] = {"drive": drive, "compose": compose}
"""The motion model of each kind of control of a log."""
RETRACTIONS: dict[str, Retraction] = {
    "invariant": INVARIANT,
    "standard": STANDARD,
    "first-estimates": FIRST_ESTIMATES,
}
"""The error parametrization of each kind of filter."""
ASSOCIATION_RULES: dict[str, Callable[[float, float], Association]] = {
    "nearest": NearestNeighbor,
    "mutual": partial(NearestNeighbor, mutual=True),
    "joint": JointCompatibility,
}
"""The rules of unknown association, given two gates."""
MIN_SIGMA = 1e-4
"""Metres and radians: standard deviation added to observations with a singular covariance. Exact
ones would make a filter diverge by its own linearization errors."""


@dataclass(frozen=True)
class EkfConfig:
    """Parameters of the filter, of data association and of map management."""

    filter: Literal["invariant", "standard", "first-estimates"] = "invariant"
    """Error parametrization: right-invariant, which stays consistent, or the source's."""
    association: Literal["auto", "known", "nearest", "mutual", "joint"] = "auto"
    """Data association: by the log's landmark identities, to the nearest landmark, to the mutually
    nearest one, or of the largest jointly compatible set of pairs. "auto" is "known" where the log
    identifies every landmark, else "mutual"."""
    gate: float = 0.99
    """Unknown association: probability with which an observation of a landmark is accepted."""
    new_gate: float = 0.9999
    """Unknown association: an observation outside this probability of every landmark is new."""
    confirm_after: int = 5
    """Unknown association: a landmark enters the map at this observation; 1 for the first."""
    candidate_timeout: float = 2.0
    """Unknown association: units of the log's time until a candidate without a re-observation is
    dropped."""
    min_observations: int = 10
    """Unknown association: landmarks with fewer observations in the whole log are removed at its
    end."""
    culling_ratio: float | None = 0.4
    """Unknown association: a landmark that is observed in less than this fraction of the checks in
    which it is in view is removed; None keeps all."""
    motion_noise_scale: float = 1.0
    """Factor on the standard deviations of the controls."""
    sensor_noise_scale: float = 1.0
    """Factor on the standard deviations of the observations."""
    huber: float = 1.345
    """Root of the normalized innovation squared beyond which an observation has less weight, its
    covariance multiplied by their ratio. The usual value costs 5 % of efficiency where all noise is
    Gaussian; infinite for full weight always."""
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
        ratio = self.culling_ratio
        in_range = ratio is None or 0 < ratio < 1
        require(in_range, "culling_ratio", "None, or over 0 and under 1", ratio)
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
        bias, no landmark removed. Two things are not specified there: singular covariances R are
        made regular (`MIN_SIGMA`), and a second observation of a new landmark in the same scan is
        dropped.
        """
        return cls(
            filter="standard",
            association="known",
            huber=np.inf,
            estimate_odometry_bias=False,
        )


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
    poses = len(log.time)
    associate, candidates = _association(log, config, associate)
    culling = None
    if config.culling_ratio is not None and not isinstance(associate, KnownIdentity):
        culling = Culling(field_of_view(log), config.culling_ratio)
    passage = Passage(
        log=log,
        ekf=_filter(log, config, motion, sensor),
        associate=associate,
        candidates=candidates,
        culling=culling,
        U=log.control_covariance * config.motion_noise_scale**2,
        R=_regularized(log.observation_covariance * config.sensor_noise_scale**2),
        scans=np.searchsorted(log.observation_pose, np.arange(poses + 1)),
        results=new_replay(poses, len(log.observation)),
        association=np.full(len(log.observation), -1),
    )
    parts: dict[str, Stateful | None] = {
        "ekf": passage.ekf,
        "associate": associate,
        "candidates": candidates,
        "culling": culling,
        "results": passage,
        "recorder": recorder,
    }
    identity = (log, config, motion, sensor, associate)
    done = 0 if checkpoint is None else checkpoint.resume(identity, parts)
    hundredth = poses // 100 + 1
    stretch = hundredth if passage.in_stretches and recorder is None else 1

    for start in range(done, poses, stretch):
        end = min(start + stretch, poses)
        passage.advance(start, end)
        if recorder is not None:
            recorder.add(start, poses, passage.ekf, passage.association[passage.scan(start, end)])
        if checkpoint is not None:
            checkpoint.save(end, parts)
        if progress is not None and (start % hundredth == 0 or end == poses):
            progress(end, poses)

    removed = 0
    if culling is not None:
        associated = passage.association[passage.association >= 0]
        count = np.bincount(associated, minlength=len(passage.ekf))
        rare = np.flatnonzero(count < config.min_observations)
        passage.remove(rare)
        removed = culling.removed + len(rare)
    pose, covariance, innovation, innovation_covariance, nis = passage.results
    return SlamResult(
        trajectory=Trajectory(log.time, pose, covariance),
        map=_landmark_map(passage.ekf, log, passage.association),
        consistency=summarize(nis),
        association=passage.association,
        innovation=innovation,
        innovation_covariance=innovation_covariance,
        dead_reckoning=dead_reckon(log, config, motion),
        removed=removed,
        odometry_bias=passage.ekf.odometry_bias,
    )


def dead_reckon(
    log: LandmarkLog, config: EkfConfig = EkfConfig(), motion: Motion | None = None
) -> Trajectory:
    """Dead reckoning: the trajectory by the controls alone, with its growing covariance."""
    ekf = _filter(log, config, motion, RANGE_BEARING)
    pose, covariance = ekf.pose[None], ekf.pose_covariance[None]
    U = log.control_covariance * config.motion_noise_scale**2
    none = np.empty(0, np.int64)
    later = ekf.replay(log.control, U, none, np.empty((0, 2)), np.empty((0, 2, 2)), none)
    return Trajectory(
        log.time,
        np.concatenate([pose, later.pose]),
        np.concatenate([covariance, later.covariance]),
    )


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


def _filter(log: LandmarkLog, config: EkfConfig, motion: Motion | None, sensor: Sensor) -> EkfSlam:
    custom = motion is not None or log.motion not in MOTIONS or sensor is not RANGE_BEARING
    estimated = config.estimate_odometry_bias and any(log.odometry_bias) and not custom
    bias = log.odometry_bias if estimated else ()
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
    smallest = (a + d) / 2 - np.hypot((a - d) / 2, b)  # eigenvalue
    return R + MIN_SIGMA**2 * (smallest < MIN_SIGMA**2)[:, None, None] * np.eye(2)


def _association(
    log: LandmarkLog, config: EkfConfig, custom: Association | None
) -> tuple[Association, Candidates]:
    candidates = Candidates(config.confirm_after, config.candidate_timeout, config.gate)
    if custom is not None:
        return custom, candidates
    named = log.landmark >= 0
    if config.association == "known" and not named.any() and len(named) > 0:
        raise LogError(
            "association: expected nearest, found known, but the log does not name "
            "the landmarks it sees"
        )
    if config.association == "known" or (config.association == "auto" and named.all()):
        return KnownIdentity(), Candidates(confirm_after=1, timeout=config.candidate_timeout)
    rule = ASSOCIATION_RULES["mutual" if config.association == "auto" else config.association]
    return rule(config.gate, config.new_gate), candidates


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
