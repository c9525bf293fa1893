"""EKF-SLAM step by step: the one loop of the filter, for a live robot and for a whole log."""

from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from saccade.errors import ConfigError, LogError, require
from saccade.io.checkpoint import Arrays, Stateful, arrays_of, merge, select
from saccade.landmark_names import name_texts, number_names, renumber, stored_texts
from saccade.slam.association._kernels import DROPPED, NEW
from saccade.slam.association.identities import Association
from saccade.slam.config import RETRACTIONS, EkfConfig
from saccade.slam.consistency import chi_square_gate
from saccade.slam.culling import Culling, numbers_of_kept
from saccade.slam.filter._range_bearing_kernels import Innovations
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.models import new_innovations
from saccade.slam.filter.validation import (
    MIN_SIGMA,
    as_array,
    as_number,
    as_numbers,
    check_covariance,
    check_noise,
    check_range_bearing,
    require_shape,
)
from saccade.slam.hypotheses import Hypotheses, Hypothesis
from saccade.slam.local_map_choice import LocalMapChoice
from saccade.slam.map_file import read_map, write_map
from saccade.slam.recovery import Recovery
from saccade.slam.results import PoseHypotheses, StepResult, check_diverged
from saccade.slam.scans import NO_SCAN, Scan
from saccade.types import BoolArray, FloatArray, IntArray

MODES = ("continue", "localize")
"""What a robot does with a map that was saved."""
START_SIGMA = (0.5, 0.5, 0.1)
"""Metres and radians: standard deviation of a start in a map, if neither it nor the settings say
one."""
NONE = np.empty(0, np.int64)
"""No landmarks."""
NOTHING_OBSERVED = NONE, *new_innovations(0), np.zeros(0, np.bool_), NONE
"""Fields of `StepResult` from the association on, of a step without observations."""


