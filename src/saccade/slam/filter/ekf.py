"""EKF-SLAM: predict, update, augment (C.1-C.18)."""

from math import inf

import numpy as np

from saccade.errors import LogError
from saccade.io.checkpoint import Arrays
from saccade.slam.filter._kernels import retract, whiten
from saccade.slam.filter._range_bearing_kernels import (
    Innovations,
    augment_range_bearing,
    linearize_range_bearing,
    write_pose,
)
from saccade.slam.filter._state_kernels import INVARIANT, FilterState
from saccade.slam.filter.models import BIASES, PredictedObservations, expected, predict, update
from saccade.slam.filter.state import (
    STANDARD,
    Retraction,
    add_rows,
    dense,
    flush,
    from_arrays,
    inflate_heading_covariance,
    is_inflation_due,
    landmark_blocks,
    like,
    marginal,
    new_state,
    remove_landmarks,
    replace_pose,
    rescale,
    room_for_scan,
    state_size,
    symmetric,
    to_arrays,
)
from saccade.slam.filter.validation import check_all, check_covariance, check_landmark, check_vector
from saccade.slam.local_map import LocalMap, enter, leave
from saccade.slam.models import observe, wrap
from saccade.slam.results import Innovation
from saccade.types import BoolArray, FloatArray, IntArray


