"""Slow, readable twins of the SLAM kernels, and the textbook filter on dense matrices."""

import numpy as np


def full(upper):
    """The symmetric matrix whose upper triangle this is."""
    return np.triu(upper) + np.triu(upper, 1).T


def observed_rows(P, m, H, n):
    """H P of the first n columns, H by the pose and the rows m and m + 1."""
    wide = np.zeros((2, len(P)))
    wide[:, :3] = H[:, :3]
    wide[:, m : m + 2] += H[:, 3:]
    return (wide @ full(P))[:, :n]


def add_product(P, X, Y):
    """P + X^T Y on the upper triangle of the first n rows and columns."""
    n = X.shape[1]
    out = P.copy()
    out[:n, :n] += np.triu(X.T @ Y)
    return out


def numerical_jacobian(f, x, step=1e-6):
    """Central differences of f at x; f's values are differences already, so nothing wraps."""
    columns = [(f(x + d) - f(x - d)) / (2 * step) for d in step * np.eye(len(x))]
    return np.stack(columns, -1)


class DenseEkf:
    """C.1-C.18 with whole matrices, every step O(n^2) or worse."""

    def __init__(self, pose, covariance):
        self.s, self.P = np.array(pose, float), np.array(covariance, float)

    def predict(self, d, phi, U):
        x, y, theta = self.s[:3]
        n = len(self.s)
        c, s = np.cos(theta + phi), np.sin(theta + phi)
        self.s[:3] = x + d * c, y + d * s, theta + phi
        F = np.eye(n)
        F[0, 2], F[1, 2] = -d * s, d * c
        G = np.zeros((n, 2))
        G[:3] = [[c, -d * s], [s, d * c], [0, 1]]
        self.P = F @ self.P @ F.T + G @ U @ G.T

    def update(self, z, R, landmark):
        n, m = len(self.s), 3 + 2 * landmark
        dx, dy = self.s[:2] - self.s[m : m + 2]
        q = np.hypot(dx, dy)
        H = np.zeros((2, n))
        H[:, :3] = [[dx / q, dy / q, 0], [-dy / q**2, dx / q**2, -1]]
        H[:, m : m + 2] = [[-dx / q, -dy / q], [dy / q**2, -dx / q**2]]
        v = z - [q, np.arctan2(-dy, -dx) - self.s[2]]
        v[1] = np.angle(np.exp(1j * v[1]))
        S = H @ self.P @ H.T + R
        W = self.P @ H.T @ np.linalg.inv(S)
        self.s = self.s + W @ v
        self.P = self.P - W @ S @ W.T

    def augment(self, z, R):
        n = len(self.s)
        r, beta = z[0], self.s[2] + z[1]
        c, s = np.cos(beta), np.sin(beta)
        G = np.zeros((2, n))
        G[:, :3] = [[1, 0, -r * s], [0, 1, r * c]]
        Gz = np.array([[c, -r * s], [s, r * c]])
        self.s = np.append(self.s, [self.s[0] + r * c, self.s[1] + r * s])
        top = np.vstack([np.eye(n), G])
        self.P = top @ self.P @ top.T
        self.P[n:, n:] += Gz @ R @ Gz.T
