"""Slow, readable twins of the SLAM kernels: the textbook filters on dense matrices."""

import numpy as np
from scipy.linalg import expm

from saccade import textbook

QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def numerical_jacobian(f, x, step=1e-6):
    """Central differences of f at x; f's values are differences already, so nothing wraps."""
    columns = [(f(x + d) - f(x - d)) / (2 * step) for d in step * np.eye(len(x))]
    return np.stack(columns, -1)


class DenseEkf(textbook.EkfSlam):
    """C.1-C.18 with whole matrices, every step O(n^2) or worse."""

    def update(self, z, R, landmark):
        super().update(landmark, z, R)


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
        r, beta = z[0], self.s[2] + z[1]
        c, s = np.cos(beta), np.sin(beta)
        Gz = np.array([[c, -r * s], [s, r * c]])
        H = np.zeros((2, len(self.s)))
        H[:, :2], H[:, m : m + 2] = -np.eye(2), np.eye(2)
        Pi = T @ self.P @ T.T
        S = H @ Pi @ H.T + Gz @ R @ Gz.T
        W = Pi @ H.T @ np.linalg.inv(S)
        xi = W @ (self.s[:2] + r * np.array([c, s]) - self.s[m : m + 2])
        self.s = self.moved(xi)
        back = np.linalg.inv(self.slope())
        self.P = back @ (Pi - W @ S @ W.T) @ back.T

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


class DenseFirstEstimatesEkf(DenseEkf):
    """First-estimates Jacobians: slopes where the landmarks, and the pose moved, were first."""

    def __init__(self, pose, covariance):
        super().__init__(pose, covariance)
        self.first = self.s.copy()

    def predict(self, u, U):
        place = self.s[:2].copy()
        (d, phi), theta = u, self.s[2]
        n, c, s = len(self.s), np.cos(theta + phi), np.sin(theta + phi)
        self.s[:3] = place[0] + d * c, place[1] + d * s, theta + phi
        F = np.eye(n)
        F[:2, 2] = QUARTER_TURN @ (self.s[:2] - self.first[:2])
        G = np.zeros((n, 2))
        G[:3] = [[c, -d * s], [s, d * c], [0, 1]]
        self.P = F @ self.P @ F.T + G @ U @ G.T
        self.first[:3] = self.s[:3]

    def update(self, z, R, landmark):
        """Of the relative place of the landmark, as Huang, Mourikis & Roumeliotis have it."""
        m = 3 + 2 * landmark
        c, s = np.cos(self.s[2]), np.sin(self.s[2])
        back = np.array([[c, s], [-s, c]])
        cz, sz = np.cos(z[1]), np.sin(z[1])
        slope = np.array([[cz, -z[0] * sz], [sz, z[0] * cz]])
        v = z[0] * slope[:, 0] - back @ (self.s[m : m + 2] - self.s[:2])
        H = np.zeros((2, len(self.s)))
        H[:, :2], H[:, m : m + 2] = -back, back
        H[:, 2] = -back @ QUARTER_TURN @ (self.first[m : m + 2] - self.first[:2])
        S = H @ self.P @ H.T + slope @ R @ slope.T
        W = self.P @ H.T @ np.linalg.inv(S)
        self.s = self.s + W @ v
        self.P = self.P - W @ S @ W.T

    def augment(self, z, R):
        n = len(self.s)
        c, s = np.cos(self.s[2] + z[1]), np.sin(self.s[2] + z[1])
        new = self.s[:2] + z[0] * np.array([c, s])
        G = np.zeros((2, n))
        G[:, :2], G[:, 2] = np.eye(2), QUARTER_TURN @ (new - self.first[:2])
        Gz = np.array([[c, -z[0] * s], [s, z[0] * c]])
        self.s, self.first = np.append(self.s, new), np.append(self.first, new)
        top = np.vstack([np.eye(n), G])
        self.P = top @ self.P @ top.T
        self.P[n:, n:] += Gz @ R @ Gz.T


class ListedLandmarks:
    """`Culling` as a list of landmarks, and of what was seen in each bin."""

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
        for mark, (distance, bearing) in zip(self.landmarks[:before], predicted, strict=True):
            sector = int(np.floor((bearing + np.pi) / (2 * np.pi / 24))) % 24
            place = self.bins.setdefault((int(np.floor(4 * np.log2(distance))), sector), [0, 0])
            mark["expected"] += place[0] / (place[1] + 4)
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
        few = mark["seen"] < self.rule.min_ratio * mark["expected"]
        return missed > self.rule.max_missed and few
