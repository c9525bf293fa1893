"""EKF-SLAM: predict, update, augment (C.1-C.18)."""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.errors import LogError
from saccade.slam.models import RANGE_BEARING, Motion, Sensor, drive, wrapped
from saccade.slam.retraction import STANDARD, Retraction
from saccade.types import FloatArray

FIRST_CAPACITY = 32
"""Landmarks for which there is room at first; doubled whenever it runs out."""
LARGEST = 1e9
"""Metres or radians; numbers beyond it are no measurements, and their squares may overflow."""
SINGULAR = 1e-13
"""An innovation variance under this share of the terms that it is the sum of counts as zero."""
ROUNDING = 1e-9
"""No correction can take more than the whole variance; what would by more than this share is
the rounding of a variance that is none."""
TINY = 1e-100
"""Square metres or radians; variances under it are zero."""


class Innovation(NamedTuple):
    """What an observation said beyond what was expected."""

    value: FloatArray
    """(2,) observed less expected: range and bearing, or map coordinates (see `Retraction`)."""
    covariance: FloatArray
    """(2, 2) S of C.11, before the update."""
    nis: float
    """Normalized innovation squared; chi-square with two degrees if the filter is right."""


class Expectation(NamedTuple):
    """What the filter expects to see of every landmark."""

    z: FloatArray
    """(n, 2) expected observations."""
    covariance: FloatArray
    """(n, 2, 2) H P H^T of each, without the noise of an observation."""


