"""The same filter at a cost that does not grow with the map.

After Guivant & Nebot (2001): while the robot stays among some landmarks A, all that it does
to the others B is linear in what they had in common with A when it came. With J a quarter
turn, E = [C_BA, J C_BA, d, J d] of that time, d how far each point of B is from where it
was first, at any later time

    C_BA = E Phi,    C_BB <- C_BB + E Psi E^T,    d = E delta.

Phi, Psi and delta change as the covariances with A, the covariance and the state of
landmarks would: they are landmarks that are never seen. Thus the filter of `ekf` on A and
on as many of them as A has coordinates is the whole filter, and B waits.
"""

import copy

import numpy as np

from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import (
    LANDMARKS,
    STANDARD,
    FilterState,
    add_rows,
    flush,
    grown,
    new_state,
    size_of,
    symmetric,
)
from saccade.slam.filter.validation import check_landmark
from saccade.slam.results import Innovation, PredictedObservations
from saccade.types import FloatArray, IntArray

SPARE = 16
"""New landmarks that a neighborhood takes at least before another one is made; or as many as
it began with, if that is more."""
NEGLIGIBLE = 1e-15
"""Share of the largest eigenvalue of Psi under which another one is its rounding."""


class CompressedSlam:
    """`EkfSlam` that works in the neighborhood of the robot and brings the rest up to date later.

    Every method and property means what it means there, and gives the same but for
    rounding. What asks for the whole map brings all of it up to date.

    Args:
        ekf: the filter to begin with; it is taken over.
        radius: metres around the robot within which landmarks belong to its neighborhood.
            An observation of another one moves the neighborhood to where the robot is.
    """

    def __init__(self, ekf: EkfSlam, radius: float) -> None:
        self._whole = ekf
        self._radius = radius
        self._enter(np.empty(0, np.int64))

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Move the robot (C.5-C.9)."""
        self._local.predict(u, U)

    def update(self, z: FloatArray, R: FloatArray, landmark: int) -> Innovation:
        """Correct the state by an observation of a landmark of the map (C.10-C.14)."""
        number = self._local_number(landmark)
        return self._local.update(z, R, number)

    def innovation(self, z: FloatArray, R: FloatArray, landmark: int) -> Innovation:
        """What `update` would find."""
        number = self._local_number(landmark)
        return self._local.innovation(z, R, number)

    def augment(self, z: FloatArray, R: FloatArray) -> int:
        """Take a new landmark into the map (C.15-C.18), and into the neighborhood."""
        if len(self._number) >= self._most:
            self._leave()
            self._enter(np.empty(0, np.int64))
        new = len(self)
        self._number[new] = self._local.augment(z, R)
        return new

    def predict_observations(self) -> PredictedObservations:
        """What should be seen of every landmark from here."""
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
        """The number of a landmark in the neighborhood, which moves if it is not there."""
        check_landmark(landmark, len(self))
        if landmark not in self._number:
            self._leave()
            self._enter(np.array([landmark]))
        return self._number[landmark]

    def _enter(self, wanted: IntArray) -> None:
        """Make a neighborhood of the landmarks around the robot and of those wanted."""
        b, r = self._whole._filter_state, len(self._whole._robot)
        flush(b)
        apart = self._whole.landmarks - b.state[:2]
        near = np.hypot(apart[:, 0], apart[:, 1]) <= self._radius
        near[wanted] = True
        here, self._rest = np.flatnonzero(near), np.flatnonzero(~near)
        rows, rest = _rows(here, r), _rows(self._rest, r)[r:]
        L = len(rows)
        self._number = {number: i for i, number in enumerate(here.tolist())}
        self._most = len(here) + max(len(here), SPARE)
        self._waiting = range(len(here), len(here) + L + 1)

        self._E = np.empty((len(rest), L + 1, 2))
        self._E[:, :L, 0] = _block(b, rest, rows)
        self._E[:, L, 1] = b.heading_lever[rest]
        self._E[:, L, 0] = _turned(-b.heading_lever[rest])  # d = -J a
        self._E[:, :L, 1] = _turned(self._E[:, :L, 0])
        self._E[:, L, 1] = b.heading_lever[rest]

        local = new_state(b.state[:r], b.P[:r, :r], self._most + L + 1)
        local.state[:L], local.heading_lever[:L], local.P[:L, :L] = (
            b.state[rows],
            b.heading_lever[rows],
            _block(b, rows, rows),
        )
        local.blocks[: len(here)] = b.blocks[here]
        local.blocks[len(here) : len(here) + L + 1] = np.inf  # has no variance that could run out
        local.P[np.arange(L), L + 2 * np.arange(L)] = 1.0
        local.state[3 * L] = 1.0
        local.heading_lever[3 * L + 1] = 0.0 if self._whole._retraction == STANDARD else 1.0
        local.counts[LANDMARKS] = len(here) + L + 1
        self._local = copy.copy(self._whole)
        self._local._filter_state = local

    def _leave(self) -> None:
        """Bring the whole filter up to date."""
        local, r = self._local._filter_state, len(self._whole._robot)
        flush(local)
        C = symmetric(local.P[: size_of(local), : size_of(local)])
        while len(self) > len(self._whole._filter_state.blocks):
            self._whole._filter_state = grown(self._whole._filter_state)
        b = self._whole._filter_state
        b.counts[LANDMARKS] = len(self)
        here = np.array(list(self._number), np.int64)
        numbers = np.array(list(self._number.values()), np.int64)
        rows, theirs = _rows(here, r), _rows(numbers, r)
        b.state[rows], b.heading_lever[rows] = local.state[theirs], local.heading_lever[theirs]
        b.blocks[here] = local.blocks[numbers]
        _put(b, rows, rows, C[np.ix_(theirs, theirs)])
        if len(self._rest) > 0:
            self._apply_deferred(b, C, rows, theirs)

    def _apply_deferred(
        self, b: FilterState, C: FloatArray, rows: IntArray, theirs: IntArray
    ) -> None:
        """Do to the landmarks that waited what was done in the meantime."""
        r, rest = len(b.workspace), _rows(self._rest, len(b.workspace))[len(b.workspace) :]
        waiting = _rows(np.array(self._waiting), r)[r:]
        E = self._E.reshape(len(rest), -1)
        _put(b, rest, rows, E @ C[np.ix_(waiting, theirs)])  # C_BA
        delta = self._local._filter_state.state[waiting]
        b.heading_lever[rest] = _turned(E @ delta) if self._whole._retraction != STANDARD else 0.0
        delta[-2] -= 1.0
        b.state[rest] += E @ delta
        values, vectors = np.linalg.eigh(C[np.ix_(waiting, waiting)])  # Psi
        kept = np.abs(values) > NEGLIGIBLE * np.abs(values).max()
        Y = np.zeros((kept.sum(), size_of(b)))
        Y[:, rest] = (E @ (vectors[:, kept] * np.sqrt(np.abs(values[kept])))).T
        add_rows(b, -1.0, Y[values[kept] < 0])
        add_rows(b, 1.0, Y[values[kept] > 0])


def _rows(landmarks: IntArray, r: int) -> IntArray:
    """Rows of the robot and of some landmarks."""
    return np.append(np.arange(r), (r + 2 * landmarks[:, None] + [0, 1]).ravel())


def _turned(points: FloatArray) -> FloatArray:
    """J x of points x, whose coordinates alternate along the first axis."""
    turned = np.empty_like(points)
    turned[::2], turned[1::2] = -points[1::2], points[::2]
    return turned


def _block(b: FilterState, rows: IntArray, columns: IntArray) -> FloatArray:
    i, j = rows[:, None], columns
    return b.P[np.minimum(i, j), np.maximum(i, j)]


def _put(b: FilterState, rows: IntArray, columns: IntArray, block: FloatArray) -> None:
    i, j = rows[:, None], columns
    b.P[np.minimum(i, j), np.maximum(i, j)] = block
    r = len(b.workspace)
    b.P[:r, :r] = symmetric(b.P[:r, :r])
