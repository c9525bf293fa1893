"""EKF-SLAM step by step: the one loop of the filter, for a live robot and for a whole log."""

from pathlib import Path
from typing import Any, Literal, Self, cast

import numpy as np
import numpy.typing as npt

from saccade.errors import require
from saccade.landmark_names import name_texts, renumber, stored_texts
from saccade.slam._step_kernels import StepResults, Steps
from saccade.slam.association._name_table_kernels import NameTable
from saccade.slam.association.choice import association_rule
from saccade.slam.association.doubted import DoubtedIdentity
from saccade.slam.association.known import KnownIdentity
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.association.rule import Association
from saccade.slam.checkpoint import Arrays, Stateful, arrays_of, merge, select
from saccade.slam.config import RETRACTIONS, EkfConfig
from saccade.slam.custom_steps import take_custom_step
from saccade.slam.filter.compressed import CompressedSlam
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.odometry_bias import bias_jacobian
from saccade.slam.filter.validation import MIN_SIGMA, check_noise, check_range_bearing
from saccade.slam.lost_steps import leave_out, take_lost_step
from saccade.slam.map_management.culling import Culling
from saccade.slam.models import RANGE_BEARING, Motion, RangeBearing, Sensor, compose, drive
from saccade.slam.recovery import Recovery
from saccade.slam.results import StepResult, check_diverged
from saccade.slam.scan_memory import ScanMemory, new_steps
from saccade.slam.step_arguments import step_arguments
from saccade.slam.strides import new_stride, take_stride
from saccade.types import BoolArray, FloatArray, IntArray

MODES = ("continue", "localize")
"""What a robot does with a map that was saved."""
NONE = np.empty(0, np.int64)
"""No landmarks."""
NO_NAMES = DoubtedIdentity().table._replace(counts=np.array([0, 0, -1, 0, 1]))
"""For rules that do not doubt names; as of a log without any."""