class Slam:
    """EKF-SLAM step by step, without knowledge of what comes later.

    `run` takes a log through the same steps.

    Args:
        config: filter, association and noise.
        start: (3,) first pose.
        odometry_bias: standard deviations of systematic odometry errors, see `LandmarkLog`.
        mode: "localize" adds and culls no landmarks; the estimates of those in the map (see `load`)
            still change, as their covariance lets them.

    Raises:
        LogError: here and in `step`, an argument that is no number, not finite or of another shape.
        ConfigError: a mode that there is not.

    Examples:
        >>> import numpy as np
        >>> from saccade.slam import Slam
        >>> slam = Slam()
        >>> U, R = np.diag([0.02, 0.01]) ** 2, np.tile(np.diag([0.1, 0.02]) ** 2, (2, 1, 1))
        >>> names = np.array([7, 9])
        >>> _ = slam.step(0.0, z=np.array([[4.0, 0.3], [6.0, -0.8]]), R=R, names=names)
        >>> slam.step(1.0, np.array([1.0, 0.0]), U, np.array([[3.1, 0.4], [5.3, -0.9]]), R, names)
        StepResult(pose 1.00 -0.00 m -0.004 rad, 2 of 2 observations used)
        >>> slam.ekf.landmarks.round(1)
        array([[ 3.8,  1.2],
               [ 4.2, -4.2]])
    """

    def __init__(
        self,
        config: EkfConfig = EkfConfig(),
        *,
        start: FloatArray | tuple[float, float, float] = (0.0, 0.0, 0.0),
        odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
        mode: Literal["continue", "localize"] = "continue",
    ) -> None:
        require(mode in MODES, "mode", " or ".join(MODES), mode)
        estimated = config.estimate_odometry_bias and any(odometry_bias)
        bias = odometry_bias if estimated else ()
        self.config = config
        ekf = EkfSlam(
            np.concatenate([start, np.zeros(len(bias))]),
            np.diag(np.square([*config.start_sigma, *bias])),
            retraction=RETRACTIONS[config.filter],
            huber=config.huber,
        )
        self.associate = Association(config)
        """The association rule."""
        self.mode = mode
        adds = mode == "continue"
        doubted = adds and config.association != "known"
        culling = Culling(
            doubted, config.confirm_after, config.candidate_scans, config.culling_ratio
        )
        self.recovery = Recovery(config.recover, config.new_gate)
        gate = (
            float("inf") if config.association == "known" else chi_square_gate(2, config.new_gate)
        )
        self._choice = LocalMapChoice(config.submaps, gate)
        several = config.association in ("auto", "multiple")
        self._may_branch = several and adds and config.max_hypotheses > 1
        self.hypotheses = Hypotheses(
            *(Hypothesis(ekf, culling), config.gate, config.new_gate, config.huber),
            most=config.max_hypotheses,
        )
        """The association hypotheses, of which `ekf` and `culling` are the most probable one's."""
        self.num_steps = 0
        """Steps that were taken."""
        self._time = -np.inf
        self.text_names: tuple[str, ...] = ()
        """Names of landmarks that are text; `identities` has their numbers."""
        self.sessions = [0]
        """Landmarks that were added to the map before each session, which `load` begins."""
        self.descriptors: npt.NDArray[Any] | None = None
        """(m, d) of the first m landmarks, if their user gives any; removed with the landmarks."""
        self._odometry_bias = odometry_bias

    @property
    def ekf(self) -> EkfSlam:
        """The filter."""
        return self.hypotheses.best.ekf

    @property
    def culling(self) -> Culling:
        """The counts of its landmarks."""
        return self.hypotheses.best.culling

    def step(
        self,
        time: float,
        control: FloatArray | None = None,
        U: FloatArray | None = None,
        z: FloatArray | None = None,
        R: FloatArray | None = None,
        names: npt.ArrayLike | None = None,
    ) -> StepResult:
        """Move to the next pose and process the scan that is observed there.

        Args:
            time: of the pose, in any unit; not before that of the last step.
            control: (c,) from the last pose to this one: distance and turn (`turn_then_translate`)
                or forward, left and turn (`compose`); None where the robot has not moved, as at the
                first pose.
            U: (c, c) its covariance.
            z: (k, 2) range in metres, bearing in radians within 2 pi; None without observations.
            R: (k, 2, 2) their covariances.
            names: (k,) landmark names, integers from 0 on or text, -1 or "" where unknown; compared
                with the map, and not believed if they contradict it, unless
                `EkfConfig.association` is "known".

        Returns:
            Pose, association and innovations.

        Raises:
            LogError: the estimate diverged, or an argument is invalid; then nothing has changed.
        """
        scan, text_names = self._validated(time, control, U, z, R, names)
        result = self.process(scan)
        self._time, self.text_names = scan.time, text_names
        return result

    def _validated(
        self,
        time: object,
        control: npt.ArrayLike | None,
        U: npt.ArrayLike | None,
        z: npt.ArrayLike | None,
        R: npt.ArrayLike | None,
        names: npt.ArrayLike | None,
    ) -> tuple[Scan, tuple[str, ...]]:
        """The arguments of `step`, copied, and the table of the names that are text."""
        seconds, motion, text_names = as_number("time", time), None, self.text_names
        if seconds < self._time:
            raise LogError(f"time: expected {self._time:g} or later, found {seconds:g}")
        if control is not None:
            c = 3 if np.size(control) == 3 else 2
            u = np.array(as_array("control", (c,), control), np.float64)
            U = np.array(as_array("covariance of the control", (c, c), U), np.float64)
            check_noise("control", u[None], U[None], self.config.motion_noise_scale**2)
            motion = u, U
        z = np.empty((0, 2)) if z is None else np.atleast_1d(as_numbers("observations", z))
        k = len(z)
        identity = np.full(k, -1)
        if names is not None:
            identity, text_names = number_names(names, text_names)
            require_shape("names", (k,), identity)
        z = as_array("observations", (k, 2), z).astype(np.float64)
        R = as_array("covariances of the observations", (k, 2, 2), R).astype(np.float64)
        if k == 0:
            return Scan(seconds, motion, *NO_SCAN), text_names
        check_range_bearing(z)
        check_noise("observation", z, R, self.config.sensor_noise_scale**2, MIN_SIGMA)
        return Scan(seconds, motion, z, R, identity.astype(np.int64)), text_names

    def number(self, numbers: IntArray, text_names: tuple[str, ...]) -> IntArray:
        """Numbers (k,) that names have here, where those that are text come from another table."""
        numbers, self.text_names = renumber(numbers, text_names, self.text_names)
        return numbers

    def process(self, scan: Scan) -> StepResult:
        """Take one step: the loop of the filter, in the order of appendix C.

        Raises:
            LogError: the estimate diverged; names the step.
        """
        if self.config.association not in ("auto", "known"):
            scan = scan._replace(names=np.full(len(scan.z), -1))
        named, ekf, k = self.known_landmarks(scan.names), self.ekf, len(scan.z)
        rule, may_cull = self.associate, self.culling.enabled and self.associate.has_unnamed
        self._choose_hypotheses(scan)
        expects = self.recovery.rule.enabled or may_cull
        reach = max(self.culling.reach, 0.0) if expects else 0.0
        self._choice.choose_view(ekf, scan, named, reach)
        self.hypotheses.predict(scan)  # C.5-C.9
        if self.recovery.lost:
            return self._result(scan, self.recovery.follow(ekf, self.culling, scan, named))
        if k == 0:
            return self._result(scan, NONE)
        if self.recovery.contradicts(ekf, self.culling, scan, named):
            self.hypotheses.leave_out(k)
            if self.recovery.begin_if_lost(ekf, self.confirmed, scan, named):
                self.hypotheses.settle()
            return self._result(scan, np.full(k, -1))
        if self.hypotheses.branching:
            self.hypotheses.branch(scan.z, scan.R)
            best = self.hypotheses.best
            return self._result(scan, best.association[-k:].copy(), best.innovations, best.culled)
        association = self._associate(scan)
        best = self.hypotheses.best
        missed = best.observe(scan.z, scan.R, association, may_cull=rule.has_unnamed)  # C.10-C.18
        culled = self._cull(missed, association)
        return self._result(scan, association, best.innovations, culled)

    def _choose_hypotheses(self, scan: Scan) -> None:
        """Follow alternatives from the first scan on, while the map is small.

        With "auto", while no observation has an identity.
        """
        if len(scan.z) == 0 or not self._may_branch:
            return
        hypotheses = self.hypotheses
        begins = len(self.ekf) == 0 and self.culling.scans == 0
        if not (hypotheses.branching or begins):
            return
        identified = self.config.association == "auto" and bool(scan.names.max() >= 0)
        if hypotheses.branching and (identified or hypotheses.is_large):
            hypotheses.settle()
            self.associate.has_unnamed = True
        elif begins and not identified:
            hypotheses.branching = True

    def _associate(self, scan: Scan) -> IntArray:
        """(k,) landmark of each observation, `NEW` or `DROPPED`."""
        if self.culling.enabled:
            self.ekf.confirmed_in_view = self.culling.confirmed_in_view(self.ekf)
        association = np.array(self.associate(self.ekf, scan.z, scan.R, scan.names), np.int64)
        if self.mode == "localize":
            association[(association == NEW) | (association >= len(self.ekf))] = DROPPED
            self.associate.forget_from(len(self.ekf))
        return association

    def _cull(self, missed: IntArray, association: IntArray) -> IntArray:
        """Remove (g,) landmarks that are missed often, or whose identity has left them."""
        stale = self.associate.stale
        if len(missed) == 0 and len(stale) == 0:
            return NONE
        self.culling.keep(missed[self.identities[missed] >= 0])
        culled = self.culling.remove_culled(np.array(stale, np.int64))
        if len(culled) > 0:
            self.remove(culled, association)
        return culled

    def _result(
        self,
        scan: Scan,
        association: IntArray,
        innovations: Innovations | None = None,
        culled: IntArray = NONE,
    ) -> StepResult:
        """The result of a step; counts it."""
        lost, (pose, covariance) = self.recovery.lost, self.hypotheses.pose
        check_diverged(pose, self.num_steps)
        self.num_steps += 1
        alive, found = len(self.hypotheses.alive), self.recovery.hypotheses
        if len(scan.z) == 0:
            return StepResult(pose, covariance, *NOTHING_OBSERVED, lost, found, alive)
        refused = self.associate.refused
        if self.hypotheses.branching or innovations is None or len(refused) == 0:
            refused = np.zeros(len(scan.z), np.bool_)
        return StepResult(
            pose,
            covariance,
            np.maximum(association, -1),
            *(innovations or new_innovations(len(scan.z))),
            refused,
            culled,
            lost,
            found,
            alive,
        )

    def remove(self, landmarks: IntArray, association: IntArray = NONE) -> None:
        """Remove landmarks (g,) from the filter, and from an association (k,) in place."""
        kept = np.ones(len(self.ekf), np.bool_)
        kept[landmarks] = False
        number = numbers_of_kept(kept)
        used = association >= 0
        association[used] = number[association[used]]
        self.ekf.remove(landmarks)
        self.associate.removed(number)
        if self.descriptors is not None:
            self.descriptors = self.descriptors[kept[: len(self.descriptors)]]

    def renumber(self, association: IntArray, result: StepResult) -> None:
        """Bring the associations (k,) of earlier steps up to date with a step, in place.

        Of several hypotheses, they become those of the one that is now the most probable.
        """
        if self.hypotheses.branching:
            m, found = len(result.association), self.hypotheses.best.association
            association[:] = found[len(found) - m - len(association) : len(found) - m]
            return
        if len(result.culled) > 0:
            kept = np.ones(len(self.ekf) + len(result.culled), np.bool_)
            kept[result.culled] = False
            association[:] = numbers_of_kept(kept)[association]

    def known_landmarks(self, identity: IntArray) -> IntArray:
        """(k,) landmark of the map that each observation names, -1 for none."""
        if len(identity) == 0:
            return NONE
        return np.array(self.associate.landmarks(identity.tolist()), np.int64)

    def relocalize(
        self, z: FloatArray, R: FloatArray, names: npt.ArrayLike | None = None
    ) -> PoseHypotheses:
        """Search the pose of a robot that is anywhere in the map, by the scan at its pose.

        The robot counts as lost from then on: the steps that follow keep the map as it is, and
        narrow the hypotheses down until one is left, which sets the pose. Called again, it adds a
        scan of the same pose.

        Args:
            z: (k, 2) range in metres, bearing in radians.
            R: (k, 2, 2) their covariances.
            names: (k,) landmark identities, as of `step`.

        Returns:
            Hypotheses of the pose with probabilities; `association` has numbers of landmarks.

        Raises:
            ConfigError: the map has no landmarks.
            LogError: an argument is invalid.
        """
        confirmed = self.confirmed
        scan, _ = self._validated(max(self._time, 0.0), None, None, z, R, names)
        require(bool(confirmed.any()), "map", "landmarks to find the robot among", "none")
        return self.recovery.locate(self.ekf, confirmed, scan, self.known_landmarks(scan.names))

    def save(self, path: str | Path) -> None:
        """Save the whole state as a map file, for `load`.

        Raises:
            ConfigError: the mode is "localize", or a part has a state that cannot be saved.
            OutputError: the file cannot be written; an old one stays.
        """
        if self.mode == "localize":
            raise ConfigError("mode: expected continue for a map to be saved, found localize")
        arrays = self.to_arrays() | self._session_arrays()
        write_map(path, self.config, self._odometry_bias, arrays)

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
    ) -> Self:
        """Load a map that `save` wrote, and begin a session in it.

        Args:
            path: the map file.
            mode: "continue" mapping, or "localize", which adds and culls no landmarks.
            config: other settings than those saved, with the same `filter`.
            start: (3,) pose in the frame of the map, independent of the map. By default the robot
                has not moved since: all goes on as if there were no file between.
            covariance: (3, 3) of the start; by default that of `EkfConfig.start_sigma` or, where
                this is zero, of `START_SIGMA`: half a meter and a tenth of a radian.
            odometry_bias: with a start, as for `Slam`; by default as saved.

        Raises:
            LogError: the file cannot be read, is damaged, no map, or of a later version.
            ConfigError: the settings do not suit the map.
        """
        saved, saved_bias, arrays = read_map(path)
        settings = config or saved
        same = settings.filter == saved.filter
        require(same, "filter", f"{saved.filter!r}, as in {path}", settings.filter)
        if start is None or odometry_bias is None:
            odometry_bias = saved_bias
        slam = cls(
            settings,
            start=(0.0, 0.0, 0.0) if start is None else start,
            odometry_bias=odometry_bias,
            mode=mode,
        )
        if start is None:
            size, robot_size = len(slam.ekf.robot_state), int(arrays["robot_size"])
            as_saved = f"{robot_size > 3}, as in {path}"
            require(size == robot_size, "estimate_odometry_bias", as_saved, size > 3)
            slam.from_arrays(arrays)
        else:
            slam._take_map(arrays, covariance)
        if start is not None or mode == "localize":
            slam.remove_candidates()
        slam.text_names = stored_texts(arrays)
        slam.sessions = [*arrays["sessions"].tolist(), slam.ekf.num_added]
        slam.descriptors = arrays.get("descriptors")
        return slam

    def _take_map(self, arrays: Arrays, covariance: FloatArray | None) -> None:
        """Take the landmarks of a saved map, independent of the robot."""
        P = self.ekf.covariance
        if covariance is None and not any(self.config.start_sigma):
            covariance = np.diag(np.square(START_SIGMA))
        if covariance is not None:
            P[:3, :3] = check_covariance("covariance of the start", covariance, 3)
        best, r = select(arrays, "hypotheses.0"), int(arrays["robot_size"])
        other = EkfSlam(np.zeros(r), np.zeros((r, r)), retraction=RETRACTIONS[self.config.filter])
        other.from_arrays(select(best, "ekf"))
        mean = np.concatenate([self.ekf.robot_state, other.state[r:]])
        self.ekf.set_gaussian(mean, block_diag(P, other.covariance[r:, r:]), other.ids)
        self.associate.from_arrays(select(arrays, "associate"))
        self.culling.from_arrays(select(best, "culling"))

    def remove_candidates(self) -> None:
        """Remove the landmarks that are not in the map yet."""
        landmarks, confirmed = len(self.ekf), self.culling.is_confirmed
        if self.config.association == "known" or len(confirmed) < landmarks:
            return
        candidates = np.flatnonzero(~confirmed[:landmarks] & (self.identities < 0))
        self.culling.remove_culled(candidates)
        self.remove(candidates)

    def _session_arrays(self) -> Arrays:
        numbers = {
            "robot_size": np.array(len(self.ekf.robot_state)),
            "sessions": np.array(self.sessions),
        }
        return numbers if self.descriptors is None else numbers | {"descriptors": self.descriptors}

    @property
    def identities(self) -> IntArray:
        """(N,) name of each landmark of the map as a number, -1 for those without."""
        return self.associate.identities(len(self.ekf))

    @property
    def landmark_names(self) -> npt.NDArray[Any]:
        """(N,) name of each landmark: `identities`, or text if any name is text."""
        return name_texts(self.identities, self.text_names)

    @property
    def confirmed(self) -> BoolArray:
        """(N,) which landmarks of the filter are in the map; the others are candidates."""
        return self.culling.confirmed(len(self.ekf)) | (self.identities >= 0)

    @property
    def landmark_sessions(self) -> IntArray:
        """(N,) index of the session in which each landmark was added."""
        return np.asarray(np.searchsorted(self.sessions, self.ekf.ids, side="right") - 1)

    def to_arrays(self) -> Arrays:
        """Its state as named arrays, for `from_arrays` of a `Slam` with the same arguments.

        They are the filter's own: save or copy them before the next step.
        """
        parts = {name: arrays_of(name, part) for name, part in self._parts().items()}
        parts["recovery"] = self.recovery.to_arrays()
        texts = {"text_names": np.array(self.text_names)} if self.text_names else {}
        return {**merge(parts), **texts, "num_steps": np.array(self.num_steps)}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        for name, part in self._parts().items():
            part.from_arrays(select(arrays, name))
        self.recovery.from_arrays(select(arrays, "recovery"), self.ekf)
        self.num_steps = int(arrays["num_steps"])
        self.text_names = stored_texts(arrays)

    def _parts(self) -> dict[str, Stateful]:
        return {"hypotheses": self.hypotheses, "associate": self.associate}

    def __repr__(self) -> str:
        return f"Slam({self.num_steps} steps, {self.ekf!r})"
