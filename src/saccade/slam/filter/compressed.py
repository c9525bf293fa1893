"""Compressed EKF-SLAM: steps at a cost that does not grow with the map.

After Guivant & Nebot (2001): while the robot stays among some landmarks A, the changes of the
others B are linear in their covariance with A at its arrival. With J a quarter turn,
E = [C_BA, J C_BA, d, J d] of that time, d the differences of the points of B from their first
estimates, at any later time

    C_BA = E Phi,    C_BB <- C_BB + E Psi E^T,    d = E delta.

Phi, Psi and delta change as the covariances with A, the covariance and the state of landmarks
that are never observed. Thus the filter of `ekf` on A and on as many of these auxiliary landmarks
as A has coordinates is equivalent to the full filter, and the update of B is deferred.
"""

import numpy as np

from saccade.slam.filter._state_kernels import LANDMARKS, STANDARD, FilterState, is_spread_due
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import (
    add_rows,
    flush,
    new_state,
    state_rows,
    state_size,
    symmetric,
)
from saccade.slam.filter.validation import check_landmark
from saccade.slam.results import Innovation, PredictedObservations
from saccade.types import FloatArray, IntArray

SPARE = 16
"""Landmarks that can be added to a neighborhood before another one is entered; or as many as it
began with, if that is more."""
NEGLIGIBLE = 1e-15
"""Fraction of the largest eigenvalue of Psi below which others are rounding."""


