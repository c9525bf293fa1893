"""EKF-SLAM: predict, update, augment (C.1-C.18)."""

import copy
from math import inf
from typing import Self

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError, require
from saccade.slam.filter._kernels import predict, retract, update, write_pose
from saccade.slam.filter._state_kernels import INVARIANT, FilterState, find_rows
from saccade.slam.filter.predictions import (
    Innovations,
    PredictedObservations,
    expected,
    new_innovations,
)
from saccade.slam.filter.robot_models import (
    as_relative_pose,
    observe_with_errors,
    stack_jacobians,
    wrap,
)
from saccade.slam.filter.state import (
    ERRORS,
    Errors,
    add_rows,
    augment,
    dense,
    flush,
    flush_rows,
    inflate_heading_covariance,
    is_inflation_due,
    landmark_blocks,
    like,
    marginal,
    new_state,
    remove_landmarks,
    state_size,
    symmetric,
    with_capacity,
)
from saccade.slam.filter.submaps import Submap, enter, leave, read
from saccade.slam.filter.validation import (
    as_array,
    check_all,
    check_covariance,
    check_vector,
)
from saccade.types import FloatArray, IntArray

RANGE_ERRORS = 2
"""Number of systematic errors of the ranges: scale error and offset."""
JOIN_SIGMA = 1e-4
"""Standard deviation of the constraint that two landmarks are one, in meters."""


