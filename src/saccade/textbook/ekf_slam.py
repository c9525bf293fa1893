"""Appendix C: EKF-SLAM, equations C.1-C.18.

In the symbols of the source, x = (x, y, theta) is the pose of the robot, m the map, s = (x, m) the
state, P its covariance. The control u = (d, phi), of covariance U: turn by phi, translate by d.
The observation z = (r, bearing), of covariance R, is relative to the pose. Meters and radians,
counter-clockwise. The source defines f, h and g through their Jacobians.
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, pi, remainder, sin

import numpy as np
from numpy.typing import ArrayLike

from saccade.errors import require
from saccade.types import FloatArray


@dataclass(frozen=True, eq=False)
class Prediction:
    """Prediction of the state with N landmarks, and its intermediate results."""

    s: FloatArray
    """(3 + 2N,) predicted state."""
    P: FloatArray
    """(3 + 2N, 3 + 2N) predicted covariance."""
    Fx: FloatArray
    """(3, 3) Jacobian of f by the pose."""
    Fu: FloatArray
    """(3, 2) Jacobian of f by the control."""
    Q: FloatArray
    """(3, 3) process noise: covariance that the control adds to the pose."""


@dataclass(frozen=True, eq=False)
class Update:
    """Update by the observation of a known landmark, and its intermediate results."""

    innovation: FloatArray
    """(2,) z - h(x, m), its bearing wrapped."""
    H: FloatArray
    """(2, 3 + 2N) Jacobian of h by the state."""
    S: FloatArray
    """(2, 2) covariance of the innovation."""
    W: FloatArray
    """(3 + 2N, 2) Kalman gain."""
    s: FloatArray
    """(3 + 2N,) updated state."""
    P: FloatArray
    """(3 + 2N, 3 + 2N) updated covariance."""


@dataclass(frozen=True, eq=False)
class Augmentation:
    """Augmentation by a new landmark, the last of N, and its intermediate results."""

    landmark: FloatArray
    """(2,) its position."""
    Gx: FloatArray
    """(2, 3) Jacobian of g by the pose."""
    Gz: FloatArray
    """(2, 2) Jacobian of g by the observation."""
    Pmx: FloatArray
    """(2, 1 + 2N) cross-covariance of the landmark and the state before it."""
    Pmm_new: FloatArray
    """(2, 2) covariance of the landmark."""
    s: FloatArray
    """(3 + 2N,) augmented state."""
    P: FloatArray
    """(3 + 2N, 3 + 2N) augmented covariance."""


def f(x: FloatArray, u: FloatArray) -> FloatArray:
    """Motion model: the pose after control u, (3,); corrected: w of C.1 has covariance Q, not U."""
    d, beta = u[0], x[2] + u[1]
    return np.array([x[0] + d * cos(beta), x[1] + d * sin(beta), wrap(beta)])  # C.1


def h(x: FloatArray, m: FloatArray) -> FloatArray:
    """Observation model: range and bearing of the landmark at m, (2,)."""
    dx, dy = x[0] - m[0], x[1] - m[1]
    return np.array([hypot(dx, dy), wrap(atan2(-dy, -dx) - x[2])])  # C.2


class EkfSlam:
    """Joint Gaussian of the robot and N landmarks, with mean s and covariance P.

    The initial pose is x0, (3,), with covariance P0, (3, 3). Values with a wrong shape, or not
    finite, raise `ConfigError`.

    Examples:
        >>> slam = EkfSlam()
        >>> augmented = slam.augment(z=[2, 0], R=np.diag([0.01, 0.01]))  # landmark at 2 m
        >>> predicted = slam.predict(u=[1, 0], U=np.diag([0.02, 0.01]))  # about 1 m
        >>> updated = slam.update(0, z=[0.6, 0], R=np.diag([0.01, 0.01]))  # now at 0.6 m
        >>> print(slam.x, slam.m)
        [1.2 0.  0. ] [[1.9 0. ]]
    """

    def __init__(self, x0: ArrayLike = (0, 0, 0), P0: ArrayLike = ((0, 0, 0),) * 3) -> None:
        self.s = checked("x0", x0, 3)  # C.3 (corrected: x has length 3)
        self.P = checked("P0", P0, 3, 3)  # C.4

    x = property(lambda self: self.s[:3], doc="(3,) Pose of the robot.")  # C.3
    m = property(lambda self: self.s[3:].reshape(-1, 2), doc="(N, 2) Map.")  # C.3
    N = property(lambda self: len(self.m), doc="Number of landmarks.")
    Pxx = property(lambda self: self.P[:3, :3], doc="(3, 3) Covariance of the pose.")  # C.4
    Pxm = property(lambda self: self.P[:3, 3:], doc="(3, 2N) Of pose and map.")  # C.4
    Pmm = property(lambda self: self.P[3:, 3:], doc="(2N, 2N) Of the map.")  # C.4

    def predict(self, u: ArrayLike, U: ArrayLike) -> Prediction:
        """Prediction step: the robot has moved by u, (2,), of covariance U, (2, 2)."""
        u, U = checked("u", u, 2), checked("U", U, 2, 2)
        x, Pxx, Pxm, Pmm = self.x, self.Pxx, self.Pxm, self.Pmm
        Fx, Fu = grad_f_x(x, u), grad_f_u(x, u)
        Q = Fu @ U @ Fu.T  # C.7
        self.s = np.concatenate([f(x, u), self.m.ravel()])  # C.5
        self.P = np.block([[Fx @ Pxx @ Fx.T + Q, Fx @ Pxm], [Pxm.T @ Fx.T, Pmm]])  # C.6
        return Prediction(self.s, self.P, Fx, Fu, Q)

    def update(self, landmark_index: int, z: ArrayLike, R: ArrayLike) -> Update:
        """Update step: a landmark of the map is observed at z, (2,), of covariance R, (2, 2)."""
        i, z, R = landmark_index, checked("z", z, 2), checked("R", R, 2, 2)
        require(0 <= i < self.N, "landmark_index", f"one of {self.N} landmarks", i)
        H = np.zeros((2, len(self.s)))
        H[:, :3], H[:, 3 + 2 * i : 5 + 2 * i] = np.hsplit(grad_h(self.x, self.m[i]), [3])
        S = H @ self.P @ H.T + R  # C.12
        W = self.P @ H.T @ np.linalg.inv(S)  # C.13
        innovation = z - h(self.x, self.m[i])
        innovation[1] = wrap(innovation[1])
        self.s = self.s + W @ innovation  # C.10
        self.s[2] = wrap(self.s[2])
        self.P = self.P - W @ S @ W.T  # C.11
        return Update(innovation, H, S, W, self.s, self.P)

    def augment(self, z: ArrayLike, R: ArrayLike) -> Augmentation:
        """Augmentation step: a new landmark is observed; it becomes number N - 1."""
        z, R = checked("z", z, 2), checked("R", R, 2, 2)
        x, Pxx, Pxm, Pmm = self.x, self.Pxx, self.Pxm, self.Pmm
        m, Gx, Gz = g(x, z), grad_g_x(x, z), grad_g_z(x, z)
        blocks = [
            [Pxx, Pxm, Pxx @ Gx.T],
            [Pxm.T, Pmm, Pxm.T @ Gx.T],
            [Gx @ Pxx, Gx @ Pxm, Gx @ Pxx @ Gx.T + Gz @ R @ Gz.T],
        ]
        self.s = np.concatenate([self.s, m])  # C.16
        self.P = np.block(blocks)  # C.17 (corrected: Prr is Pxx)
        return Augmentation(m, Gx, Gz, self.P[-2:, :-2], self.P[-2:, -2:], self.s, self.P)


def grad_f_x(x: FloatArray, u: FloatArray) -> FloatArray:
    """Jacobian of f by the pose, (3, 3)."""
    d, beta = u[0], x[2] + u[1]
    return np.array([[1, 0, -d * sin(beta)], [0, 1, d * cos(beta)], [0, 0, 1]])  # C.8


def grad_f_u(x: FloatArray, u: FloatArray) -> FloatArray:
    """Jacobian of f by the control, (3, 2)."""
    d, beta = u[0], x[2] + u[1]
    return np.array([[cos(beta), -d * sin(beta)], [sin(beta), d * cos(beta)], [0, 1]])  # C.9


def grad_h(x: FloatArray, m: FloatArray) -> FloatArray:
    """Jacobian of h by the pose and the landmark, (2, 5)."""
    dx, dy, q = x[0] - m[0], x[1] - m[1], hypot(x[0] - m[0], x[1] - m[1])
    of_range = [dx / q, dy / q, 0, -dx / q, -dy / q]
    of_bearing = [-dy / q**2, dx / q**2, -1, dy / q**2, -dx / q**2]
    return np.array([of_range, of_bearing])  # C.14


def g(x: FloatArray, z: FloatArray) -> FloatArray:
    """Inverse observation model: position of the landmark observed at z, (2,)."""
    r, beta = z[0], x[2] + z[1]
    return np.array([x[0] + r * cos(beta), x[1] + r * sin(beta)])  # C.15


def grad_g_x(x: FloatArray, z: FloatArray) -> FloatArray:
    """Jacobian of g by the pose, (2, 3)."""
    r, beta = z[0], x[2] + z[1]
    return np.array([[1, 0, -r * sin(beta)], [0, 1, r * cos(beta)]])  # C.18


def grad_g_z(x: FloatArray, z: FloatArray) -> FloatArray:
    """Jacobian of g by the observation, (2, 2)."""
    r, beta = z[0], x[2] + z[1]
    return np.array([[cos(beta), -r * sin(beta)], [sin(beta), r * cos(beta)]])  # C.18


def wrap(angle: float) -> float:
    """The angle in (-pi, pi]. The source wraps no angle; here every result is wrapped."""
    wrapped = remainder(angle, 2 * pi)
    return wrapped if wrapped > -pi else pi


def checked(name: str, value: ArrayLike, *shape: int) -> FloatArray:
    """A copy of the value; raises `ConfigError` unless it has this shape and is finite."""
    array = np.array(value, np.float64)
    fits = array.shape == shape and np.isfinite(array).all()
    require(bool(fits), name, f"finite numbers of shape {shape}", array.tolist())
    return array
