"""EKF-SLAM: predict, update, augment (C.1-C.18)."""

from math import inf

import numpy as np

from saccade.errors import LogError
from saccade.slam.association._kernels import predict_observations
from saccade.slam.checkpoint import Arrays
from saccade.slam.filter import _kernels, _range_bearing_kernels
from saccade.slam.filter._range_bearing_kernels import Innovations
from saccade.slam.filter._state_kernels import LANDMARKS, FilterState, is_full, is_spread_due
from saccade.slam.filter.error_state import STANDARD, Retraction, linearize
from saccade.slam.filter.odometry_bias import BIASES, bias_jacobian
from saccade.slam.filter.state import (
    FIRST_CAPACITY,
    compact,
    dense,
    expanded,
    flush,
    gaussian_state,
    grown,
    landmark_blocks,
    marginal,
    new_scratch,
    new_state,
    remove_landmarks,
    replace_pose,
    rescale,
    restored,
    robot_rows,
    saved,
    spread,
    state_rows,
    state_size,
)
from saccade.slam.filter.validation import check_all, check_covariance, check_landmark, check_vector
from saccade.slam.models import RANGE_BEARING, Motion, RangeBearing, Sensor, compose, drive, wrap
from saccade.slam.results import Innovation, PredictedObservations, new_innovations
from saccade.types import BoolArray, FloatArray, IntArray