class EkfSlam:
    """EKF-SLAM: the pose of a robot and the landmarks of a map as one Gaussian.

    The state is s = (x, y, theta, m1x, m1y, ..., mNx, mNy) (C.3). Its covariance P (C.4)
    is one buffer that grows when it is full; see `_kernels` for its parametrization. A landmark
    has an id that never changes; its row in the state is used only here.

    Args:
        pose: (3,) x, y in meters, heading in radians; or (6,) with the biases of the odometry (see
            `odometry_bias`), (5,) with the systematic errors of the ranges (see `range_errors`), or
            (8,) with both.
        covariance: (r, r) of the pose with these; zero where the pose defines the frame.
        errors: the error parametrization, see `filter.state.ERRORS`; by default the source's.
        huber: root of the normalized innovation squared beyond which an observation has less
            weight, after Huber (1964): its covariance is multiplied by their ratio.

    Raises:
        ConfigError: unknown `errors`.
        LogError: here and in every method, an argument of the wrong shape, one with NaN or
            infinity, an invalid covariance, or an id that is not in the map. The state stays as it
            was.
    """

    def __init__(
        self,
        pose: FloatArray,
        covariance: FloatArray,
        errors: Errors = "standard",
        huber: float = inf,
    ) -> None:
        size = np.size(pose)
        robot = check_vector("pose", pose, size if size in (3, 5, 6, 8) else 3)
        P = check_covariance("covariance of the pose", covariance, len(robot))
        require(errors in ERRORS, "errors", " or ".join(ERRORS), errors)
        first = size - RANGE_ERRORS if size in (5, 8) else 0
        empty = new_state(robot, P, errors=ERRORS[errors], huber=huber, range_errors=first)
        self._whole = like(empty, robot, P, np.empty(0, np.int64))
        self._whole.state[2] = wrap(robot[2])
        self.submap: Submap | None = None
        """The submap in which the filter works at present; None for the whole map."""

    def predict(
        self,
        u: FloatArray,
        U: FloatArray,
        by_error: FloatArray | None = None,
        *,
        checked: bool = False,
    ) -> None:
        """Moves the robot (C.5-C.9).

        Args:
            u: (c,) control, of the first motion in `saccade.motions.MOTIONS` with c columns.
            U: (c, c) its covariance.
            by_error: (3, 3) Jacobian of a relative pose by the systematic errors of the odometry.
            checked: whether the control is a relative pose (3,), and the arguments are valid.
        """
        if not checked or by_error is None:
            u, U, by_error = as_relative_pose(u, U)
        if is_inflation_due(self.active):
            self.leave()
            inflate_heading_covariance(self._whole)
        predict(self._reserved(0, 1), u, U, by_error)

    def update(
        self, z: FloatArray, R: FloatArray, landmark: npt.ArrayLike, *, checked: bool = False
    ) -> Innovations:
        """Updates by observations from one pose (C.10-C.14).

        Only the columns of the robot and of the landmark take part in a gain. Directions without
        variance in a singular innovation covariance are not corrected.

        Args:
            z: (k, 2) ranges in meters and bearings in radians; or (2,).
            R: (k, 2, 2) their covariances; or (2, 2).
            landmark: (k,) ids; `next_id` and those after it augment, a negative one leaves the
                observation out.
            checked: as in `predict`.
        """
        landmark = np.atleast_1d(np.asarray(landmark, np.int64))
        if not checked:
            k, one = len(landmark), np.ndim(z) == 1
            z = as_array("observations", (k, 2), [z] if one else z).copy()
            R = as_array("covariances of the observations", (k, 2, 2), [R] if one else R).copy()
            check_all("observation", z, R)
            self._check_ids(landmark)
        rows, f = self.rows(landmark), self._reserved(len(z), 2 * len(z))
        out = new_innovations(len(z))
        if self.submap is not None:
            self.submap.include(rows)
        k = update(f, z, R, rows, 0, *out)
        while k < len(z):  # at a new landmark
            augment(f, z[k], R[k])
            k = update(f, z, R, rows, k + 1, *out)
        return out

    def augment(self, z: FloatArray, R: FloatArray, *, checked: bool = False) -> int:
        """Adds a new landmark to the map (C.15-C.18).

        Args:
            z: (2,) range in meters and bearing in radians.
            R: (2, 2) its covariance.
            checked: as in `predict`.

        Returns:
            The landmark's id.
        """
        if not checked:
            z = check_vector("observation", z, 2)
            R = check_covariance("covariance of the observation", R, 2)
        augment(self._reserved(1, 0), z, R)
        added: int = self.next_id - 1
        return added

    def remove(self, landmarks: IntArray) -> None:
        """Removes landmarks (k,), by their ids, from the map."""
        self.leave()
        remove_landmarks(self._whole, np.unique(self._known_rows(np.asarray(landmarks, np.int64))))

    def join(self, kept: int, removed: int) -> None:
        """Updates by the observation that two landmarks are one; both stay.

        The innovation (C.10) is the distance of the landmarks, which is measured as zero. Its
        Jacobian is 1 by the first landmark and -1 by the second.
        """
        self.leave()
        f = self._whole
        flush(f)
        r, n = f.robot_size, state_size(f)
        a, b = (r + 2 * self._known_rows(np.array([kept, removed]))).tolist()
        H = np.zeros((2, n))  # by eta
        H[[0, 1], [a, a + 1]], H[[0, 1], [b, b + 1]] = 1.0, -1.0
        if f.errors == INVARIANT:
            H[:, 2] = f.heading_lever[a : a + 2] - f.heading_lever[b : b + 2]
        HP = H @ symmetric(f.P[:n, :n])
        S = HP @ H.T + JOIN_SIGMA**2 * np.eye(2)
        A = np.linalg.inv(np.linalg.cholesky(S))
        V = np.zeros((2, len(f.state)))
        V[:, :n] = A @ HP
        first, second = A @ (f.state[b : b + 2] - f.state[a : a + 2])
        f.P[:r, :n] -= V[:, :r].T @ V[:, :n]
        retract(f, float(first), float(second), V)
        V[:, :r] = 0.0
        add_rows(f, -1.0, V[:, :n])

    def reset_pose(self, pose: FloatArray, covariance: FloatArray) -> None:
        """Replaces the pose by one that does not depend on the map; the landmarks stay as they are.

        Their present estimates count as the first ones: otherwise, their invariant errors would
        depend on the error of the heading.

        Args:
            pose: (3,) x, y in meters, heading in radians.
            covariance: (3, 3).
        """
        pose = check_vector("pose", pose, 3)
        C = check_covariance("covariance of the pose", covariance, 3)
        mean, P = self.state, self.covariance
        mean[:3], P[:3], P[:, :3] = pose, 0.0, 0.0
        P[:3, :3] = C
        self.set_gaussian(mean, P, self.ids)

    def set_gaussian(
        self,
        mean: FloatArray,
        covariance: FloatArray,
        ids: IntArray,
        heading_lever: FloatArray | None = None,
    ) -> None:
        """Replaces the whole state.

        Args:
            mean: (n,) the robot's numbers, then the landmarks (C.3).
            covariance: (n, n) of it (C.4).
            ids: (N,) of the landmarks, ascending; those added later have larger ones.
            heading_lever: (n,) see `_kernels`; by default the estimates are the first ones.
        """
        self._whole = like(self.active, mean, covariance, ids, heading_lever)
        self.submap = None

    def rescale(self, factor: float, about: FloatArray) -> None:
        """Scales the map about a point (2,), when the scale of its meter was wrong."""
        self.leave()
        mean, lever, r = self.state, self._whole.heading_lever, self._whole.robot_size
        scale = np.full(len(mean), factor)
        scale[2:r] = 1.0
        for i in (0, 1):
            rows = np.append(i, np.arange(r + i, len(mean), 2))
            mean[rows] = about[i] + factor * (mean[rows] - about[i])
        P = self.covariance * scale[:, None] * scale
        self.set_gaussian(mean, P, self.ids, lever[: len(mean)] * scale)

    def predict_observations(self, landmarks: IntArray | None = None) -> PredictedObservations:
        """Predicted observations of landmarks (k,), by default all, from the present pose."""
        self.leave()
        rows = np.arange(len(self)) if landmarks is None else self._known_rows(landmarks)
        return expected(self._whole, rows)

    def predict_jointly(self, landmarks: IntArray) -> PredictedObservations:
        """Predicted observations z (c, 2) of landmarks (c,), with joint covariance (2c, 2c)."""
        robot, P = self.robot_state, self.marginal(landmarks)
        points = self._whole.state[len(robot) :].reshape(-1, 2)[self.rows(landmarks)]
        predicted, H = observe_with_errors(robot, points, self.range_errors)
        J = stack_jacobians(H)
        return PredictedObservations(predicted, J @ P @ J.T)

    def marginal(self, landmarks: IntArray) -> FloatArray:
        """(r + 2k, r + 2k) joint covariance of the robot and of landmarks (k,), in their order."""
        rows = self.rows(np.asarray(landmarks, np.int64))
        if (rows < 0).any():
            self.leave()
            rows = self._known_rows(np.asarray(landmarks, np.int64))
        return marginal(self.active, rows)

    def relative_position(self, a: int, b: int) -> tuple[FloatArray, FloatArray]:
        """Position (2,) of landmark a relative to landmark b.

        Returns:
            The position, followed by the systematic errors of the ranges where they are estimated;
            and their covariance, (2, 2) or (4, 4).
        """
        landmarks = np.array([a, b])
        C, f = self.marginal(landmarks), self.active
        r, errors = f.robot_size, RANGE_ERRORS if f.range_errors > 0 else 0
        J = np.zeros((2 + errors, len(C)))
        J[:2, r : r + 2], J[:2, r + 2 :] = np.eye(2), -np.eye(2)
        J[2:, r - errors : r] = np.eye(errors)
        points = f.state[r:].reshape(-1, 2)[self.rows(landmarks)]
        return np.append(points[0] - points[1], f.state[r - errors : r]), J @ C @ J.T

    def enter(self, inside: IntArray) -> None:
        """Works among the landmarks in these rows (k,), ascending, until `leave`.

        What steps among them change about the others is deferred. The pose and its covariance do
        not need it; methods that need the other landmarks leave first.
        """
        self.leave()
        self.submap = enter(self._whole, inside)

    def leave(self) -> None:
        """Brings the state of the whole map up to date, and works in it."""
        if self.submap is not None:
            submap, self.submap = self.submap, None
            self._whole = leave(self._whole, submap)

    def flush_early(self) -> None:
        """Adds delayed rows to some rows of the whole map, before a step has to add all."""
        now, rank = self._whole.now, len(self._whole.downdates)
        if self.submap is not None and (now.flushed > 0 or now.downdates > rank // 2):
            flush_rows(self._whole)

    @property
    def active(self) -> FilterState:
        """State in which a step works: the whole map, or a submap."""
        return self._whole if self.submap is None else self.submap.state

    @property
    def active_ids(self) -> IntArray:
        """(n,) ids of the landmarks in the rows of `active`, ascending."""
        f = self.active
        return f.ids[: f.now.landmarks]

    def rows(self, landmarks: IntArray) -> IntArray:
        """Rows in `active` of landmarks (k,), -1 for landmarks outside of it.

        Negative ids stay, and ids of landmarks that are yet to be added have the rows behind.
        """
        f = self.active
        if f.now.next_id == f.now.landmarks:  # none is missing
            return landmarks
        rows = np.empty(len(landmarks), np.int64)
        find_rows(f, landmarks, rows)
        return rows

    def _check_ids(self, landmark: IntArray) -> None:
        """Raises unless ids (k,) are of the map, new ones in their order, or negative."""
        free = np.maximum.accumulate(np.append(self.next_id - 1, landmark))[:-1] + 1  # (k,)
        self._known_rows(landmark[(landmark >= 0) & (landmark < self.next_id)])
        if (landmark > free).any():
            raise LogError(
                f"landmark: expected ids up to {int(free[landmark > free][0])}, "
                f"found {int(landmark[landmark > free][0])}"
            )

    def _known_rows(self, landmarks: IntArray) -> IntArray:
        """Rows in the whole map of landmarks (k,)."""
        ids = self.ids
        known = (np.append(ids, -1)[ids.searchsorted(landmarks)] == landmarks) & (landmarks >= 0)
        if not known.all():
            raise LogError(
                f"landmark: expected ids of the {len(ids)} landmarks of the map, "
                f"found {int(landmarks[~known][0])}"
            )
        return self.rows(landmarks)

    def _reserved(self, landmarks: int, rows: int) -> FilterState:
        """The active state, with room for new landmarks and delayed rows of this number."""
        state = with_capacity(self.active, landmarks, rows)
        if self.submap is None:
            self._whole = state
        else:
            self.submap.state = state
        return state

    @property
    def pose(self) -> FloatArray:
        """(3,) x, y in meters, heading in radians."""
        return self.active.state[:3].copy()

    @property
    def robot_state(self) -> FloatArray:
        """(r,) the pose and the further states of the robot."""
        return self.active.state[: self.active.robot_size].copy()

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3)."""
        covariance = np.empty((3, 3))
        write_pose(self.active, np.empty(3), covariance)
        return covariance

    @property
    def odometry_bias(self) -> FloatArray | None:
        """(3,) see `motions.SYSTEMATIC_ERRORS`; None where they are no part of the state."""
        return self.robot_state[3:6] if self.active.robot_size > 5 else None

    @property
    def range_errors(self) -> FloatArray | None:
        """(2,) scale error and offset of the ranges in meters; None where they are not estimated.

        The range of a landmark at distance q is expected as (1 + scale error) q + offset.
        """
        return self.robot_state[-2:] if self.active.range_errors > 0 else None

    def without_range_errors(self, z: FloatArray) -> FloatArray:
        """Observations (k, 2) as they would be without the estimated errors of their ranges."""
        if (errors := self.range_errors) is None:
            return z
        return np.stack([(z[:, 0] - errors[1]) / (1 + errors[0]), z[:, 1]], 1)

    def with_range_errors(self, z: FloatArray) -> FloatArray:
        """The inverse of `without_range_errors`."""
        if (errors := self.range_errors) is None:
            return z
        return np.stack([(1 + errors[0]) * z[:, 0] + errors[1], z[:, 1]], 1)

    def range_error_variances(self, z: FloatArray) -> FloatArray:
        """(k,) variances of the ranges of observations (k, 2) by the uncertain errors."""
        if (errors := self.range_errors) is None:
            return np.zeros(len(z))
        r = len(self.robot_state)
        C = self.marginal(np.empty(0, np.int64))[r - 2 : r, r - 2 : r]
        by_errors = np.stack([(z[:, 0] - errors[1]) / (1 + errors[0]), np.ones(len(z))], 1)
        return np.asarray(np.einsum("ki,ij,kj->k", by_errors, C, by_errors))

    @property
    def nonlinearity(self) -> float:
        """Root of the mean fraction of second-order terms in the variance of the innovations."""
        now = self.active.now
        count = now.nonlinear_updates
        return float(np.sqrt(now.nonlinearity / count)) if count > 0 else 0.0

    @property
    def ids(self) -> IntArray:
        """(N,) ids of the landmarks, ascending: the number of landmarks added before each."""
        whole = self._whole.ids[: self._whole.now.landmarks]
        if self.submap is None:
            return whole.copy()
        return np.append(whole, self.active_ids[len(self.submap.inside) :])

    @property
    def next_id(self) -> int:
        """Id of the landmark that is added next: the number of landmarks ever added."""
        return int(self.active.now.next_id)

    @property
    def landmarks(self) -> FloatArray:
        """(N, 2) meters, in the order of `ids`."""
        if self.submap is not None:
            return read(self._whole, self.submap)[0]
        f = self._whole
        return f.state[f.robot_size : state_size(f)].reshape(-1, 2).copy()

    @property
    def landmark_covariances(self) -> FloatArray:
        """(N, 2, 2) square meters."""
        if self.submap is not None:
            return read(self._whole, self.submap)[1]
        return landmark_blocks(self._whole)

    @property
    def state(self) -> FloatArray:
        """(3 + 2N,) the pose, then the landmarks (C.3)."""
        return np.concatenate([self.robot_state, self.landmarks.ravel()])

    @property
    def covariance(self) -> FloatArray:
        """(3 + 2N, 3 + 2N) of the whole state (C.4)."""
        if self.submap is not None:
            return dense(leave(*copy.deepcopy((self._whole, self.submap))))
        return dense(self._whole)

    def copy(self) -> Self:
        """An independent filter with the same state."""
        return copy.deepcopy(self)

    def __len__(self) -> int:
        return int(self._whole.now.landmarks) + (0 if self.submap is None else self.submap.added)

    def __repr__(self) -> str:
        x, y, theta = self.pose
        return f"EkfSlam({len(self)} landmarks, pose {x:.2f} {y:.2f} m {theta:.3f} rad)"
