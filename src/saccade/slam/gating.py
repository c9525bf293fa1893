"""How far every observation is from every landmark, at the speed of compiled code."""

from math import atan2, hypot, inf

import numpy as np

from saccade._jit import kernel
from saccade.slam.belief import INVARIANT, LANDMARKS, Belief
from saccade.slam.models import NEAREST
from saccade.types import FloatArray, IntArray

AMBIGUOUS = 3.0
"""An observation is of its landmark if no free one is so near by the normalized distance squared:
it is four times as likely of this one as of any other."""


@kernel()
def expect(b: Belief, kind: int, z: FloatArray, S: FloatArray) -> None:
    """Fill range and bearing z (N, 2) of every landmark, and S = H P H^T (N, 2, 2)."""
    r, s, a, P = len(b.work), b.state, b.swing, b.P
    C, D, W = np.zeros((5, 5)), np.zeros((2, 5)), np.zeros((2, 5))  # x, y, heading, landmark
    C[:3, :3] = P[:3, :3]
    for i in range(b.used[LANDMARKS]):
        m = r + 2 * i
        dx, dy = s[m] - s[0], s[m + 1] - s[1]
        q = hypot(dx, dy)
        D[:] = 0.0
        z[i, 0], z[i, 1] = q, 0.0
        if q > NEAREST:
            z[i, 1] = np.pi - (np.pi - (atan2(dy, dx) - s[2])) % (2 * np.pi)
            D[0, 3], D[0, 4], D[1, 3], D[1, 4] = dx / q, dy / q, -dy / q**2, dx / q**2
            D[:, :2] = -D[:, 3:]
            D[1, 2] = -1.0
            if kind == INVARIANT:  # by eta
                for k in range(2):
                    D[k, 2] += D[k, 3] * (a[m] - a[0]) + D[k, 4] * (a[m + 1] - a[1])
        for k in range(3):
            C[k, 3], C[k, 4] = P[k, m], P[k, m + 1]
            C[3, k], C[4, k] = P[k, m], P[k, m + 1]
        C[3, 3], C[4, 4] = b.own[i, 0], b.own[i, 2]
        C[3, 4] = C[4, 3] = b.own[i, 1]
        for j in range(2):
            for p in range(5):
                W[j, p] = 0.0
                for o in range(5):
                    W[j, p] += C[p, o] * D[j, o]
        for j in range(2):
            for k in range(2):
                S[i, j, k] = 0.0
                for p in range(5):
                    S[i, j, k] += D[max(j, k), p] * W[min(j, k), p]


@kernel()
def distances(
    expected: FloatArray,
    spread: FloatArray,
    z: FloatArray,
    R: FloatArray,
    limit: float,
    distance: FloatArray,
) -> None:
    """Fill the normalized innovations squared (m, N), infinite over the limit.

    Of observations z (m, 2) and R (m, 2, 2), with landmarks as `expect` has them.
    """
    for i in range(len(z)):
        for j in range(len(expected)):
            distance[i, j] = inf
            v = z[i, 0] - expected[j, 0]
            a = spread[j, 0, 0] + R[i, 0, 0]
            if v * v > limit * a:
                continue
            w = z[i, 1] - expected[j, 1]
            w = np.pi - (np.pi - w) % (2 * np.pi)
            c, d = spread[j, 0, 1] + R[i, 0, 1], spread[j, 1, 1] + R[i, 1, 1]
            determinant = a * d - c * c
            if w * w <= limit * d and determinant > 0:
                total = (d * v * v - 2 * c * v * w + a * w * w) / determinant
                if total <= limit:
                    distance[i, j] = total


@kernel()
def drop_ambiguous(distance: FloatArray, found: IntArray) -> None:
    """Drop pairs of (m, c) that another column, which nothing is paired with, is as good for."""
    taken = np.zeros(distance.shape[1], np.bool_)
    for i in range(len(distance)):
        if found[i] >= 0:
            taken[found[i]] = True
    for i in range(len(distance)):
        own = distance[i, found[i]] if found[i] >= 0 else inf
        for j in range(distance.shape[1]):
            if not taken[j] and distance[i, j] <= own + AMBIGUOUS and found[i] >= 0:
                found[i] = -2