class Slam:
    """EKF-SLAM step by step, without knowledge of what comes later.

    `run` takes a log through the same steps, with the same results to the last bit. With the
    association "multiple" it is a `MultiHypothesisSlam`.

    Args:
        config: filter, association and noise.
        start: (3,) first pose.
        motion: the motion model; by default `drive`, with controls of distance and turn.
        sensor: the sensor model; by default range and bearing.
        association: a custom association rule instead of the one in `config`.
        odometry_bias: standard deviations of systematic odometry errors, see `LandmarkLog`.
        mode: "localize" adds and culls no landmarks; the estimates of those in the map (see `load`)
            still change, as their covariance lets them.

    Raises:
        LogError: here and in `step`, an argument that is no number, not finite or of another shape.

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

    def __new__(
        cls, config: EkfConfig = EkfConfig(), *, association: Association | None = None, **_: Any
    ) -> Self:
        """The class for the settings."""
        if cls is Slam and config.association == "multiple" and association is None:
            from saccade.slam.multiple import MultiHypothesisSlam

            return cast("Self", super().__new__(MultiHypothesisSlam))
        return super().__new__(cls)

    def __init__(
        self,
        config: EkfConfig = EkfConfig(),
        *,
        start: FloatArray | tuple[float, float, float] = (0.0, 0.0, 0.0),
        motion: Motion = drive,
        sensor: Sensor = RANGE_BEARING,
        association: Association | None = None,
        odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
        mode: Literal["continue", "localize"] = "continue",
    ) -> None:
        require(mode in MODES, "mode", " or ".join(MODES), mode)
        built_in = motion in (drive, compose) and sensor is RANGE_BEARING
        estimated = config.estimate_odometry_bias and any(odometry_bias) and built_in
        bias = odometry_bias if estimated else ()
        self.config = config
        whole = config.submaps == "never" or config.association == "multiple"
        self.ekf: EkfSlam = (EkfSlam if whole else CompressedSlam)(
            np.concatenate([start, np.zeros(len(bias))]),
            np.diag(np.square([*config.start_sigma, *bias])),
            motion=motion,
            sensor=sensor,
            retraction=RETRACTIONS[config.filter],
            huber=config.huber,
        )
        self.associate = association or association_rule(config)
        """The association rule."""
        self.mode = mode
        adds = mode == "continue"
        doubted = adds and not isinstance(self.associate, KnownIdentity)
        self.culling = Culling(
            doubted, config.confirm_after, config.candidate_scans, config.culling_ratio
        )
        ranges = type(sensor) is RangeBearing
        self._check_scan = check_range_bearing if ranges else lambda z: None
        self.recovery = Recovery(config.recover and ranges, config.new_gate, motion)
        self.num_steps = 0
        """Steps that were taken."""
        self._time = -np.inf
        self.text_names: tuple[str, ...] = ()
        """Names of landmarks that are text; `identities` has their numbers."""
        self.sessions = [0]
        """Landmarks that were added to the map before each session, which `load` begins."""
        self.descriptors: npt.NDArray[Any] | None = None
        """(m, d) of the first m landmarks, if their user gives any; removed with the landmarks."""
        self.arguments = {"odometry_bias": odometry_bias}
        self.motion = motion
        """The motion model."""
        self._control_size = 2 if motion is drive else 3 if motion is compose else None
        built_in_rule = type(self.associate) in (KnownIdentity, NearestNeighbor, DoubtedIdentity)
        self.is_compiled = self.ekf.is_compiled and built_in_rule
        """Whether many steps are taken at once in compiled code: the models and the association
        are those of this package."""
        self.doubted = self.associate if isinstance(self.associate, DoubtedIdentity) else None
        parts = self.associate, self.culling.rule, self.recovery.rule
        self._stride = new_stride(*parts, adds=adds, submaps=config.submaps == "always")
        self._scan = ScanMemory()
        self._noise = config.motion_noise_scale**2, config.sensor_noise_scale**2

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
            control: (c,) from the last pose to this one; None where the robot has not moved, as
                at the first pose.
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
        known = self._time, self._control_size, self.text_names
        given = step_arguments(time, control, U, z, R, names, *known)
        k, moves = len(given.z), given.control is not None
        s, out = self._scan.room_for(k, len(given.U), self.ekf.robot_filter.robot_size - 3)
        s.first[0], s.still[0], s.edge[1] = self.num_steps, not moves, k
        s.time[0] = given.time
        if given.control is not None:
            s.control[0], s.U[0] = given.control, given.U
        s.z[:k], s.R[:k], s.identity[:k] = given.z, given.R, given.identity
        self._complete(s, int(moves), k)
        self._time, self.text_names = given.time, given.text_names
        culled = self.advance(s, 1, out)
        return StepResult.of(s, out, k, culled, self.recovery.hypotheses)

    def prepare(
        self,
        time: FloatArray,
        control: FloatArray,
        U: FloatArray,
        edge: IntArray,
        z: FloatArray,
        R: FloatArray,
        identity: IntArray,
    ) -> Steps:
        """The next steps, for `advance`: validated, and with the noise of the settings.

        Known identities are associated at once: `advance` must take all of these steps.

        Args:
            time: (t,).
            control: (t, c), or (t - 1, c) where none leads to the first pose.
            U: their covariances.
            edge: (t + 1,) the observations of step i are edge[i] to edge[i + 1].
            z: (k, 2).
            R: (k, 2, 2).
            identity: (k,) of the landmarks, -1 where it is unknown.
        """
        t, k, c = len(time), len(z), control.shape[1]
        still, r = t - len(control), self.ekf.robot_filter.robot_size
        steps = new_steps(t, k, c, r - 3)._replace(
            time=np.array(time, np.float64), edge=edge, identity=identity
        )
        steps.first[0], steps.still[0] = self.num_steps, still
        steps.control[still:], steps.U[still:], steps.z[:], steps.R[:] = control, U, z, R
        self._complete(steps, t - still, k)
        return steps

    def number(self, numbers: IntArray, text_names: tuple[str, ...]) -> IntArray:
        """Numbers (k,) that names have here, where those that are text come from another table."""
        numbers, self.text_names = renumber(numbers, text_names, self.text_names)
        return numbers

    def _complete(self, s: Steps, moves: int, k: int) -> None:
        """Validate and associate the next steps, with so many controls at their end."""
        self._check_scan(s.z[:k])
        first, motion, sensor = len(s.time) - moves, *self._noise
        check_noise("control", s.control, s.U, first, first + moves, motion, 0.0)
        check_noise("observation", s.z, s.R, 0, k, sensor, MIN_SIGMA)
        if s.bias_jacobian.size > 0:
            s.bias_jacobian[:] = bias_jacobian(s.control)
        if self.is_compiled and isinstance(self.associate, KnownIdentity):
            scan = np.searchsorted(s.edge, np.arange(k), "right")
            s.landmark[:k] = self.associate.number_ahead(s.identity[:k], scan, len(self.ekf))
        elif self.doubted is not None:
            s.name[:k] = self.doubted.number(s.identity[:k])

    def advance(self, s: Steps, end: int, out: StepResults) -> list[IntArray]:
        """Take the steps before `end`; fills `out` and the association.

        Returns:
            For every step that culled, its landmarks as in `StepResult.culled`.

        Raises:
            LogError: the estimate diverged; names the step.
        """
        start, culled = int(s.position[0]), []
        while s.position[0] < end:
            if self.recovery.lost:
                take_lost_step(self, s, out)
                continue
            landmarks = (
                self._take_many(s, end, out) if self.is_compiled else take_custom_step(self, s, out)
            )
            if self.recovery.left_out:
                leave_out(self, s, out)
            if len(landmarks) > 0:
                culled.append(landmarks)
                self.remove(landmarks, s.landmark)
        first = int(s.first[0])
        self.num_steps = first + end
        check_diverged(out.pose[start:end], first + start)
        return culled

    def remove(self, landmarks: IntArray, association: IntArray) -> None:
        """Remove landmarks (g,) from the filter, and from an association (k,) in place."""
        kept = np.ones(len(self.ekf), np.bool_)
        kept[landmarks] = False
        number = np.where(kept, np.cumsum(kept) - 1, -1)
        used = association >= 0
        association[used] = number[association[used]]
        self.ekf.remove(landmarks)
        if self.doubted is not None:
            self.doubted.removed(number)
        if self.descriptors is not None:
            self.descriptors = self.descriptors[kept[: len(self.descriptors)]]

    def _take_many(self, s: Steps, end: int, out: StepResults) -> IntArray:
        """Take steps in compiled code, as far as there is room; returns the culled landmarks."""
        parts = self.names, self.culling, self.recovery.evidence
        if take_stride(self.ekf, s, end, self._stride, *parts, out):
            return NONE
        done = s.position[1] < 0  # else the step is interrupted, and its numbers are still in use
        return self.culling.remove_culled(self.stale if done else np.empty(0, np.int64))

    def known_landmarks(self, identity: IntArray) -> IntArray:
        """(k,) landmark of the map that each observation names, -1 for none."""
        if self.doubted is not None:
            row = self.doubted.number(identity)
            return np.append(self.doubted.table.landmark, -1)[row]
        if not isinstance(self.associate, KnownIdentity):
            return np.full(len(identity), -1)
        number = [self.associate.number.get(name, -1) for name in identity.tolist()]
        return np.array([n if n < len(self.ekf) else -1 for n in number], np.int64)

    @property
    def names(self) -> NameTable:
        """What is known of landmark names."""
        return self.doubted.table if self.doubted else NO_NAMES

    @property
    def stale(self) -> IntArray:
        """(n,) landmarks whose name moved away, which are to be removed."""
        return self.doubted.stale if self.doubted else np.empty(0, np.int64)

    def save(self, path: str | Path) -> None:
        """Save the whole state as a map file, for `load`; custom models by name only.

        Raises:
            ConfigError: the mode is "localize", or a part has a state that cannot be saved.
            OutputError: the file cannot be written; an old one stays.
        """
        from saccade.slam.sessions import save

        save(self, path)

    @classmethod
    def load(
        cls,
        path: str | Path,
        mode: Literal["continue", "localize"] = "continue",
        config: EkfConfig | None = None,
        *,
        start: FloatArray | tuple[float, float, float] | None = None,
        covariance: FloatArray | None = None,
        motion: Motion | None = None,
        sensor: Sensor = RANGE_BEARING,
        association: Association | None = None,
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
                this is zero, of `sessions.START_SIGMA`: half a meter and a tenth of a radian.
            motion: as for `Slam`, like the other models; by default as saved.
            sensor: the sensor model.
            association: a custom association rule.
            odometry_bias: with a start, as for `Slam`; by default as saved.

        Raises:
            LogError: the file cannot be read, is damaged, no map, or of a later version.
            ConfigError: the settings or models do not suit the map.
        """
        from saccade.slam.sessions import load

        models = (motion, sensor, association, odometry_bias)
        return load(cls, path, mode, config, start, covariance, *models)

    @property
    def identities(self) -> IntArray:
        """(N,) name of each landmark of the map as a number, -1 for those without."""
        if isinstance(self.associate, (KnownIdentity, DoubtedIdentity)):
            return self.associate.identities(len(self.ekf))
        return np.full(len(self.ekf), -1)

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
        return {"ekf": self.ekf, "associate": self.associate, "culling": self.culling}

    def __repr__(self) -> str:
        return f"Slam({self.num_steps} steps, {self.ekf!r})"