class EkfSlam:
    """EKF-SLAM: the pose of a robot and the landmarks of a map as one Gaussian.

    The state is s = (x, y, theta, m1x, m1y, ..., mNx, mNy) (C.3). Its covariance P (C.4)
    is one buffer that doubles when it is full; see `_kernels` for its parametrization.

    Args:
        pose: (3,) x, y in metres, heading in radians; or (6,) with the biases of the odometry (see
            `odometry_bias`).
        covariance: (3, 3) of the pose, or (6, 6); zero where the pose defines the frame.
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
        retraction: Retraction = STANDARD,
        huber: float = inf,
    ) -> None:
        robot = check_vector("pose", pose, 3 + BIASES if np.size(pose) > 3 else 3)
        P = check_covariance("covariance of the pose", covariance, len(robot))
        self.local_map: LocalMap | None = None
        """Where the filter works at present, if not in the whole map."""
        self._whole = new_state(robot, P, error_state=int(Retraction(retraction)), huber=huber)
        self._ids = np.zeros(0, np.int64)  # of the landmarks at the last removal
        self._removed = 0
        self._confirmed = np.ones(0, np.bool_)
        self._whole.state[2] = wrap(robot[2])

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Move the robot (C.5-C.9).

        Args:
            u: (c,) control: distance and turn for `turn_then_translate`, or forward, left and turn
                for `compose`.
            U: (c, c) its covariance.
        """
        u = check_vector("control", u, 3 if np.size(u) == 3 else 2)
        U = check_covariance("covariance of the control", U, len(u))
        self.inflate_heading_covariance()
        self.reserve()
        predict(self.filter_state, u, U)

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
        v, S, nis = update(self.filter_state, z[None], R[None], np.array([landmark]))
        return Innovation(v[0], S[0], float(nis[0]))

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
        f = self.filter_state
        m, v, H = f.robot_size + 2 * landmark, np.empty(2), np.empty((2, f.robot_size + 2))
        noise, S, A, D = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2)), np.empty(H.shape)
        linearize_range_bearing(f, m, z, R, v, H, noise)  # C.14
        whiten(f, m, H, noise, 1.0, S, D, A)  # C.12
        whitened = A @ v
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
        self.reserve(len(z))
        return update(self.filter_state, z, R, np.asarray(landmark, np.int64))

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
        augment_range_bearing(self.filter_state, z, R)
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
        self.filter_state = like(self.filter_state, mean, covariance, len(ids) + 32)
        self._ids, self._removed = ids, int(ids.max(initial=-1)) + 1 - len(ids)

    def rescale(self, factor: float, about: FloatArray) -> None:
        """Scale the map about a point (2,), as when the scale of its metre was wrong."""
        rescale(self.filter_state, factor, about)

    def predict_observations(self) -> PredictedObservations:
        """Predicted observations of every landmark from the present pose."""
        return expected(self.filter_state, np.arange(len(self)))

    def predict_jointly(self, landmarks: IntArray) -> PredictedObservations:
        """Predicted observations z (c, 2) of landmarks (c,), with joint covariance (2c, 2c)."""
        robot, c = self.robot_state, len(landmarks)
        r = len(robot)
        predicted, H = observe(robot, self.landmarks[landmarks])
        J = np.zeros((c, 2, r + 2 * c))
        J[..., :r] = H[..., :r]
        for k in range(c):
            J[k, :, r + 2 * k : r + 2 * k + 2] = H[k, :, r:]
        flat = J.reshape(2 * c, r + 2 * c)
        return PredictedObservations(predicted, flat @ self.marginal(landmarks) @ flat.T)

    def marginal(self, landmarks: IntArray) -> FloatArray:
        """(3 + 2k, 3 + 2k) joint covariance of the robot and of landmarks (k,), in their order."""
        return marginal(self.filter_state, np.asarray(landmarks, np.int64))

    def relative_position(self, a: int, b: int) -> tuple[FloatArray, FloatArray]:
        """Position (2,) of landmark a relative to landmark b, and its covariance (2, 2)."""
        landmarks, f = self.to_view(np.array([a, b])), self.view
        if landmarks.min() < 0:
            landmarks, f = np.array([a, b]), self.filter_state
        C, rows = marginal(f, landmarks)[-4:, -4:], f.robot_size + 2 * landmarks
        difference = f.state[rows[0] : rows[0] + 2] - f.state[rows[1] : rows[1] + 2]
        return difference, C[:2, :2] + C[2:, 2:] - C[:2, 2:] - C[2:, :2]

    @property
    def filter_state(self) -> FilterState:
        """The state of the whole map; ends the stay in a local map."""
        self.leave()
        return self._whole

    @filter_state.setter
    def filter_state(self, filter_state: FilterState) -> None:
        self._whole, self.local_map = filter_state, None

    def enter(self, inside: IntArray) -> LocalMap:
        """Work among these landmarks (k,), ascending, until `leave`.

        What steps among them change about the others is deferred. The pose and its covariance do
        not need it; what needs the other landmarks leaves first.
        """
        self.local_map = enter(self.filter_state, inside)
        return self.local_map

    def leave(self) -> None:
        """Bring the state of the whole map up to date."""
        if self.local_map is not None:
            place, self.local_map = self.local_map, None
            self._whole = leave(self._whole, place)

    @property
    def view(self) -> FilterState:
        """The state in which a step works: of all landmarks, or of those of a local map."""
        return self._whole if self.local_map is None else self.local_map.state

    def to_view(self, landmarks: IntArray) -> IntArray:
        """Numbers in `view` of landmarks (k,), -1 for those that are not in it.

        Negative numbers stay, and so do the places of landmarks that are yet to be added.
        """
        return landmarks if self.local_map is None else self.local_map.to_local(landmarks)

    def from_view(self, landmarks: IntArray) -> IntArray:
        """Numbers of landmarks (k,) of `view`; negative ones stay."""
        return landmarks if self.local_map is None else self.local_map.to_map(landmarks)

    def mark_observed(self, landmarks: IntArray) -> None:
        """Called with the landmarks (k,) of `view` that a scan updates, negative for none."""
        if self.local_map is not None:
            observed = self.local_map.observed
            observed[landmarks[(landmarks >= 0) & (landmarks < len(observed))]] = True

    def reserve(self, observations: int = 1) -> None:
        """Make room for a motion and so many observations, each perhaps of a new landmark."""
        state = room_for_scan(self.view, observations)
        if self.local_map is None:
            self._whole = state
        else:
            self.local_map.state = state

    def inflate_heading_covariance(self) -> None:
        """Account for a heading that has become less certain where due, before a motion."""
        if is_inflation_due(self.view):
            inflate_heading_covariance(self.filter_state)

    def to_arrays(self) -> Arrays:
        """Its state as named arrays, for `from_arrays` of a filter with the same models."""
        own = {"ids": self._ids, "removed": np.array(self._removed)}
        return to_arrays(self.filter_state) | own

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        self.filter_state = from_arrays(self.filter_state, arrays)
        self._ids, self._removed = arrays["ids"], int(arrays["removed"])

    @property
    def pose(self) -> FloatArray:
        """(3,) x, y in metres, heading in radians."""
        return self.view.state[:3].copy()

    @property
    def robot_state(self) -> FloatArray:
        """(r,) the pose and the further states of the robot."""
        return self.view.state[: self.view.robot_size].copy()

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3)."""
        covariance = np.empty((3, 3))
        write_pose(self.view, np.empty(3), covariance)
        return covariance

    @property
    def odometry_bias(self) -> FloatArray | None:
        """(3,) see `filter.models.BIASES`; None where they are no part of the state."""
        return self.robot_state[3:] if self.view.robot_size > 3 else None

    @property
    def nonlinearity(self) -> float:
        """Root of the mean share of second-order terms in the variance of the innovations."""
        now = self.view.now
        count = now.nonlinear_updates
        return float(np.sqrt(now.nonlinearity / count)) if count > 0 else 0.0

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
    def confirmed_in_view(self) -> BoolArray:
        """(N,) landmarks of `view` that are more than candidates, for association; at least N."""
        confirmed = self._confirmed
        if len(confirmed) < self.view.now.landmarks:
            missing = self.view.now.landmarks - len(confirmed)
            confirmed = np.append(confirmed, np.ones(missing, np.bool_))
        return confirmed

    @confirmed_in_view.setter
    def confirmed_in_view(self, confirmed: BoolArray) -> None:
        self._confirmed = confirmed

    @property
    def state(self) -> FloatArray:
        """(3 + 2N,) the pose, then the landmarks (C.3)."""
        return self.filter_state.state[: state_size(self.filter_state)].copy()

    @property
    def covariance(self) -> FloatArray:
        """(3 + 2N, 3 + 2N) of the whole state (C.4)."""
        return dense(self.filter_state)

    def __len__(self) -> int:
        if self.local_map is None:
            return int(self._whole.now.landmarks)
        return int(self.local_map.state.now.landmarks) + len(self.local_map.rest)

    def __repr__(self) -> str:
        x, y, theta = self.pose
        return f"EkfSlam({len(self)} landmarks, pose {x:.2f} {y:.2f} m {theta:.3f} rad)"


TOLERANCE = 1e-4
"""Metres: standard deviation of the constraint that both are at the same position."""


def join_landmarks(ekf: EkfSlam, kept: int, removed: int) -> None:
    """Update by the observation that two landmarks are one.

    An update (C.10-C.11) by an innovation of zero distance, with the Jacobian 1 of the one
    landmark and -1 of the other.

    Args:
        ekf: the filter; changed in place.
        kept: number of the landmark that stays.
        removed: number of the other one, which is not removed here.
    """
    ekf.reserve()
    f = ekf.filter_state
    flush(f)
    r, n = f.robot_size, state_size(f)
    a, b = r + 2 * kept, r + 2 * removed
    H = np.zeros((2, n))  # by eta
    H[[0, 1], [a, a + 1]], H[[0, 1], [b, b + 1]] = 1.0, -1.0
    if f.error_state == INVARIANT:
        H[:, 2] = f.heading_lever[a : a + 2] - f.heading_lever[b : b + 2]
    W = H @ symmetric(f.P[:n, :n])
    S = W @ H.T + TOLERANCE**2 * np.eye(2)
    A = np.linalg.inv(np.linalg.cholesky(S))
    V = np.zeros((2, len(f.state)))
    V[:, :n] = A @ W
    first, second = A @ (f.state[b : b + 2] - f.state[a : a + 2])
    f.P[:r, :n] -= V[:, :r].T @ V[:, :n]
    retract(f, float(first), float(second), V)
    V[:, :r] = 0.0
    add_rows(f, -1.0, V[:, :n])
