"""Slow, readable twins of the SLAM kernels: the textbook filters on dense matrices."""

import numpy as np
from scipy.linalg import expm

from saccade import textbook

QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def second_order(f, covariance, step=1e-4):
    """Mean (2,) and covariance (2, 2) of the quadratic terms of f at 0, errors (n,) Gaussian.

    By central differences of f; Bar-Shalom, Li & Kirubarajan (2001), section 10.3.
    """
    n, d = len(covariance), step * np.eye(len(covariance))
    A = np.empty((2, n, n))
    for i in range(n):
        for j in range(n):
            corners = f(d[i] + d[j]) - f(d[i] - d[j]) - f(d[j] - d[i]) + f(-d[i] - d[j])
            A[:, i, j] = corners / (4 * step**2)
    mean = np.einsum("kij,ji->k", A, covariance) / 2
    return mean, np.einsum("aij,jk,bkl,li->ab", A, covariance, A, covariance) / 2


def polar(d):
    """Range and bearing of d (2,)."""
    return np.array([np.hypot(*d), np.arctan2(d[1], d[0])])


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def numerical_jacobian(f, x, step=1e-6):
    """Central differences of f at x; f's values are differences already, so nothing wraps."""
    columns = [(f(x + d) - f(x - d)) / (2 * step) for d in step * np.eye(len(x))]
    return np.stack(columns, -1)


class DenseEkf(textbook.EkfSlam):
    """C.1-C.18 with whole matrices, every step O(n^2) or worse."""

    def update(self, z, R, landmark):
        super().update(landmark, z, R)


def augment_to_second_order(ekf, z, R, about):
    """A new landmark at the mean of its position; a heading error turns it about a point (2,)."""

    def placed(error):
        beta = ekf.s[2] + z[1] + error[1]
        return (z[0] + error[0]) * np.array([np.cos(beta), np.sin(beta)])

    mean, extra = second_order(placed, R)
    new, Gz = ekf.s[:2] + placed(np.zeros(2)) + mean, numerical_jacobian(placed, np.zeros(2))
    n = len(ekf.s)
    G = np.zeros((2, n))
    G[:, :2], G[:, 2] = np.eye(2), QUARTER_TURN @ (new - about)
    top = np.vstack([np.eye(n), G])
    ekf.s, ekf.P = np.append(ekf.s, new), top @ ekf.P @ top.T
    ekf.P[n:, n:] += Gz @ R @ Gz.T + extra


class DenseInvariantEkf(DenseEkf):
    """The right-invariant filter: corrected in the errors xi, carried back at the new state."""

    def slope(self):
        """Of the errors xi by the errors along the axes."""
        T = np.eye(len(self.s))
        swing = -(np.delete(self.s, 2).reshape(-1, 2) @ QUARTER_TURN.T).ravel()
        T[:2, 2], T[3:, 2] = swing[:2], swing[2:]
        return T

    def update(self, z, R, landmark):
        T, m = self.slope(), 3 + 2 * landmark
        Pi = T @ self.P @ T.T
        rows = [0, 1, 2, m, m + 1]
        back, d = rotation(-self.s[2]), self.s[m : m + 2] - self.s[:2]

        def observed(xi):
            """Of the points that the exponential of xi moves, from the pose that it turns."""
            half = xi[2] / 2  # the exponential shifts by rotation(half) sinc(half)
            turned = d + rotation(-half) @ (xi[3:] - xi[:2]) * np.sinc(half / np.pi)
            return polar(back @ turned)

        H = np.zeros((2, len(self.s)))
        H[:, rows] = numerical_jacobian(observed, np.zeros(5))
        mean, extra = second_order(observed, Pi[np.ix_(rows, rows)])
        v = z - observed(np.zeros(5)) - mean
        v[1] = (v[1] + np.pi) % (2 * np.pi) - np.pi
        S = H @ Pi @ H.T + R + extra
        W = Pi @ H.T @ np.linalg.inv(S)
        xi = W @ v
        self.s = self.moved(xi)
        back = np.linalg.inv(self.slope())
        self.P = back @ (Pi - W @ S @ W.T) @ back.T

    def augment(self, z, R):
        augment_to_second_order(self, z, R, self.s[:2])

    def moved(self, xi):
        """Every point by the exponential of xi: of one matrix with a column for each."""
        corrected, shifts = self.s + xi, np.delete(xi, 2).reshape(-1, 2).T
        generator = np.zeros((2 + shifts.shape[1],) * 2)
        generator[:2] = np.hstack([xi[2] * QUARTER_TURN, shifts])
        moves = expm(generator)[:2]
        points = np.delete(self.s, 2).reshape(-1, 2)
        moved = points @ moves[:, :2].T + moves[:, 2:].T
        corrected[[0, 1, *range(3, len(self.s))]] = moved.ravel()
        return corrected


class ListedLandmarks:
    """`LandmarkTable` as a list of landmarks, and of what was seen in each bin."""

    def __init__(self, rule):
        self.rule, self.scan, self.landmarks = rule, 0, []
        self.bins = {}  # bin: detections, expectations

    def update(self, predicted, candidates, association):
        """Count a scan; returns the numbers of those that are removed."""
        self.scan += 1
        before = len(self.landmarks)
        for number in range(before, max(association, default=-1) + 1):
            self.landmarks.append(
                {"times": 0, "confirmed": number < candidates, "seen": 0, "expected": 0.0}
            )
        for number in association:
            if number >= 0:
                mark = self.landmarks[number]
                mark["times"], mark["last"] = mark["times"] + 1, self.scan
                mark["confirmed"] |= mark["times"] >= self.rule.confirm_after
        if self.scan % self.rule.interval > 0:
            return []
        known = {place: list(counts) for place, counts in self.bins.items()}
        for mark, (distance, bearing) in zip(self.landmarks[:before], predicted, strict=True):
            sector = int(np.floor((bearing + np.pi) / (2 * np.pi / 24))) % 24
            cell = int(np.floor(4 * np.log2(distance))), sector
            place, (hits, checks) = self.bins.setdefault(cell, [0, 0]), known.get(cell, (0, 0))
            mark["expected"] += hits / (checks + 4)
            mark["seen"] += mark["last"] == self.scan
            if mark["confirmed"]:
                place[0] += mark["last"] == self.scan
                place[1] += 1
        if self.scan % (4 * self.rule.interval) > 0:
            return []
        removed = [i for i, mark in enumerate(self.landmarks) if self._is_removed(mark)]
        self.landmarks = [mark for i, mark in enumerate(self.landmarks) if i not in removed]
        return removed

    def _is_removed(self, mark):
        if not mark["confirmed"]:
            return self.scan - mark["last"] > self.rule.candidate_scans
        missed = mark["expected"] - mark["seen"]
        few = mark["seen"] < self.rule.culling_ratio * mark["expected"]
        return missed > self.rule.max_missed and few
