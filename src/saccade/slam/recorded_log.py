"""EKF-SLAM on a landmark log."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import compress
from typing import Protocol

import numpy as np

from saccade.errors import ConfigError, LogError
from saccade.landmark_names import FIRST_TEXT, labels_of, number_labels
from saccade.plane import in_robot_frame, rotations
from saccade.slam.config import EkfConfig
from saccade.slam.consistency import normalized_squared, summarize
from saccade.slam.filter.predictions import new_innovations
from saccade.slam.filter.robot_models import pose_difference
from saccade.slam.kidnapping import MIN_CONTRADICTION
from saccade.slam.online import Slam
from saccade.slam.pose_search import PoseSearch
from saccade.slam.results import PoseHypotheses, SlamResult, check_diverged
from saccade.slam.scans import scans_of
from saccade.slam.smoothing import Prior, scale_disagreement, smooth
from saccade.types import (
    BoolArray,
    FloatArray,
    IntArray,
    LandmarkLog,
    LandmarkMap,
    Trajectory,
)

START_PROBABILITY = 0.99
"""Minimum probability of the first pose."""
MAX_START_SCANS = 50
"""Largest number of scans for the search of the first pose."""
MAX_SCANS_AT_LAST = 10
"""Largest number of scans for this search if the pose was saved with the map."""
SAME_LANDMARK = 9.0
"""Largest squared Mahalanobis distance of two landmarks that may be one."""
CONFIRMED_POSE = 16.0
"""Largest squared Mahalanobis distance of a found pose that confirms the saved pose."""


class Recorder(Protocol):
    """Records the growing map, as `saccade.viewing.snapshots.SnapshotRecorder` does."""

    def add(
        self,
        step: int,
        steps: int,
        slam: Slam,
        observed: IntArray,
        hypotheses: PoseHypotheses | None = None,
        covariance: FloatArray | None = None,
    ) -> object:
        """Called after the observations of each pose.

        Args:
            step: number of the pose.
            steps: number of poses.
            slam: SLAM at this pose.
            observed: (k,) ids of observed landmarks, negative for unused observations.
            hypotheses: hypotheses of the pose of a lost robot.
            covariance: (3, 3) of the pose; by default from the filter.
        """


def run(
    log: LandmarkLog,
    config: EkfConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    recorder: Recorder | None = None,
    initial: Slam | None = None,
) -> SlamResult:
    """Maps a landmark log: EKF-SLAM (C.1-C.18), then smoothing over the whole log.

    A filtered pose depends only on earlier measurements, a smoothed pose on the whole log.
    Candidates that are not confirmed at the end are left out of the map and of the association.

    Args:
        log: controls and observations.
        config: filter, association, noise, and whether to smooth (`EkfConfig.smooth`); by default
            `EkfConfig()`.
        progress: called about a hundred times with the number of filtered poses and of all poses.
        recorder: records snapshots of the growing map.
        initial: a `Slam` for the steps of the log, as from `Slam.load` or `slam_for`, in place of
            `config`; the first pose of the log is its present pose. By default the log begins a
            map.

    Returns:
        Trajectory and map, with `SlamResult.estimate` "smoothed" or "filtered"; consistency and
        association. A log that cannot be smoothed is filtered only; the reason is in
        `SlamResult.remark`.

    Raises:
        ConfigError: both `config` and `initial` are given.
        LogError: known association of a log without labels; or the estimate diverges at a pose.
    """
    if config is not None and initial is not None:
        raise ConfigError("config: expected none with `initial`, whose settings apply; found both")
    slam = initial or slam_for(log, config or EkfConfig())
    if slam.config.rule.accepts_all and (log.landmark < 0).all() and len(log.landmark):
        raise LogError(
            "association: expected nearest for a log without labels, found known; "
            "choose another association"
        )
    remark = locate_start(slam, log)
    log = replace(log, start=slam.filter.pose, odometry_bias=slam.odometry_bias)
    log = replace(log, range_errors=slam.range_errors)
    begins, remarks = len(slam.filter) == 0, [remark]
    known = slam.filter.ids
    prior = Prior.of_filter(slam.filter) if slam.config.smooth else None
    result = _filtered(log, slam, progress, recorder)
    if prior is not None:
        prior = prior.of_landmarks(np.isin(known, result.ids))
        try:
            result = smooth(log, result, slam.config, prior=prior)
        except LogError as error:
            remarks.append(f"not {str(error).replace('smoothing:', 'smoothed:', 1)}")
    warning = result.warning
    if begins and not warning and (log.landmark < 0).any():
        warning = _map_warning(log, result)
    warnings = filter(None, (slam.warning, warning, result.consistency.warning))
    slam.warning = "; ".join(dict.fromkeys(warnings))
    return replace(result, warning=warning, remark="; ".join(filter(None, remarks)))


def _map_warning(log: LandmarkLog, result: SlamResult) -> str:
    """Reasons why the map may be wrong; found by the diagnostics, which are loaded when needed."""
    diagnosis = import_module("saccade.diagnostics.reliability")
    warning: str = diagnosis.map_warning(log, result.trajectory, result.map, result.association)
    return warning


def _filtered(
    log: LandmarkLog,
    slam: Slam,
    progress: Callable[[int, int], None] | None,
    recorder: Recorder | None,
) -> SlamResult:
    """The result of filtering a log, without smoothing."""
    poses, k, culled_before = len(log.time), len(log.observation), slam.landmarks.culled
    odometry = dead_reckon(log, slam.config)
    pose, covariance = np.empty((poses, 3)), np.empty((poses, 3, 3))
    lost, rejected = np.zeros(poses, np.bool_), np.zeros(k, np.bool_)
    corrections = np.zeros((poses, 3))
    association, innovations = np.full(k, -1), new_innovations(k)  # the association has ids
    hundredth, start, begins, doubted = poses // 100 + 1, 0, len(slam.filter) == 0, 0
    slam.num_steps = max(slam.num_steps - 1, 0)  # the first pose of the log is its present pose

    for i, scan in enumerate(scans_of(log, slam.config)):
        result = slam.process(scan)
        rows = slice(start, start := start + len(scan.z))
        pose[i], covariance[i] = result.pose, result.covariance
        corrections[i] = slam.kidnapping.correction
        if result.lost:  # since the first scan of the evidence, the change point of the CUSUM
            lost[min(doubted, i) : i + 1] = True
        elif slam.kidnapping.evidence < MIN_CONTRADICTION:
            doubted = i + 1
        association[rows], rejected[rows] = result.association, result.rejected
        innovations.value[rows] = result.innovations
        innovations.covariance[rows] = result.innovation_covariances
        innovations.nis[rows] = result.nis
        if slam.hypotheses.branching:  # the best hypothesis may have changed
            history = slam.hypotheses.best.history
            association[:start] = history[len(history) - start :]
        if recorder is not None:
            recorder.add(i, poses, slam, result.association, result.hypotheses)
        if progress is not None and (i % hundredth == 0 or i + 1 == poses):
            progress(i + 1, poses)

    nis = np.where(np.isnan(innovations.value).any(1), np.nan, innovations.nis)
    if begins and slam.config.rule.uses_labels and not slam.config.rule.accepts_all:
        slam.remove(_misread(slam, log, association, lost))
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
        bias_covariance=None if bias is None else slam.filter.marginal(found.id[:0])[3:6, 3:6],
        range_errors=(errors := slam.filter.range_errors),
        range_error_covariance=(
            None if errors is None else slam.filter.marginal(found.id[:0])[-2:, -2:]
        ),
        scale_disagreement=scale_disagreement(
            slam.filter.robot_state[3:], slam.filter.marginal(found.id[:0])[3:, 3:]
        ),
        nonlinearity=slam.filter.nonlinearity,
        lost=lost,
        corrections=corrections,
        session=slam.landmarks.counts.session[slam.landmarks.in_map],
    )


def _misread(slam: Slam, log: LandmarkLog, association: IntArray, lost: BoolArray) -> IntArray:
    """Ids of landmarks beside another one whose label is rejected as often as not.

    Such a label is of no landmark; misread labels have put it onto another one.

    Args:
        slam: SLAM at the end of the log.
        log: observations.
        association: (k,) id of the landmark of each observation, -1 for none.
        lost: (t + 1,) poses without association.
    """
    labels = labels_of(log.landmark, log.text_names)
    total = Counter(compress(labels, ~lost[log.observation_pose]))
    used = Counter(zip(labels, association.tolist(), strict=True))
    ids, xy, covariance = slam.map.id, slam.map.xy, slam.map.covariance
    found = []
    for i, label in enumerate(slam.landmarks.labels_of(ids.tolist())):
        if label is not None and 2 * used[label, int(ids[i])] <= total[label]:
            nis = normalized_squared(xy - xy[i], covariance + covariance[i])
            if np.sum(nis < SAME_LANDMARK) > 1:
                found.append(ids[i])
    return np.array(found, np.int64)


def slam_for(log: LandmarkLog, config: EkfConfig = EkfConfig()) -> Slam:
    """A `Slam` for `run` on a log, with its start and systematic errors."""
    return Slam(
        config, start=log.start, odometry_bias=log.odometry_bias, range_errors=log.range_errors
    )


def dead_reckon(log: LandmarkLog, config: EkfConfig = EkfConfig()) -> Trajectory:
    """Dead reckoning: the trajectory by the controls alone, with its growing covariance."""
    config = replace(
        config, odometry_bias=(0.0, 0.0, 0.0), range_errors=(0.0, 0.0)
    )  # declared biases only
    ekf, poses = slam_for(log, config).filter, len(log.time)
    pose, covariance = np.empty((poses, 3)), np.empty((poses, 3, 3))
    for i, scan in enumerate(scans_of(log, config)):
        if scan.control is not None:
            ekf.predict(*scan.control, checked=True)
        pose[i], covariance[i] = ekf.pose, ekf.pose_covariance
        check_diverged(pose[i], covariance[i], i)
    return Trajectory(log.time, pose, covariance)


def locate_start(slam: Slam, log: LandmarkLog) -> str:
    """Sets the first pose of a log in a map by its first scans, unless it is given.

    An unknown pose is searched; the saved last pose is replaced if the scans contradict it. If no
    pose is certain, nothing changes.

    Returns:
        A remark if the scans contradict the last pose, else an empty string.
    """
    if slam.start == "given":
        return ""
    unknown = slam.start == "unknown"
    try:
        pose, covariance = find_start(slam, log, anywhere=unknown)
    except LogError:
        return ""
    square = normalized_squared(pose_difference(pose, slam.pose), slam.pose_covariance + covariance)
    if not unknown and square < CONFIRMED_POSE:
        return ""
    slam.filter.reset_pose(pose, covariance)
    slam.start = "given"
    return "" if unknown else "the first scans contradict the last pose: the start was searched"


def find_start(
    slam: Slam, log: LandmarkLog, *, anywhere: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Finds the first pose of a log in a map, by its first scans and their labels.

    The search is not causal; for a live robot, see `Slam.relocalize`.

    Args:
        slam: SLAM with the map, as from `Slam.load`.
        log: controls and observations; only as many scans as necessary are used.
        anywhere: whether the prior is uniform; else the pose of the filter is one hypothesis, and
            several scans must agree.

    Returns:
        The first pose (3,) in the frame of the map, and its covariance (3, 3), which includes
        the uncertainty of the landmarks.

    Raises:
        LogError: no pose is certain.
    """
    log = in_robot_frame(log)
    ekf, scans, best = slam.filter, 0, 0.0
    wrong = slam.kidnapping.landmark_evidence.wrong_label
    new_search = partial(PoseSearch, ekf, ekf.ids, anywhere=anywhere, wrong_label=wrong)
    search = new_search(min_probability=START_PROBABILITY, scans=1) if anywhere else new_search()
    labels = slam.landmarks.searched_for(slam.spell(labels_of(log.landmark, log.text_names)))
    whole = ~np.isnan(log.observation).any(1)
    for step in range(len(log.time)):
        if step > 0:
            search.predict(log.control[step - 1], log.control_covariance[step - 1])
        scan = (log.observation_pose == step) & whole
        if scans == (MAX_START_SCANS if anywhere else MAX_SCANS_AT_LAST):
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
            moved = dead_reckon(blind, EkfConfig(errors="standard"))
            assert moved.covariance is not None
            return _before(found.pose[0], covariance, moved.pose[step], moved.covariance[step])
    raise LogError(
        f"start: expected a pose in the map that is certain, found a probability of {best:.2f} "
        f"after {scans} scans; give the start"
    )