class EkfSlam:
    """EKF-SLAM: the pose of a robot and the landmarks of a map as one Gaussian.

    The state is s = (x, y, theta, m1x, m1y, ..., mNx, mNy) (C.3). Its covariance P (C.4)
    is one buffer that doubles when it is full; see `_kernels` for its parametrization.

    Args:
        pose: (3,) x, y in metres, heading in radians; further numbers are further states of the
            robot: the biases of its odometry (see `odometry_bias`) for the models of this
            package, or whatever custom motion and sensor models use.
        covariance: (3, 3) of the pose; zero where the pose defines the frame.
        motion: the motion model; by default `drive` (C.5-C.9).
        sensor: the sensor model; by default range and bearing (C.14-C.18).
        retraction: the error parametrization; by default `STANDARD`, the source's.
        huber: root of the normalized innovation squared beyond which an observation has less
            weight, after Huber (1964): its covariance is multiplied by their ratio.

    Raises:
        LogError: here and in every method, an argument of the wrong shape, one with NaN or
            infinity, or an invalid covariance. The state stays as it was.
    """

    def __init__(
        self,
        pose: FloatArray,
        covariance: FloatArray,
        motion: Motion = drive,
        sensor: Sensor = RANGE_BEARING,
        retraction: Retraction = STANDARD,
        huber: float = inf,
    ) -> None:
        self._motion = motion
        self._sensor = sensor
        self._observes_range_bearing = type(sensor) is RangeBearing
        built_in = motion in (drive, compose) and self._observes_range_bearing
        self.is_compiled = built_in and np.size(pose) in (3, 3 + BIASES)
        """Whether the models are those of this package, for which there are kernels."""
        robot = check_vector("pose", pose, max(3, np.size(pose)))
        P = check_covariance("covariance of the pose", covariance, len(robot))
        self._set_state(new_state(robot, P, FIRST_CAPACITY, int(Retraction(retraction)), huber))
        self._ids = np.zeros(0, np.int64)  # of the landmarks at the last removal
        self._removed = 0
        self._candidates = np.zeros(0, np.bool_)
        self.filter_state.state[2] = wrap(robot[2])

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Move the robot (C.5-C.9).

        Args:
            u: (c,) control of the motion model; (distance, turn) for `drive`.
            U: (c, c) its covariance.
        """
        u = check_vector("control", u)
        U = check_covariance("covariance of the control", U, len(u))
        self.spread()
        self.reserve()
        if self.is_compiled:
            D = self.bias_jacobian(u[None])[0]
            _range_bearing_kernels.predict_by_control(self.filter_state, self.scratch, u, U, D)
            return
        moved, Fx, Fu = self._motion(self.robot_state, u)  # C.5, C.8, C.9
        _kernels.predict(self.filter_state, self.scratch, moved, Fx, Fu @ U @ Fu.T)  # C.7

    def update(self, z: FloatArray, R: FloatArray, landmark: int) -> Innovation:
        """Update by an observation of a landmark of the map (C.10-C.14).

        Only the columns of the robot and of this landmark take part in the gain. Directions
        without variance in a singular innovation covariance are not corrected.

        Args:
            z: (2,) range in metres and bearing in radians.
            R: (2, 2) its covariance.
            landmark: number of the landmark in the map.

        Returns:
            The innovation, its covariance, and its normalized square.
        """
        check_landmark(landmark, len(self))
        z = check_vector("observation", z, 2)
        R = check_covariance("covariance of the observation", R, 2)
        self.reserve()
        f, w, S = self.filter_state, self.scratch, np.empty((2, 2))
        if self._observes_range_bearing:
            m, v = f.robot_size + 2 * landmark, np.empty(2)
            nis = _range_bearing_kernels.update_range_bearing(f, w, m, z, R, v, S)
        else:
            m, v, H, noise = self._linearized(z, R, landmark)  # C.14
            nis = _kernels.update(f, w, m, v, H, noise, S)  # C.10-C.13
        return Innovation(v, S, nis)

    def innovation(self, z: FloatArray, R: FloatArray, landmark: int) -> Innovation:
        """The innovation of an observation without an update, in constant time.

        Args:
            z: (2,) range in metres and bearing in radians.
            R: (2, 2) its covariance.
            landmark: number of the landmark in the map.
        """
        check_landmark(landmark, len(self))
        z = check_vector("observation", z, 2)
        R = check_covariance("covariance of the observation", R, 2)
        m, v, H, noise = self._linearized(z, R, landmark)  # C.14
        f, w, S = self.filter_state, self.scratch, np.empty((2, 2))
        _kernels.prepare_update(f, w, m, H, noise, 1.0, S, w.D, w.A)  # C.12
        whitened = w.A @ v
        return Innovation(v, S, float(whitened @ whitened))

    def update_scan(self, z: FloatArray, R: FloatArray, landmark: IntArray) -> Innovations:
        """Update by all observations from one pose.

        Args:
            z: (k, 2).
            R: (k, 2, 2) their covariances.
            landmark: (k,) number in the map; the next free number augments, a negative
                one leaves the observation out.
        """
        z, R = (np.array(each, np.float64, order="C") for each in (z, R))
        check_all("observation", z, R)
        free = np.maximum.accumulate(np.append(len(self) - 1, landmark))[:-1] + 1  # (k,)
        if (landmark > free).any():
            raise LogError(
                f"landmark: expected numbers up to {int(free[landmark > free][0])}, "
                f"found {int(landmark[landmark > free][0])}"
            )
        out = new_innovations(len(z))
        if self.is_compiled:
            k = 0
            while k < len(z):
                self.reserve()
                f, w, kernel = self.filter_state, self.scratch, _range_bearing_kernels.update_scan
                k = kernel(f, w, z, R, landmark, k, len(z), out)
            return out
        for k, number in enumerate(landmark.tolist()):
            if number == len(self):
                self.augment(z[k], R[k])
            elif number >= 0:
                out.value[k], out.covariance[k], out.nis[k] = self.update(z[k], R[k], number)
        return out

    def augment(self, z: FloatArray, R: FloatArray) -> int:
        """Add a new landmark to the map (C.15-C.18).

        Args:
            z: (2,) range in metres and bearing in radians.
            R: (2, 2) its covariance.

        Returns:
            The landmark's number in the map.
        """
        z = check_vector("observation", z, 2)
        R = check_covariance("covariance of the observation", R, 2)
        self.reserve()
        f, w = self.filter_state, self.scratch
        if self._observes_range_bearing:
            _range_bearing_kernels.augment_range_bearing(f, w, z, R)
        else:
            xy, Gx, Gz = self._sensor.inverse_observe(self.robot_state, z)  # C.15, C.18
            _kernels.augment(f, w, xy, Gx, Gz @ R @ Gz.T)  # C.16-C.17
        return len(self) - 1

    def remove(self, landmarks: IntArray) -> None:
        """Remove landmarks from the map; those behind them move up in number.

        Args:
            landmarks: (k,) their numbers.
        """
        removed = np.unique(np.asarray(landmarks, np.int64))
        for number in removed.tolist():
            check_landmark(number, len(self))
        self._ids = np.delete(self.ids, removed)
        self._removed += len(removed)
        remove_landmarks(self.filter_state, removed)

    def reset_pose(self, pose: FloatArray, covariance: FloatArray) -> None:
        """Replace the pose by one that does not depend on the map; the landmarks stay as they are.

        Args:
            pose: (3,) x, y in metres, heading in radians.
            covariance: (3, 3).
        """
        pose = check_vector("pose", pose, 3)
        C = check_covariance("covariance of the pose", covariance, 3)
        replace_pose(self.filter_state, pose, C)

    def set_gaussian(self, mean: FloatArray, covariance: FloatArray, ids: IntArray) -> None:
        """Replace the whole state.

        Args:
            mean: (n,) the robot's numbers, then the landmarks (C.3).
            covariance: (n, n) of it (C.4).
            ids: (N,) of the landmarks, ascending; those added later have larger ones.
        """
        self._set_state(gaussian_state(self.filter_state, mean, covariance))
        self._ids, self._removed = ids, int(ids.max(initial=-1)) + 1 - len(ids)

    def rescale(self, factor: float, about: FloatArray) -> None:
        """Scale the map about a point (2,), as when the scale of its metre was wrong."""
        rescale(self.filter_state, factor, about)

    def predict_observations(self) -> PredictedObservations:
        """Predicted observations of every landmark from the present pose."""
        f, r, N = self.filter_state, self.filter_state.robot_size, len(self)
        if self.is_compiled:
            predicted = PredictedObservations(np.empty((N, 2)), np.empty((N, 2, 2)))
            predict_observations(f, np.arange(N), *predicted)
            return predicted
        z, H = self._sensor.observe(self.robot_state, self.landmarks)
        Hx, Hm = H[..., :r], H[..., r:]  # (N, 2, r), (N, 2, 2)
        rows = robot_rows(f)
        Pxm = rows[:, r:].reshape(r, N, 2).transpose(1, 0, 2)  # (N, r, 2)
        cross = Hx @ Pxm @ Hm.transpose(0, 2, 1)  # (N, 2, 2)
        landmarks = Hm @ self.landmark_covariances @ Hm.transpose(0, 2, 1)
        robot = Hx @ rows[:, :r] @ Hx.transpose(0, 2, 1)
        return PredictedObservations(z, robot + cross + cross.transpose(0, 2, 1) + landmarks)

    def marginal(self, landmarks: IntArray) -> FloatArray:
        """(3 + 2k, 3 + 2k) joint covariance of the robot and of landmarks (k,), in their order."""
        return marginal(self.filter_state, np.asarray(landmarks, np.int64))

    def reserve(self, landmarks: int = 1) -> None:
        """Make room for another step and so many more landmarks."""
        if len(self) + landmarks > len(self.filter_state.blocks):
            while len(self) + landmarks > len(self.filter_state.blocks):
                self._set_state(grown(self.filter_state))
        elif is_full(self.filter_state):
            flush(self.filter_state)

    def spread(self) -> None:
        """Account for a heading that has become less certain, see `state.spread`, where due."""
        if is_spread_due(self.robot_filter):
            spread(self.filter_state)

    def _set_state(self, filter_state: FilterState) -> None:
        self.filter_state = filter_state
        """The arrays of the filter, for kernels; `reserve` replaces them by larger ones."""
        self.scratch = new_scratch(filter_state)
        """Memory for the steps, for kernels."""

    def bias_jacobian(self, control: FloatArray) -> FloatArray:
        """(t, c, r - 3) Jacobian of controls (t, c) by the robot's states beyond the pose."""
        return bias_jacobian(control)[:, :, : self.robot_filter.robot_size - 3]

    def to_arrays(self, *, spare: bool = True) -> Arrays:
        """Its state as named arrays, for `from_arrays` of a filter with the same models.

        Without spare room for more landmarks they are smaller, and equal up to rounding.
        """
        arrays = saved(self.filter_state) if spare else compact(self.filter_state)
        return {**arrays, "ids": self._ids, "removed": np.array(self._removed)}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        restore = restored if "counts" in arrays else expanded
        self._set_state(restore(self.filter_state, arrays))
        self._ids, self._removed = arrays["ids"], int(arrays["removed"])

    @property
    def robot_filter(self) -> FilterState:
        """Arrays of which those of the robot are up to date."""
        return self.filter_state

    @property
    def pose(self) -> FloatArray:
        """(3,) x, y in metres, heading in radians."""
        return self.robot_filter.state[:3].copy()

    @property
    def robot_state(self) -> FloatArray:
        """(r,) the pose and the further states of the robot."""
        return self.robot_filter.state[: self.robot_filter.robot_size].copy()

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3)."""
        covariance = np.empty((3, 3))
        _range_bearing_kernels.write_pose(self.robot_filter, self.scratch, np.empty(3), covariance)
        return covariance

    @property
    def odometry_bias(self) -> FloatArray | None:
        """(3,) see `odometry_bias.BIASES`; None where they are no part of the state."""
        estimated = self.is_compiled and self.robot_filter.robot_size > 3
        return self.robot_state[3:] if estimated else None

    @property
    def confirmed(self) -> BoolArray:
        """(N,) landmarks that are more than candidates, all if it was not set, for association."""
        confirmed = np.ones(len(self), np.bool_)
        known = self._candidates[: len(self)]
        confirmed[: len(known)] = ~known
        return confirmed

    @confirmed.setter
    def confirmed(self, confirmed: BoolArray) -> None:
        self._candidates = ~confirmed

    @property
    def nonlinearity(self) -> float:
        """Root of the mean share of second-order terms in the variance of the innovations."""
        total, count = self.robot_filter.nonlinearity.tolist()
        return float(np.sqrt(total / count)) if count > 0 else 0.0

    @property
    def ids(self) -> IntArray:
        """(n,) number of landmarks added before each; it stays the same as others are removed."""
        since = np.arange(len(self._ids) + self._removed, self.num_added)
        return np.concatenate([self._ids, since])

    @property
    def num_added(self) -> int:
        """Landmarks that were ever added."""
        return len(self) + self._removed

    @property
    def landmarks(self) -> FloatArray:
        """(N, 2) metres, in the order in which they were augmented."""
        return self.state[self.filter_state.robot_size :].reshape(-1, 2)

    @property
    def landmark_covariances(self) -> FloatArray:
        """(N, 2, 2) square metres."""
        return landmark_blocks(self.filter_state)

    @property
    def state(self) -> FloatArray:
        """(3 + 2N,) the pose, then the landmarks (C.3)."""
        return self.filter_state.state[: state_size(self.filter_state)].copy()

    @property
    def covariance(self) -> FloatArray:
        """(3 + 2N, 3 + 2N) of the whole state (C.4)."""
        return dense(self.filter_state)

    @property
    def sensor(self) -> Sensor:
        """The sensor model."""
        return self._sensor

    def __len__(self) -> int:
        return int(self.filter_state.counts[LANDMARKS])

    def __repr__(self) -> str:
        x, y, theta = self.pose
        return f"EkfSlam({len(self)} landmarks, pose {x:.2f} {y:.2f} m {theta:.3f} rad)"

    def _linearized(
        self, z: FloatArray, R: FloatArray, landmark: int
    ) -> tuple[int, FloatArray, FloatArray, FloatArray]:
        """The landmark's row, the innovation, its Jacobian by eta and its noise."""
        f, w = self.filter_state, self.scratch
        m = f.robot_size + 2 * landmark
        if self._observes_range_bearing:
            v = np.empty(2)
            _range_bearing_kernels.linearize_range_bearing(f, w, m, z, R, v)
            return m, v, w.H, w.R
        rows = state_rows(np.array([landmark]), f.robot_size)
        lever = np.zeros(len(rows)) if f.error_state == STANDARD else f.heading_lever[rows]
        return m, *linearize(self._sensor, f.state[rows], lever, z), R
