"""EKF-SLAM on a landmark log."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from saccade.errors import LogError
from saccade.io.checkpoint import Arrays, Checkpoint, Stateful, StoredArrays
from saccade.landmark_names import FIRST_TEXT
from saccade.plane import rotations
from saccade.slam.config import EkfConfig
from saccade.slam.consistency import Consistency, summarize
from saccade.slam.culling import numbers_of_kept
from saccade.slam.filter.models import new_innovations
from saccade.slam.online import Slam
from saccade.slam.recovery import PoseSearch
from saccade.slam.results import StepResult
from saccade.slam.scans import scans_of
from saccade.slam.snapshots import Recorder
from saccade.types import (
    BoolArray,
    FloatArray,
    IntArray,
    LandmarkLog,
    LandmarkMap,
    Trajectory,
)

SURE, MOST_AMBIGUOUS, MOST_WRONG = 0.8, 0.28, 0.2
"""A map without names is in doubt if its hypothesis has a smaller probability, or if more of the
observations may be of several landmarks or, as far as is known, are of other ones."""
MAX_NONLINEARITY = 0.12
"""Of `SlamResult.nonlinearity`: above it the filter is overconfident in simulated worlds."""
FOUND = 0.99
"""Probability from which a hypothesis of the first pose is right."""
MAX_SCANS = 50
"""Scans after which a robot that was not found is not in the map."""


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
    refused: BoolArray
    """(k,) whether the landmark name of each observation contradicted the map and was refused."""
    removed: int = 0
    """Landmarks that were culled."""
    warning: str = ""
    """Why nothing is in the map, or most observations were not used; empty if neither is so."""
    odometry_bias: FloatArray | None = None
    """(3,) estimated odometry biases (see `LandmarkLog.odometry_bias`); None if not estimated."""
    nonlinearity: float = 0.0
    """Root of the mean share of second-order terms in the variance of the innovations; the
    covariances are doubtful over `MAX_NONLINEARITY`. Zero for the standard filter."""
    lost: BoolArray | None = None
    """(t + 1,) whether the robot found itself lost at each pose: that is by odometry alone."""
    session: IntArray | None = None
    """(n,) in which session each landmark of the map was added, from 0, see `Slam.load`."""

    def __repr__(self) -> str:
        return f"SlamResult({self.trajectory!r}, {self.map!r}, {self.consistency!r})"


def run(
    log: LandmarkLog,
    config: EkfConfig = EkfConfig(),
    progress: Callable[[int, int], None] | None = None,
    *,
    recorder: Recorder | None = None,
    checkpoint: Checkpoint | None = None,
    initial: Slam | None = None,
) -> SlamResult:
    """Filter a landmark log with EKF-SLAM (C.1-C.18).

    Every pose depends on earlier measurements only. Candidates that are not confirmed at the end
    are left out of the map and of the association.

    Args:
        log: controls and observations.
        config: filter, association and noise.
        progress: called with the number of poses done and of all poses, some
            hundred times in all.
        recorder: records snapshots of the map while it grows.
        checkpoint: where the run saves its state, and from where it resumes.
        initial: a `Slam` that takes the steps of the log, as `Slam.load` or `slam_for` gives it;
            then `config` is its own, and the first pose of
            the log is the one at which it is. Without one, the log begins a map.

    Returns:
        Trajectory, map, consistency and association.

    Raises:
        LogError: known association of a log that does not identify its landmarks, or an estimate
            that diverges; names the pose.
    """
    slam = initial or slam_for(log, config)
    if slam.config.association == "known" and (log.landmark < 0).all() and len(log.landmark):
        raise LogError(
            "association: expected nearest, found known, but the log does not name "
            "the landmarks it sees"
        )
    config, poses = slam.config, len(log.time)
    removed_before = slam.culling.removed
    odometry = dead_reckon(replace(log, start=slam.ekf.pose), config)
    k = len(log.observation)
    pose, covariance = np.empty((poses, 3)), np.empty((poses, 3, 3))
    lost, refused = np.zeros(poses, np.bool_), np.zeros(k, np.bool_)
    association, innovations = np.full(k, -1), new_innovations(k)
    arrays: Arrays = {
        **{"pose": pose, "covariance": covariance, "lost": lost, "refused": refused},
        "association": association,
        **{f"innovation_{name}": array for name, array in innovations._asdict().items()},
    }
    parts: dict[str, Stateful | None] = {
        "slam": slam,
        "results": StoredArrays(arrays),
        "recorder": recorder,
    }
    identity = (log, config, initial and initial.to_arrays())
    done = 0 if checkpoint is None else checkpoint.resume(identity, parts)
    hundredth, start = poses // 100 + 1, int((log.observation_pose < done).sum())
    slam.num_steps = max(slam.num_steps - (done == 0), 0)  # at the first pose it is already

    names = slam.number(log.landmark, log.text_names)
    for i, result in _steps(slam, log, names, done):
        end = start + len(result.association)
        pose[i], covariance[i], lost[i] = result.pose, result.covariance, result.lost
        if end > start:
            slam.renumber(association[:start], result)
            rows = slice(start, end)
            association[rows], refused[rows] = result.association, result.refused
            innovations.value[rows] = result.innovations
            innovations.covariance[rows] = result.innovation_covariances
            innovations.nis[rows] = result.nis
        if recorder is not None:
            confirmed = slam.confirmed if recorder.is_due(i, poses) else None
            found, hypotheses = association[start:end], result.hypotheses
            recorder.add(i, poses, slam.ekf, found, confirmed, hypotheses)
        if checkpoint is not None:
            checkpoint.save(i + 1, parts)
        if progress is not None and (i % hundredth == 0 or i + 1 == poses):
            progress(i + 1, poses)
        start = end

    kept = slam.confirmed
    landmarks = _landmark_map(slam, names, association, kept)
    association = numbers_of_kept(kept)[association]
    return SlamResult(
        trajectory=Trajectory(log.time, pose, covariance),
        map=landmarks,
        consistency=summarize(innovations.nis, refused=float(refused.sum()) / max(k, 1)),
        association=association,
        innovation=innovations.value,
        innovation_covariance=innovations.covariance,
        dead_reckoning=odometry,
        refused=refused,
        removed=slam.culling.removed - removed_before,
        warning=slam.culling.warning(association) or _doubt(association, slam),
        odometry_bias=slam.ekf.odometry_bias,
        nonlinearity=slam.ekf.nonlinearity,
        lost=lost,
        session=slam.landmark_sessions[kept],
    )


def _steps(
    slam: Slam, log: LandmarkLog, names: IntArray, done: int
) -> Iterator[tuple[int, StepResult]]:
    """Take the steps of a log from a pose on; gives their numbers and results."""
    scans = scans_of(log, slam.config, names)
    return ((i, slam.process(scan)) for i, scan in enumerate(scans) if i >= done)


def _doubt(association: IntArray, slam: Slam) -> str:
    """Why a map without names is in doubt, if it is."""
    if (slam.identities >= 0).any():
        return ""
    count, followed = max(len(association), 1), slam.hypotheses
    unused, ambiguous = (association < 0).sum() / count, slam.culling.ambiguous / count
    sure = followed.probability > SURE and followed.wrong < MOST_WRONG
    if sure and ambiguous < MOST_AMBIGUOUS:
        return ""
    return (
        f"the map is in doubt: no observation names a landmark; {unused:.0%} of them are not used, "
        f"up to {followed.wrong:.0%} of the associations may be wrong, and the probability of the "
        f"map among the hypotheses that were followed is {followed.probability:.2f}"
    )


def slam_for(log: LandmarkLog, config: EkfConfig = EkfConfig()) -> Slam:
    """The `Slam` that `run` takes through a log: with its start and odometry biases."""
    return Slam(config, start=log.start, odometry_bias=log.odometry_bias)


def dead_reckon(log: LandmarkLog, config: EkfConfig = EkfConfig()) -> Trajectory:
    """Dead reckoning: the trajectory by the controls alone, with its growing covariance."""
    none = slice(0)
    blind = replace(
        log,
        observation_pose=log.observation_pose[none],
        observation=log.observation[none],
        observation_covariance=log.observation_covariance[none],
        landmark=log.landmark[none],
    )
    slam = slam_for(blind, config)
    results = [result for _, result in _steps(slam, blind, blind.landmark, 0)]
    pose, covariance = (
        np.array([getattr(r, name) for r in results]) for name in ("pose", "covariance")
    )
    return Trajectory(log.time, pose, covariance)


def find_start(slam: Slam, log: LandmarkLog) -> tuple[FloatArray, FloatArray]:
    """Find the first pose of a log in a map, by its first scans and without a prior.

    This looks ahead to the scan that decides; `Relocalizer` finds a live robot at that scan.

    Args:
        slam: with the map, as `Slam.load` gives it.
        log: of which the first scans are used, as many as are needed.

    Returns:
        The first pose (3,) in the frame of the map, and its covariance (3, 3), which includes
        the uncertainty of the landmarks around.

    Raises:
        LogError: no pose is certain.
    """
    ekf, scans, best = slam.ekf, 0, 0.0
    search = PoseSearch(ekf, np.arange(len(ekf)), anywhere=True, found=FOUND, scans=1)
    for step in range(len(log.time)):
        if step > 0:
            search.predict(log.control[step - 1], log.control_covariance[step - 1])
        scan = log.observation_pose == step
        if not scan.any() or scans == MAX_SCANS:
            continue
        z, R = log.observation[scan], log.observation_covariance[scan]
        found = search.add(z, R, np.full(len(z), -1))
        scans += 1
        best = float(found.probability[0]) if len(found) > 0 else best
        if search.is_found:
            association, covariance = found.association[0], found.covariance[0].copy()
            used = association[association >= 0]
            covariance[:2, :2] += ekf.landmark_covariances[used].mean(0)
            blind = replace(log, start=np.zeros(3), odometry_bias=(0.0, 0.0, 0.0))
            moved = dead_reckon(blind, EkfConfig(filter="standard"))
            assert moved.covariance is not None
            return _before(found.pose[0], covariance, moved.pose[step], moved.covariance[step])
    raise LogError(
        f"start: expected a pose in the map that is certain, found a probability of {best:.2f} "
        f"after {scans} scans; give the start"
    )


def _before(
    pose: FloatArray, C: FloatArray, moved: FloatArray, moved_covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The pose from which a motion (3,) with its covariance leads to a pose."""
    heading = pose[2] - moved[2]
    R = rotations(heading)
    arm = R @ moved[:2]
    J, K = np.eye(3), np.zeros((3, 3))
    J[:2, 2] = arm[1], -arm[0]
    K[:2, :2], K[:2, 2], K[2, 2] = -R, [-arm[1], arm[0]], -1.0
    return np.append(pose[:2] - arm, heading), J @ C @ J.T + K @ moved_covariance @ K.T


def _landmark_map(
    slam: Slam, named: IntArray, association: IntArray, kept: BoolArray
) -> LandmarkMap:
    """The map; `named` (k,) are the names of the observations."""
    identity, used = slam.identities, np.flatnonzero(association >= 0)
    if (identity < 0).all():  # a rule that does not use them
        landmark, first = np.unique(association[used], return_index=True)
        identity[landmark] = named[used[first]]
    identity = identity[kept]
    unnamed = identity < 0  # numbered in order, after the names that are integers
    last = identity[identity < FIRST_TEXT].max(initial=-1)
    return LandmarkMap(
        id=np.where(unnamed, last + np.cumsum(unnamed), identity),
        xy=slam.ekf.landmarks[kept],
        covariance=slam.ekf.landmark_covariances[kept],
        observations=np.bincount(association[used], minlength=len(kept))[kept],
        text_names=slam.text_names,
    )