class EkfSlam:
    """The pose of a robot and the landmarks around it, as one Gaussian.

    The state is s = (x, y, theta, m1x, m1y, ..., mNx, mNy) (C.3); of the
    covariance P (C.4) the upper triangle is kept, so that it cannot become
    asymmetric, in one buffer that doubles when it is full.

    Args:
        pose: (3,) x, y in metres, heading in radians.
        covariance: (3, 3) of the pose; zero where the pose defines the frame.
        motion: the motion model; `drive` (C.5-C.9) unless told otherwise.
        sensor: the sensor model; range and bearing (C.14-C.18) unless told otherwise.
        retraction: how errors are measured; `Standard`, the source's, unless told otherwise.

    Raises:
        LogError: here and in every method, an argument of the wrong shape, one that
            holds NaN or infinity, or a covariance that is not one. The state
            stays as it was.
    """

    def __init__(
        self,
        pose: FloatArray,
        covariance: FloatArray,
        motion: Motion = drive,
        sensor: Sensor = RANGE_BEARING,
        retraction: Retraction = STANDARD,
    ) -> None:
        self._motion = motion
        self._sensor = sensor
        self._retraction = retraction
        self._count = 0
        self._s = np.zeros(3 + 2 * FIRST_CAPACITY)
        self._P = np.zeros((len(self._s), len(self._s)))
        self._s[:3] = _vector("pose", pose, 3)
        self._s[2] = wrapped(self._s[2])
        self._P[:3, :3] = _covariance("covariance of the pose", covariance, 3)

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Move the robot (C.5-C.9).

        Args:
            u: (c,) control of the motion model; (distance, turn) for `drive`.
            U: (c, c) its covariance.
        """
        u = _vector("control", u)
        U = _covariance("covariance of the control", U, len(u))
        n, s, P = self._size, self._s, self._P
        moved, Fx, Fu = self._motion(s[:3], u)
        Pxx = Fx @ _symmetric(P[:3, :3]) @ Fx.T + Fu @ U @ Fu.T  # C.7, (3, 3)
        s[:3] = moved  # C.5
        P[:3, 3:n] = Fx @ P[:3, 3:n]  # C.7, (3, 2N); Pmm stays
        P[:3, :3] = (Pxx + Pxx.T) / 2

    def update(self, z: FloatArray, R: FloatArray, landmark: int) -> Innovation:
        """Correct the state by an observation of a landmark of the map (C.10-C.14).

        Only the columns of the robot and of this landmark take part in the
        gain. Where the innovation covariance is singular, the directions that
        have no variance are left as they are.

        Args:
            z: (2,) range in metres and bearing in radians.
            R: (2, 2) its covariance.
            landmark: number of the landmark in the map.

        Returns:
            The innovation, its covariance, and its normalized square.
        """
        self._check(landmark)
        z = _vector("observation", z, 2)
        R = _covariance("covariance of the observation", R, 2)
        n, s, P, m = self._size, self._s, self._P, 3 + 2 * landmark
        v, H, noise = self._retraction.linearize(self._sensor, s[:3], s[m : m + 2], z, R)  # C.14
        HP = np.empty((2, n))
        _observed_rows(P, m, H, HP)
        S = HP[:, :3] @ H[:, :3].T + HP[:, m : m + 2] @ H[:, 3:].T + noise  # C.11, (2, 2)
        sigma = np.sqrt(np.abs(P.diagonal()[[0, 1, 2, m, m + 1]]))
        size = (np.abs(H) @ sigma) ** 2 + noise.diagonal()
        A = _whitening(S, size)  # A S A^T = 1, thus S^-1 = A^T A
        V = A @ HP  # (2, n); the gain of C.12 is W = V^T A, and W S W^T = V^T V
        V[:, np.square(V).sum(0) > P.diagonal()[:n] * (1 + ROUNDING)] = 0.0
        white = A @ v
        s[:n], D = self._retraction.apply(s[:n], white @ V)  # C.10
        s[2] = wrapped(s[2])
        if D is None:
            _add_product(P, -V, V)  # C.13
        else:
            heading = np.concatenate([P[:2, 2], P[2, 2:n]]) - V[:, 2] @ V  # (n,) after C.13
            a = heading + heading[2] / 2 * D
            _add_product(P, np.vstack([-V, D, a]), np.vstack([V, a, D]))  # C.13, then transport
        return Innovation(v, S, float(white @ white))

    def innovation(self, z: FloatArray, R: FloatArray, landmark: int) -> Innovation:
        """What `update` would find, at a cost that does not grow with the map.

        A robust caller looks here first, and then updates with a covariance R as much
        larger as the innovation deserves.

        Args:
            z: (2,) range in metres and bearing in radians.
            R: (2, 2) its covariance.
            landmark: number of the landmark in the map.
        """
        self._check(landmark)
        z = _vector("observation", z, 2)
        R = _covariance("covariance of the observation", R, 2)
        m = 3 + 2 * landmark
        place = [0, 1, 2, m, m + 1]
        s, P = self._s, _symmetric(self._P[np.ix_(place, place)])  # (5, 5)
        v, H, noise = self._retraction.linearize(self._sensor, s[:3], s[m : m + 2], z, R)  # C.14
        S = H @ P @ H.T + noise  # C.11
        white = _whitening(S, (np.abs(H) @ np.sqrt(np.abs(P.diagonal()))) ** 2 + noise.diagonal())
        return Innovation(v, S, float(np.square(white @ v).sum()))

    def augment(self, z: FloatArray, R: FloatArray) -> int:
        """Take a new landmark into the map (C.15-C.18).

        Args:
            z: (2,) range in metres and bearing in radians.
            R: (2, 2) its covariance.

        Returns:
            The landmark's number in the map.
        """
        z = _vector("observation", z, 2)
        R = _covariance("covariance of the observation", R, 2)
        n = self._size
        if n == len(self._s):
            self._grow()
        s, P = self._s, self._P
        s[n : n + 2], Gx, Gz = self._sensor.place(s[:3], z)  # C.15, C.16
        Pxx = _symmetric(P[:3, :3])
        P[:3, n : n + 2] = Pxx @ Gx.T  # C.17, (3, 2)
        P[3:n, n : n + 2] = P[:3, 3:n].T @ Gx.T  # C.17, (2N, 2)
        Pnn = Gx @ Pxx @ Gx.T + Gz @ R @ Gz.T  # C.17, (2, 2)
        P[n : n + 2, n : n + 2] = (Pnn + Pnn.T) / 2
        self._count += 1
        return self._count - 1

    def expect(self) -> Expectation:
        """What should be seen of every landmark from here, for the association."""
        n, N = self._size, self._count
        z, H = self._sensor.observe(self._s[:3], self._s[3:n].reshape(N, 2))
        Hx, Hm = H[..., :3], H[..., 3:]  # (N, 2, 3), (N, 2, 2)
        Pxm = self._P[:3, 3:n].reshape(3, N, 2).transpose(1, 0, 2)  # (N, 3, 2)
        cross = Hx @ Pxm @ Hm.transpose(0, 2, 1)  # (N, 2, 2)
        own = Hm @ self.landmark_covariances @ Hm.transpose(0, 2, 1)
        robot = Hx @ _symmetric(self._P[:3, :3]) @ Hx.transpose(0, 2, 1)
        return Expectation(z, robot + cross + cross.transpose(0, 2, 1) + own)

    @property
    def pose(self) -> FloatArray:
        """(3,) x, y in metres, heading in radians."""
        return self._s[:3].copy()

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3)."""
        return _symmetric(self._P[:3, :3])

    @property
    def landmarks(self) -> FloatArray:
        """(N, 2) metres, in the order in which they were augmented."""
        return self._s[3 : self._size].reshape(-1, 2).copy()

    @property
    def landmark_covariances(self) -> FloatArray:
        """(N, 2, 2) square metres."""
        i = np.arange(3, self._size, 2)
        rows, columns = np.array([[0, 0], [0, 1]]), np.array([[0, 1], [1, 1]])
        return np.asarray(self._P[i[:, None, None] + rows, i[:, None, None] + columns])

    @property
    def state(self) -> FloatArray:
        """(3 + 2N,) the pose, then the landmarks (C.3)."""
        return self._s[: self._size].copy()

    @property
    def covariance(self) -> FloatArray:
        """(3 + 2N, 3 + 2N) of the whole state (C.4)."""
        return _symmetric(self._P[: self._size, : self._size])

    @property
    def motion(self) -> Motion:
        """The motion model."""
        return self._motion

    @property
    def sensor(self) -> Sensor:
        """The sensor model."""
        return self._sensor

    def __len__(self) -> int:
        return self._count

    def __repr__(self) -> str:
        x, y, theta = self._s[:3]
        return f"EkfSlam({self._count} landmarks, pose {x:.2f} {y:.2f} m {theta:.3f} rad)"

    @property
    def _size(self) -> int:
        return 3 + 2 * self._count

    def _check(self, landmark: int) -> None:
        if not 0 <= landmark < self._count:
            raise LogError(
                f"landmark: expected a number from 0 to {self._count - 1} of a map of "
                f"{self._count} landmarks, found {landmark}"
            )

    def _grow(self) -> None:
        n = self._size
        s, P = self._s, self._P
        self._s = np.zeros(3 + 2 * (n - 3))
        self._P = np.zeros((len(self._s), len(self._s)))
        self._s[:n], self._P[:n, :n] = s, P


