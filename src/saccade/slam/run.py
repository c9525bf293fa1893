"""EKF-SLAM on a landmark log."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from saccade.errors import ConfigError, LogError
from saccade.landmark_names import FIRST_TEXT, labels_of, number_labels
from saccade.plane import in_robot_frame, rotations
from saccade.slam.config import EkfConfig
from saccade.slam.consistency import normalized_squared, summarize
from saccade.slam.filter.models import new_innovations
from saccade.slam.models import pose_difference
from saccade.slam.online import Slam
from saccade.slam.pose_search import PoseSearch
from saccade.slam.reliability import map_warning
from saccade.slam.results import SlamResult
from saccade.slam.scans import scans_of
from saccade.slam.smoothing import smooth
from saccade.slam.snapshots import Recorder
from saccade.types import (
    FloatArray,
    IntArray,
    LandmarkLog,
    LandmarkMap,
    Trajectory,
)

START_PROBABILITY = 0.99
"""Probability from which a hypothesis of the first pose is right."""
MAX_SCANS = 50
"""Scans after which a robot that was not found is not in the map."""
MAX_SCANS_AT_LAST = 10
"""The same for a robot that was at a known pose when the map was saved."""
SAME_POSE = 16.0
"""Squared Mahalanobis distance within which a pose that was found is the last one."""


def run(
    log: LandmarkLog,
    config: EkfConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    recorder: Recorder | None = None,
    initial: Slam | None = None,
) -> SlamResult:
    """Maps a landmark log: EKF-SLAM (C.1-C.18), then smoothing over the whole log.

    A filtered pose depends on earlier measurements only, a smoothed one on all of them. Candidates
    that are not confirmed at the end are left out of the map and of the association.

    Args:
        log: controls and observations.
        config: filter, association, noise, and whether to smooth (`EkfConfig.smooth`); by default
            `EkfConfig()`.
        progress: called with the number of poses that are filtered and of all poses, some
            hundred times in all.
        recorder: records snapshots of the map while the filter extends it.
        initial: a `Slam` that takes the steps of the log, as `Slam.load` or `slam_for` gives it,
            in place of `config`; the first pose of the log is the one at which it is. Without
            one, the log begins a map.

    Returns:
        Trajectory and map, with `SlamResult.estimate` "smoothed" or "filtered"; consistency and
        association. A run that begins in a map, and a log that cannot be smoothed, are filtered
        only; `SlamResult.remark` says why.

    Raises:
        ConfigError: both `config` and `initial` are given.
        LogError: known association of a log that does not identify its landmarks, or an estimate
            that diverges; names the pose.
    """
    if config is not None and initial is not None:
        raise ConfigError("config: expected none with `initial`, whose settings apply; found both")
    slam = initial or slam_for(log, config or EkfConfig())
    if slam.config.association == "known" and (log.landmark < 0).all() and len(log.landmark):
        raise LogError(
            "association: expected nearest, found known, but the log does not name "
            "the landmarks it sees"
        )
    remark = locate_start(slam, log)
    log = replace(log, start=slam.filter.pose, odometry_bias=slam.odometry_bias)
    begins, remarks = len(slam.filter) == 0, [remark]
    result = _filtered(log, slam, progress, recorder)
    if slam.config.smooth and begins:
        try:
            result = smooth(log, result, slam.config)
        except LogError as error:
            remarks.append(f"not {str(error).replace('smoothing:', 'smoothed:', 1)}")
    elif slam.config.smooth:
        remarks.append("not smoothed: the run began in a map")
    warning = result.warning
    if begins and not warning and not slam.landmarks.labeled.any():
        warning = map_warning(log, result.trajectory, result.map, result.association)
    warnings = filter(None, (slam.warning, warning, result.consistency.warning))
    slam.warning = "; ".join(dict.fromkeys(warnings))
    return replace(result, warning=warning, remark="; ".join(filter(None, remarks)))


def _filtered(
    log: LandmarkLog,
    slam: Slam,
    progress: Callable[[int, int], None] | None,
    recorder: Recorder | None,
) -> SlamResult:
    """The result of a filter over a log, without smoothing."""
    poses, k, culled_before = len(log.time), len(log.observation), slam.landmarks.culled
    odometry = dead_reckon(log, slam.config)
    pose, covariance = np.empty((poses, 3)), np.empty((poses, 3, 3))
    lost, rejected = np.zeros(poses, np.bool_), np.zeros(k, np.bool_)
    association, innovations = np.full(k, -1), new_innovations(k)  # association by ids
    hundredth, start = poses // 100 + 1, 0
    slam.num_steps = max(slam.num_steps - 1, 0)  # at the first pose it is already

    for i, scan in enumerate(scans_of(log, slam.config)):
        result = slam.process(scan)
        rows = slice(start, start := start + len(scan.z))
        pose[i], covariance[i], lost[i] = result.pose, result.covariance, result.lost
        association[rows], rejected[rows] = result.association, result.rejected
        innovations.value[rows] = result.innovations
        innovations.covariance[rows] = result.innovation_covariances
        innovations.nis[rows] = result.nis
        if slam.hypotheses.branching:  # another one may be the most probable now
            history = slam.hypotheses.best.history
            association[:start] = history[len(history) - start :]
        if recorder is not None:
            recorder.add(i, poses, slam, result.association, result.hypotheses)
        if progress is not None and (i % hundredth == 0 or i + 1 == poses):
            progress(i + 1, poses)

    nis = np.where(np.isnan(innovations.value).any(1), np.nan, innovations.nis)
    found = slam.map
    row = np.searchsorted(found.id, association).clip(max=max(len(found) - 1, 0))
    known = np.isin(association, found.id)
    association = np.where(known, row, -1)
    return SlamResult(
        trajectory=(filtered := Trajectory(log.time, pose, covariance)),
        filtered=filtered,
        map=_landmark_map(slam, log, association),
        ids=found.id,
        consistency=summarize(nis, rejected=float(rejected.sum()) / max(k, 1)),
        association=association,
        innovation=innovations.value,
        innovation_covariance=innovations.covariance,
        dead_reckoning=odometry,
        rejected=rejected,
        removed=slam.landmarks.culled - culled_before,
        warning=slam.landmarks.warning(association),
        odometry_bias=(bias := slam.filter.odometry_bias),
        bias_covariance=None if bias is None else slam.filter.marginal(found.id[:0])[3:, 3:],
        nonlinearity=slam.filter.nonlinearity,
        lost=lost,
        session=slam.landmarks.counts.session[slam.landmarks.in_map],
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
    config = replace(config, odometry_bias=(0.0, 0.0, 0.0))  # declared ones only
    slam = slam_for(blind, config)
    results = [slam.process(scan) for scan in scans_of(blind, config)]
    pose, covariance = (
        np.array([getattr(r, name) for r in results]) for name in ("pose", "covariance")
    )
    return Trajectory(log.time, pose, covariance)


def locate_start(slam: Slam, log: LandmarkLog) -> str:
    """Sets the first pose of a log in a map by its first scans, unless it is given.

    That is where it is unknown, or where the scans contradict the pose at which the map was saved.
    If no pose is certain, it stays unknown, or the last one.

    Returns:
        A remark where the scans contradict the last pose, else nothing.
    """
    if slam.start == "given":
        return ""
    unknown = slam.start == "unknown"
    try:
        pose, covariance = find_start(slam, log, anywhere=unknown)
    except LogError:
        return ""
    square = normalized_squared(pose_difference(pose, slam.pose), slam.pose_covariance + covariance)
    if not unknown and square < SAME_POSE:
        return ""
    slam.filter.reset_pose(pose, covariance)
    slam.start = "given"
    return "" if unknown else "the first scans contradict the last pose: the start was searched"


def find_start(
    slam: Slam, log: LandmarkLog, *, anywhere: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Find the first pose of a log in a map, by its first scans and their labels.

    This looks ahead to the scan that decides; `Relocalizer` finds a live robot at that scan.

    Args:
        slam: with the map, as `Slam.load` gives it.
        log: of which the first scans are used, as many as are needed.
        anywhere: whether the pose of the filter is no likelier than others; else it is one
            hypothesis, and several scans must agree.

    Returns:
        The first pose (3,) in the frame of the map, and its covariance (3, 3), which includes
        the uncertainty of the landmarks around.

    Raises:
        LogError: no pose is certain.
    """
    log = in_robot_frame(log)
    ekf, scans, best = slam.filter, 0, 0.0
    search = PoseSearch(ekf, ekf.ids, anywhere=False)
    if anywhere:
        search = PoseSearch(ekf, ekf.ids, anywhere=True, min_probability=START_PROBABILITY, scans=1)
    labels = slam.landmarks.landmarks_of(labels_of(log.landmark, log.text_names))
    whole = ~np.isnan(log.observation).any(1)
    for step in range(len(log.time)):
        if step > 0:
            search.predict(log.control[step - 1], log.control_covariance[step - 1])
        scan = (log.observation_pose == step) & whole
        if scans == (MAX_SCANS if anywhere else MAX_SCANS_AT_LAST):
            break
        if not scan.any():
            continue
        z, R = log.observation[scan], log.observation_covariance[scan]
        found = search.add(z, R, labels[scan])
        scans += 1
        best = float(found.probability[0]) if len(found) > 0 else best
        if search.is_found:
            association, covariance = found.association[0], found.covariance[0].copy()
            used = np.searchsorted(ekf.ids, association[association >= 0])
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


def _landmark_map(slam: Slam, log: LandmarkLog, association: IntArray) -> LandmarkMap:
    """The map; association (k,) by its rows."""
    found, used = slam.map, np.flatnonzero(association >= 0)
    label, text_names = number_labels(slam.landmarks.labels_of(found.id.tolist()), log.text_names)
    if (label < 0).all():  # a rule that does not use them
        landmark, first = np.unique(association[used], return_index=True)
        label[landmark] = log.landmark[used[first]]
    unlabeled = label < 0  # numbered in order, after the labels that are integers
    last = label[label < FIRST_TEXT].max(initial=-1)
    return LandmarkMap(
        id=np.where(unlabeled, last + np.cumsum(unlabeled), label),
        xy=found.xy,
        covariance=found.covariance,
        observations=np.bincount(association[used], minlength=len(found)),
        text_names=text_names,
    )