class CompressedSlam:
    """`EkfSlam` that updates the neighborhood of the robot, and the other landmarks later.

    Methods and properties are those of `EkfSlam`, with equal results up to rounding. Those of
    the whole map bring all of it up to date.

    Args:
        ekf: the filter to begin with; it is owned by this one from then on.
        radius: metres around the robot within which landmarks belong to its neighborhood.
            An observation of another one moves the neighborhood to where the robot is.
    """

    def __init__(self, ekf: EkfSlam, radius: float) -> None:
        self._whole = ekf
        self._radius = radius
        self._enter(np.empty(0, np.int64))

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """See `EkfSlam.predict`."""
        if is_spread_due(self._local.filter_state):
            self._leave()
            self._whole.spread()
            self._enter(np.array(list(self._number), np.int64))
        self._local.predict(u, U)

    def update(self, z: FloatArray, R: FloatArray, landmark: int) -> Innovation:
        """See `EkfSlam.update`."""
        number = self._local_number(landmark)
        return self._local.update(z, R, number)

    def innovation(self, z: FloatArray, R: FloatArray, landmark: int) -> Innovation:
        """See `EkfSlam.innovation`."""
        number = self._local_number(landmark)
        return self._local.innovation(z, R, number)

    def augment(self, z: FloatArray, R: FloatArray) -> int:
        """See `EkfSlam.augment`; the landmark belongs to the neighborhood."""
        if len(self._number) >= self._capacity:
            self._leave()
            self._enter(np.empty(0, np.int64))
        new = len(self)
        self._number[new] = self._local.augment(z, R)
        return new

    def predict_observations(self) -> PredictedObservations:
        """See `EkfSlam.predict_observations`."""
        return self.whole.predict_observations()

    def marginal(self, landmarks: IntArray) -> FloatArray:
        """The joint covariance of the robot and of some landmarks (3 + 2k, 3 + 2k)."""
        if all(int(each) in self._number for each in landmarks):
            return self._local.marginal(np.array([self._number[int(each)] for each in landmarks]))
        return self.whole.marginal(landmarks)

    @property
    def whole(self) -> EkfSlam:
        """The filter over the whole map, up to date until the next step."""
        self._leave()
        self._enter(np.array(list(self._number), np.int64))
        return self._whole

    @property
    def neighborhood(self) -> IntArray:
        """Numbers of the landmarks in it."""
        return np.array(sorted(self._number), np.int64)

    @property
    def pose(self) -> FloatArray:
        """(3,) x, y in metres, heading in radians."""
        return self._local.pose

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3)."""
        return self._local.pose_covariance

    @property
    def landmarks(self) -> FloatArray:
        """(N, 2) metres, in the order in which they were augmented."""
        return self.whole.landmarks

    @property
    def landmark_covariances(self) -> FloatArray:
        """(N, 2, 2) square metres."""
        return self.whole.landmark_covariances

    @property
    def state(self) -> FloatArray:
        """(3 + 2N,) the pose, then the landmarks (C.3)."""
        return self.whole.state

    @property
    def covariance(self) -> FloatArray:
        """(3 + 2N, 3 + 2N) of the whole state (C.4)."""
        return self.whole.covariance

    def __len__(self) -> int:
        return len(self._number) + len(self._rest)

    def __repr__(self) -> str:
        return f"CompressedSlam({len(self._number)} of {len(self)} landmarks, {self._local!r})"

    def _local_number(self, landmark: int) -> int:
        """The number of a landmark in the neighborhood, after a move if it was outside."""
        check_landmark(landmark, len(self))
        if landmark not in self._number:
            self._leave()
            self._enter(np.array([landmark]))
        return self._number[landmark]

    def _enter(self, required: IntArray) -> None:
        """Make a neighborhood of the landmarks around the robot and of the required ones."""
        f, r = self._whole.filter_state, self._whole.filter_state.robot_size
        flush(f)
        offset = self._whole.landmarks - f.state[:2]
        near = np.hypot(offset[:, 0], offset[:, 1]) <= self._radius
        near[required] = True
        inside, self._rest = np.flatnonzero(near), np.flatnonzero(~near)
        rows, rest = state_rows(inside, r), state_rows(self._rest, r)[r:]
        L, k = len(rows), len(inside)
        self._number = {number: i for i, number in enumerate(inside.tolist())}
        self._capacity = k + max(k, SPARE)
        self._auxiliary = np.arange(k, k + L + 1)

        self._E = np.empty((len(rest), L + 1, 2))
        self._E[:, :L, 0] = _block(f, rest, rows)
        self._E[:, L, 0] = _quarter_turn(-f.heading_lever[rest])  # d = -J a
        self._E[:, :L, 1] = _quarter_turn(self._E[:, :L, 0])
        self._E[:, L, 1] = f.heading_lever[rest]

        capacity = self._capacity + L + 1
        local = new_state(f.state[:r], f.P[:r, :r], capacity, f.error_state, f.huber)
        local.state[:L], local.heading_lever[:L] = f.state[rows], f.heading_lever[rows]
        local.P[:L, :L] = _block(f, rows, rows)
        local.blocks[:k] = f.blocks[inside]
        local.blocks[self._auxiliary] = np.inf  # of no variance that an update could exhaust
        local.P[np.arange(L), L + 2 * np.arange(L)] = 1.0
        local.state[3 * L] = 1.0
        local.heading_lever[3 * L + 1] = 0.0 if f.error_state == STANDARD else 1.0
        local.heading_variance[:] = f.heading_variance
        local.nonlinearity[:] = f.nonlinearity
        local.counts[LANDMARKS] = k + L + 1
        self._local = self._whole.with_filter_state(local)

    def _leave(self) -> None:
        """Bring the whole filter up to date."""
        local, r = self._local.filter_state, self._local.filter_state.robot_size
        flush(local)
        C = symmetric(local.P[: state_size(local), : state_size(local)])
        self._whole.reserve(len(self) - len(self._whole))
        f = self._whole.filter_state
        f.counts[LANDMARKS] = len(self)
        f.heading_variance[:] = local.heading_variance
        f.nonlinearity[:] = local.nonlinearity
        inside = np.array(list(self._number), np.int64)
        numbers = np.array(list(self._number.values()), np.int64)
        rows, local_rows = state_rows(inside, r), state_rows(numbers, r)
        f.state[rows] = local.state[local_rows]
        f.heading_lever[rows] = local.heading_lever[local_rows]
        f.blocks[inside] = local.blocks[numbers]
        _set_block(f, rows, rows, C[np.ix_(local_rows, local_rows)])
        if len(self._rest) > 0:
            self._apply_deferred(f, C, rows, local_rows)

    def _apply_deferred(
        self, f: FilterState, C: FloatArray, rows: IntArray, local_rows: IntArray
    ) -> None:
        """Apply the deferred updates to the landmarks outside the neighborhood."""
        r = f.robot_size
        rest, auxiliary = state_rows(self._rest, r)[r:], state_rows(self._auxiliary, r)[r:]
        E = self._E.reshape(len(rest), -1)
        _set_block(f, rest, rows, E @ C[np.ix_(auxiliary, local_rows)])  # C_BA
        delta = self._local.filter_state.state[auxiliary]
        f.heading_lever[rest] = _quarter_turn(E @ delta) if f.error_state != STANDARD else 0.0
        delta[-2] -= 1.0
        f.state[rest] += E @ delta
        values, vectors = np.linalg.eigh(C[np.ix_(auxiliary, auxiliary)])  # Psi
        kept = np.abs(values) > NEGLIGIBLE * np.abs(values).max()
        Y = np.zeros((kept.sum(), state_size(f)))
        Y[:, rest] = (E @ (vectors[:, kept] * np.sqrt(np.abs(values[kept])))).T
        add_rows(f, -1.0, Y[values[kept] < 0])
        add_rows(f, 1.0, Y[values[kept] > 0])


def _quarter_turn(points: FloatArray) -> FloatArray:
    """J x of points x, whose coordinates alternate along the first axis."""
    turned = np.empty_like(points)
    turned[::2], turned[1::2] = -points[1::2], points[::2]
    return turned


def _block(f: FilterState, rows: IntArray, columns: IntArray) -> FloatArray:
    i, j = rows[:, None], columns
    return f.P[np.minimum(i, j), np.maximum(i, j)]


def _set_block(f: FilterState, rows: IntArray, columns: IntArray, block: FloatArray) -> None:
    i, j = rows[:, None], columns
    f.P[np.minimum(i, j), np.maximum(i, j)] = block
    r = f.robot_size
    f.P[:r, :r] = symmetric(f.P[:r, :r])
