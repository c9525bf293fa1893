"""EKF-SLAM step by step, for a live robot and for a whole log."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Literal, Self, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from saccade.errors import ConfigError, LogError, require
from saccade.landmark_names import Label, TagSpelling, label_array
from saccade.motions import Motion
from saccade.slam.association.labels import LabelAssociation
from saccade.slam.association.outcomes import DROPPED, NEW, UNUSED
from saccade.slam.association.partial import associate_partial
from saccade.slam.config import EkfConfig
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.validation import check_covariance
from saccade.slam.hypotheses import Hypotheses, Hypothesis
from saccade.slam.kidnapping import KidnappingDetector
from saccade.slam.landmarks import CullingPolicy, LandmarkTable, known_landmarks
from saccade.slam.map_file import SavedMap, read_map, write_map
from saccade.slam.pose_search import PoseSearch
from saccade.slam.results import PoseHypotheses, SlamMap, StepResult, check_diverged
from saccade.slam.scans import Scan, checked_scan
from saccade.slam.submap_choice import SubmapChoice
from saccade.types import FloatArray, IntArray, LandmarkMap

Start: TypeAlias = Literal["given", "last", "unknown"]
"""Pose at the first step of a session: given, the last pose of a saved filter, or unknown."""
MODES = ("continue", "localize")
"""Modes of a session in a saved map."""
START_SIGMA = (0.5, 0.5, 0.1)
"""Default standard deviations of a start in a map, in meters and radians."""


class Slam:
    """Causal EKF-SLAM, step by step; `run` takes a log through the same steps.

    Args:
        config: filter, association and noise.
        start: (3,) first pose, in the frame of the map; by default the origin or, with a map,
            unknown: then the robot is lost until its scans determine the pose.
        odometry_bias: standard deviations of systematic odometry errors, see `LandmarkLog`;
            by default `EkfConfig.odometry_bias`.
        range_errors: standard deviations of systematic errors of the ranges, see `LandmarkLog`;
            by default `EkfConfig.range_errors`.
        mode: "localize" adds and culls no landmarks; the estimates of mapped landmarks still
            change, according to their covariance.
        map: known landmarks, as from `datasets.load_map`, with -1 in `id` for landmarks without a
            label. The start then has the standard deviations `EkfConfig.start_sigma` or, if these
            are zero, half a meter and a tenth of a radian.
        motion: kind of the controls, a name in `saccade.motions.MOTIONS`, or a `Motion`; by default
            the first with the number of columns of a control: relative poses, or distance and turn.

    Raises:
        LogError: here and in `step`, an argument is not a number, not finite or of a wrong shape.
        ConfigError: unknown mode, or a map without landmarks.

    Examples:
        >>> import numpy as np
        >>> from saccade.slam import Slam
        >>> slam = Slam()
        >>> U, R = np.diag([0.02, 0.01]) ** 2, np.diag([0.1, 0.02]) ** 2
        >>> labels = [7, 9]
        >>> _ = slam.step(0.0, z=np.array([[4.0, 0.3], [6.0, -0.8]]), R=R, labels=labels)
        >>> slam.step(1.0, np.array([1.0, 0.0]), U, np.array([[3.1, 0.4], [5.3, -0.9]]), R, labels)
        StepResult(pose 1.00 -0.01 m -0.015 rad, 2 of 2 observations used)
        >>> slam.map.xy.round(1)
        array([[ 3.9,  1.2],
               [ 4.2, -4.3]])
    """

    def __init__(
        self,
        config: EkfConfig = EkfConfig(),
        *,
        start: FloatArray | tuple[float, float, float] | None = None,
        odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
        range_errors: tuple[float, float] = (0.0, 0.0),
        mode: Literal["continue", "localize"] = "continue",
        map: LandmarkMap | None = None,
        motion: str | Motion = "",
    ) -> None:
        require(mode in MODES, "mode", " or ".join(MODES), mode)
        by_odometry, by_range = config.systematic_sigmas(odometry_bias, range_errors)
        bias = by_odometry + by_range
        self.config, self.mode, self.odometry_bias = config, mode, odometry_bias
        self.range_errors = range_errors
        self.motion = motion
        ekf = EkfSlam(
            np.concatenate([np.zeros(3) if start is None else start, np.zeros(len(bias))]),
            np.diag(np.square([*config.start_sigma, *bias])),
            errors=config.errors,
            huber=config.huber,
        )
        adds, all_accepted = mode == "continue", config.rule.accepts_all
        policy = CullingPolicy(
            adds and not all_accepted,
            config.confirm_after,
            config.candidate_scans,
            config.culling_ratio or 0.0,
        )
        self.hypotheses = Hypotheses(
            *(Hypothesis(ekf, LandmarkTable(policy)), config.gate, config.new_gate, config.huber),
            max_hypotheses=config.max_hypotheses,
        )
        """Association hypotheses; `filter` and `landmarks` belong to the most probable one."""
        self.association = LabelAssociation(config)
        """Association rule of a single hypothesis."""
        self.kidnapping = KidnappingDetector(
            config.recover,
            config.new_gate,
            standing=mode == "localize",
            label_gate=config.label_gate,
        )
        """Test of the estimated pose, and search for the pose of a lost robot."""
        self.num_steps = 0
        """Number of steps so far."""
        self.warning = ""
        """Reason why the map may be wrong, set by `run`; empty without one."""
        gate = float("inf") if all_accepted else chi_square_gate(2, config.new_gate)
        self._submaps = SubmapChoice(config.submaps, gate)
        self._may_branch = config.rule.may_branch and adds and config.max_hypotheses > 1
        self._uses_labels = config.rule.uses_labels
        self._time = -np.inf
        self._spelling: TagSpelling | None = None
        self.start: Start = "given" if map is None or start is not None else "unknown"
        """Kind of the pose at the first step of the session."""
        if map is not None:
            require(len(map) > 0, "map", "landmarks", "none")
            self.landmarks.adopt(known_landmarks(map))
            C = np.zeros((len(map), 2, 2)) if map.covariance is None else map.covariance
            self._set_map(map.xy, block_diag(*C))

    def _set_map(self, xy: FloatArray, P: FloatArray, covariance: FloatArray | None = None) -> None:
        """Gives the landmarks of the table positions xy (N, 2) with covariance P (2N, 2N).

        The pose is independent of the landmarks; its default covariance is `EkfConfig.start_sigma`
        or, if this is zero, `START_SIGMA`.
        """
        robot = self.filter.covariance
        if covariance is None and not any(self.config.start_sigma):
            covariance = np.diag(np.square(START_SIGMA))
        if covariance is not None:
            robot[:3, :3] = check_covariance("covariance of the start", covariance, 3)
        mean = np.concatenate([self.filter.robot_state, xy.ravel()])
        lever = np.zeros(len(mean))
        self.filter.set_gaussian(mean, block_diag(robot, P), self.landmarks.counts.id, lever)

    @property
    def filter(self) -> EkfSlam:
        """Filter of the most probable hypothesis."""
        return self.hypotheses.best.ekf

    @property
    def landmarks(self) -> LandmarkTable:
        """Counts and labels of all landmarks of the filter, candidates too."""
        return self.hypotheses.best.table

    @property
    def pose(self) -> FloatArray:
        """(3,) x, y in meters, heading in radians: the mean over the association hypotheses."""
        return self.hypotheses.pose[0]

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3) of the pose, with the differences between the hypotheses."""
        return self.hypotheses.pose[1]

    @property
    def map(self) -> SlamMap:
        """Landmarks of the map, without candidates."""
        ekf, kept = self.filter, self.landmarks.in_map
        ids = ekf.ids[kept]
        labels = label_array(self.landmarks.labels_of(ids.tolist()))
        return SlamMap(ids, labels, ekf.landmarks[kept], ekf.landmark_covariances[kept])

    def step(
        self,
        time: float,
        control: FloatArray | None = None,
        U: FloatArray | None = None,
        z: FloatArray | None = None,
        R: FloatArray | None = None,
        labels: npt.ArrayLike | None = None,
    ) -> StepResult:
        """Moves to the next pose and processes the scan that is observed there.

        Args:
            time: time of the pose, in any unit; not earlier than in the last step.
            control: (c,) from the last pose to this one, of the motion of the session; None where
                the robot has not moved, as at the first pose.
            U: (c, c) its covariance.
            z: (k, 2) range in meters, bearing in radians within 2 pi; None without observations.
                NaN for a missing range or bearing: such an observation updates a landmark of the
                map, and adds none.
            R: (k, 2, 2) their covariances, or (2, 2) one for all.
            labels: (k,) labels of the landmarks, integers from 0 on or text, -1 or "" where
                unknown; compared with the map, and rejected if they contradict it, unless the
                association rule accepts all.

        Returns:
            Pose, association and innovations.

        Raises:
            LogError: the estimate diverged; or an argument is invalid, and nothing has changed.
        """
        scan = checked_scan(self.config, time, control, U, z, R, labels, self.motion)
        if scan.time < self._time:
            raise LogError(f"time: expected {self._time:g} or later, found {scan.time:g}")
        return self.process(scan)

    def process(self, scan: Scan) -> StepResult:
        """`step` with a valid scan.

        Raises:
            LogError: the estimate diverged; names the step.
        """
        if len(scan.z) > 0:
            labels = self.spell(scan.labels) if self._uses_labels else [None] * len(scan.z)
            scan = scan._replace(labels=labels)
        if self.start == "unknown" and not self.kidnapping.lost:
            self.kidnapping.begin(self._search_anywhere(self.landmarks.counts.id))
        self.start = "given"
        self._prepare(scan)
        result = self._step(scan)
        check_diverged(result.pose, result.covariance, self.num_steps)
        self._time, self.num_steps = scan.time, self.num_steps + 1
        return result

    def _search_anywhere(self, landmarks: IntArray) -> PoseSearch:
        """A search of an unknown pose among landmarks, by their ids."""
        wrong = self.kidnapping.landmark_evidence.wrong_label
        return PoseSearch(self.filter, landmarks, anywhere=True, wrong_label=wrong)

    def _step(self, scan: Scan) -> StepResult:
        """One step of EKF-SLAM, in the order of appendix C."""
        self.hypotheses.predict(scan)  # C.5-C.9
        self.kidnapping.update(self.filter, self.landmarks, scan.complete)  # for and against
        self._relocalize(scan)  # if lost
        for hypothesis, matches in self._associate(scan):  # labels, gates; none while contradicted
            hypothesis.update(scan, matches)  # C.10-C.14
            hypothesis.augment(scan)  # C.15-C.18
            hypothesis.count()  # confirm, cull
        self.hypotheses.reduce(scan)  # join, prune
        return self._result(scan)

    def _prepare(self, scan: Scan) -> None:
        """Chooses hypotheses and submap of a step."""
        self._choose_hypotheses(scan)
        ekf, table, max_range = self.filter, self.landmarks, 0.0
        if self.kidnapping.enabled or (table.policy.enabled and table.has_unlabeled):
            max_range = max(table.max_range, 0.0)
        self._submaps.update(ekf, table, scan, max_range)

    def _choose_hypotheses(self, scan: Scan) -> None:
        """Enables several hypotheses while the map is small and no observation has a label."""
        if len(scan.z) == 0 or not self._may_branch:
            return
        hypotheses = self.hypotheses
        begins = len(self.filter) == 0 and self.landmarks.scans == 0
        if not (hypotheses.branching or begins):
            return
        labeled = any(label is not None for label in scan.labels)
        if hypotheses.branching and (labeled or hypotheses.is_large):
            hypotheses.keep_best()
        elif begins and not labeled:
            hypotheses.branching = self.landmarks.has_unlabeled = True

    def _relocalize(self, scan: Scan) -> None:
        """Searches the pose of a lost robot."""
        kidnapping = self.kidnapping
        if kidnapping.lost or (kidnapping.contradicted and kidnapping.kidnapped):
            self.hypotheses.keep_best()
            best = self.hypotheses.best
            found = kidnapping.relocalize(best.ekf, best.table, scan.complete)
            best.matches = _spread(found, scan)

    def _associate(self, scan: Scan) -> list[tuple[Hypothesis, IntArray]]:
        """Hypotheses to update, with (k,) the id of the landmark of each observation in each.

        Ids may be `NEW` or `DROPPED`. There are no hypotheses if the scan must not update the map.
        """
        best, branching = self.hypotheses.best, self.hypotheses.branching
        if len(scan.z) == 0 or self.kidnapping.blocks_update:
            followed = []
        elif branching:
            seen = scan.complete
            split = self.hypotheses.branch(seen) if len(seen.z) > 0 else []
            followed = [(hypothesis, _spread(matches, scan)) for hypothesis, matches in split]
        else:
            seen = scan.complete
            matches = self.association(best.ekf, best.table, seen.z, seen.R, seen.labels)
            matches = self._known(matches) if self.mode == "localize" else matches
            followed = [(best, self._with_partial(scan, matches))]
        return followed

    def _with_partial(self, scan: Scan, matches: IntArray) -> IntArray:
        """(k,) matches of all observations of a scan, given matches of the complete ones."""
        if scan.missing is None:
            return matches
        partial, rule, best = scan.partial, self.association, self.hypotheses.best
        found, rejected = associate_partial(
            self.config, best.ekf, best.table, scan.part(partial), matches[matches >= 0]
        )
        every, rule_rejected = _spread(matches, scan), np.zeros(len(partial), np.bool_)
        every[partial], rule_rejected[partial] = found, rejected
        if len(rule.rejected) == len(matches):
            rule_rejected[~partial] = rule.rejected
        rule.rejected = rule_rejected
        return every

    def _known(self, matches: IntArray) -> IntArray:
        """Matches (k,) without new landmarks, whose labels are withdrawn."""
        next_id = self.filter.next_id
        for record in self.landmarks.labels.values():
            if record.landmark >= next_id:
                record.landmark = -1
        return np.where((matches == NEW) | (matches >= next_id), DROPPED, matches)

    def _result(self, scan: Scan) -> StepResult:
        """The result of a step."""
        best, rejected = self.hypotheses.best, self.association.rejected
        if scan.missing is not None:
            best.innovations.value[scan.missing] = np.nan
        if not best.updated or self.hypotheses.branching or len(rejected) != len(scan.z):
            rejected = np.zeros(len(scan.z), np.bool_)
        return StepResult(
            *self.hypotheses.pose,
            np.maximum(best.matches, -1) if len(scan.z) > 0 else best.matches,
            *best.innovations,
            rejected,
            best.culled,
            self.kidnapping.lost,
            self.kidnapping.hypotheses,
        )

    def remove(self, landmarks: IntArray) -> None:
        """Removes landmarks (g,), by their ids."""
        if len(landmarks) > 0:
            self.hypotheses.best.remove(landmarks)

    def remove_candidates(self) -> None:
        """Removes the landmarks that are not in the map."""
        self.remove(self.landmarks.counts.id[~self.landmarks.in_map])

    def relocalize(
        self, z: FloatArray, R: FloatArray, labels: npt.ArrayLike | None = None
    ) -> PoseHypotheses:
        """Searches the pose of a robot that is anywhere in the map, by the scan at its pose.

        The robot counts as lost from then on: later steps leave the map unchanged and reduce the
        hypotheses until one is left, which sets the pose. Another call adds a scan of the same
        pose.

        Args:
            z: (k, 2) range in meters, bearing in radians.
            R: (k, 2, 2) their covariances, or (2, 2) one for all.
            labels: (k,) labels of the landmarks, as in `step`.

        Returns:
            Hypotheses of the pose with probabilities; `association` has ids of landmarks.

        Raises:
            ConfigError: the map has no landmarks.
            LogError: an argument is invalid.
        """
        scan = checked_scan(self.config, max(self._time, 0.0), None, None, z, R, labels)
        table = self.landmarks
        require(bool(table.in_map.any()), "map", "landmarks to find the robot among", "none")
        if self.kidnapping.search is None:
            self.kidnapping.begin(self._search_anywhere(table.counts.id[table.in_map]))
        assert self.kidnapping.search is not None
        seen = scan.complete
        landmarks = table.searched_for(self.spell(seen.labels))
        return self.kidnapping.search.add(seen.z, seen.R, landmarks)

    def spell(self, labels: Sequence[Label | None]) -> list[Label | None]:
        """Labels (k,) as the given or loaded map spells them; see `TagSpelling`."""
        if self._spelling is None:
            self._spelling = TagSpelling(self.landmarks.labels)
        return self._spelling.resolve(labels)

    def save(self, path: str | Path) -> None:
        """Saves the map of the most probable hypothesis as one file, for `load`.

        Raises:
            ConfigError: the mode is "localize".
            OutputError: the file cannot be written; an existing file stays.
        """
        if self.mode == "localize":
            raise ConfigError("mode: expected continue for a map to be saved, found localize")
        self.filter.leave()
        mean = self.filter.state
        write_map(
            path,
            SavedMap(
                settings={**asdict(self.config), "association": self.config.rule.name_in_file},
                odometry_bias=self.odometry_bias,
                range_errors=self.range_errors,
                warning=self.warning,
                num_steps=self.num_steps,
                time=self._time,
                mean=mean,
                covariance=self.filter.covariance,
                heading_lever=self.filter.active.heading_lever[: len(mean)],
                table=self.landmarks,
            ),
        )

    @classmethod
    def load(
        cls,
        path: str | Path,
        mode: Literal["continue", "localize"] = "continue",
        config: EkfConfig | None = None,
        *,
        start: FloatArray | tuple[float, float, float] | None = None,
        covariance: FloatArray | None = None,
        odometry_bias: tuple[float, float, float] | None = None,
        range_errors: tuple[float, float] | None = None,
    ) -> Self:
        """Loads a map that `save` wrote, and begins a session in it.

        Args:
            path: the map file.
            mode: "continue" mapping, or "localize", which adds and culls no landmarks.
            config: settings in place of the saved ones, with the same `errors`.
            start: (3,) pose in the frame of the map, independent of the map; times of steps begin
                anew. By default the robot has not moved since, and no step may be earlier than the
                last saved step.
            covariance: (3, 3) of the start; by default from `EkfConfig.start_sigma` or, if this is
                zero, half a meter and a tenth of a radian.
            odometry_bias: with a start, as in `Slam`; by default as saved.
            range_errors: with a start, as in `Slam`; by default as saved.

        Raises:
            LogError: the file is unreadable, damaged, not a map, or has a different format version.
            ConfigError: the settings do not match the map.
        """
        saved = read_map(path)
        settings, errors = config or saved.config, saved.settings["errors"]
        require(settings.errors == errors, "errors", f"{errors!r}, as in {path}", settings.errors)
        if start is None or odometry_bias is None:
            odometry_bias = saved.odometry_bias
        if start is None or range_errors is None:
            range_errors = saved.range_errors
        slam = cls(
            settings,
            start=start,
            odometry_bias=odometry_bias,
            range_errors=range_errors,
            mode=mode,
        )
        size, r = len(slam.filter.robot_state), len(saved.mean) - 2 * len(saved.table)
        slam.landmarks.adopt(saved.table)
        slam.warning = saved.warning
        if start is None:
            as_saved = f"{r > 3}, as in {path}"
            require(size == r, "estimate_systematic_errors", as_saved, size > 3)
            slam.num_steps, slam._time = saved.num_steps, saved.time
            ids = saved.table.counts.id
            slam.filter.set_gaussian(saved.mean, saved.covariance, ids, saved.heading_lever)
            slam.start = "last"
        else:
            slam._set_map(saved.mean[r:].reshape(-1, 2), saved.covariance[r:, r:], covariance)
        if start is not None or mode == "localize":
            slam.remove_candidates()
        return slam

    def __repr__(self) -> str:
        return f"Slam({self.num_steps} steps, {self.filter!r})"


def _spread(matches: IntArray, scan: Scan) -> IntArray:
    """(k,) matches of a scan: given ones for complete observations, `UNUSED` for partial ones."""
    if scan.missing is None:
        return matches
    every = np.full(len(scan.z), UNUSED)
    every[~scan.partial] = matches
    return every