def _before(
    pose: FloatArray, C: FloatArray, moved: FloatArray, moved_covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pose and covariance before a motion (3,), with covariance, to a given pose."""
    heading = pose[2] - moved[2]
    R = rotations(heading)
    arm = R @ moved[:2]
    J, K = np.eye(3), np.zeros((3, 3))
    J[:2, 2] = arm[1], -arm[0]
    K[:2, :2], K[:2, 2], K[2, 2] = -R, [-arm[1], arm[0]], -1.0
    return np.append(pose[:2] - arm, heading), J @ C @ J.T + K @ moved_covariance @ K.T


def _landmark_map(slam: Slam, log: LandmarkLog, association: IntArray) -> LandmarkMap:
    """The map of a filter, given the association (k,) with its rows."""
    found, used = slam.map, np.flatnonzero(association >= 0)
    label, text_names = number_labels(slam.landmarks.labels_of(found.id.tolist()), log.text_names)
    if (label < 0).all():  # the association ignored labels
        landmark, first = np.unique(association[used], return_index=True)
        label[landmark] = log.landmark[used[first]]
    unlabeled = label < 0  # numbered in order, after the integer labels
    last = label[label < FIRST_TEXT].max(initial=-1)
    return LandmarkMap(
        id=np.where(unlabeled, last + np.cumsum(unlabeled), label),
        xy=found.xy,
        covariance=found.covariance,
        observations=np.bincount(association[used], minlength=len(found)),
        text_names=text_names,
    )