@kernel()
def _observed_rows(P: FloatArray, m: int, H: FloatArray, HP: FloatArray) -> None:
    """Fill HP (2, n) from P's upper triangle; H (2, 5) is by the pose and rows m and m + 1."""
    n = HP.shape[1]
    HP[:] = 0.0
    for k in range(2):
        for c in range(5):
            h = H[k, c]
            row = c if c < 3 else m + c - 3
            for i in range(row):
                HP[k, i] += h * P[i, row]
            for i in range(row, n):
                HP[k, i] += h * P[row, i]


@kernel(fastmath=("contract",))
def _add_product(P: FloatArray, X: FloatArray, Y: FloatArray) -> None:
    """Add X^T Y, X and Y (k, n) and k even, to the upper triangle of P's first n rows."""
    k, n = X.shape
    for i in range(n):
        row = P[i, i:n]
        for m in range(0, k, 2):
            a, b = X[m, i], X[m + 1, i]
            first, second = Y[m, i:], Y[m + 1, i:]
            for j in range(len(row)):
                row[j] += a * first[j] + b * second[j]


def _symmetric(upper: FloatArray) -> FloatArray:
    full = np.triu(upper)
    return full + np.triu(full, 1).T


def _whitening(S: FloatArray, size: FloatArray) -> FloatArray:
    """A (2, 2) with A S A^T = 1 on the directions in which S has a variance.

    `size` (2,) is how large S's diagonal could be if nothing canceled in it: what is left
    of that by rounding is no variance.
    """
    try:
        L = np.linalg.cholesky(S)
        if (L.diagonal() ** 2 > SINGULAR * size + TINY).all():
            return np.linalg.inv(L)
    except np.linalg.LinAlgError:
        pass
    scale = 1 / np.sqrt(np.where(size > TINY, size, 1.0))
    values, vectors = np.linalg.eigh((S + S.T) / 2 * np.outer(scale, scale))
    root = np.where(values > SINGULAR, 1 / np.sqrt(np.maximum(values, SINGULAR)), 0.0)
    return np.asarray(root[:, None] * vectors.T * scale)


def _vector(name: str, value: FloatArray, size: int | None = None) -> FloatArray:
    array = np.asarray(value, np.float64)
    if array.ndim != 1 or (size is not None and len(array) != size):
        raise LogError(f"{name}: expected {size or 'some'} numbers, found shape {array.shape}")
    if not (np.abs(array) < LARGEST).all():  # NaN is not under anything
        raise LogError(f"{name}: expected numbers within {LARGEST:g}, found {array.tolist()}")
    return array


def _covariance(name: str, value: FloatArray, size: int) -> FloatArray:
    matrix = np.asarray(value, np.float64)
    if matrix.shape != (size, size):
        raise LogError(f"{name}: expected shape {(size, size)}, found {matrix.shape}")
    largest = np.abs(matrix).max()
    if not largest < LARGEST**2:
        raise LogError(f"{name}: expected numbers within {LARGEST**2:g}, found {matrix.tolist()}")
    if (
        np.abs(matrix - matrix.T).max() > 1e-9 * largest
        or np.linalg.eigvalsh(matrix)[0] < -1e-9 * largest
    ):
        raise LogError(
            f"{name}: expected a symmetric matrix without negative eigenvalues, "
            f"found {matrix.tolist()}"
        )
    return matrix
