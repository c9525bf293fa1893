"""Joint association hypotheses of a scan, with their likelihoods."""

from dataclasses import dataclass
from math import log, pi
from typing import NamedTuple

import numpy as np

from saccade.slam.association._assignment_kernels import best_assignments
from saccade.slam.association.nearest_neighbor import mahalanobis_squared
from saccade.slam.association.outcomes import DROPPED, NEW
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.robot_models import difference
from saccade.types import FloatArray, IntArray

MIN_DETERMINANT_RATIO = 1e-15
"""Least ratio of the determinant of a covariance to the product of its variances."""


@dataclass(frozen=True)
class Alternatives:
    """Rule for the alternatives of a scan. Costs are minus twice the logarithm of a likelihood.

    Wheels slip at times by more than their declared noise. A landmark at an uncertain position is
    therefore an alternative far beyond the gate, at the cost of Huber's loss.
    """

    gate: float = 0.99
    """Probability with which an observation of a landmark is inside its gate."""
    new_gate: float = 0.9999
    """Probability with which an observation that is not of a new landmark is inside this one."""
    huber: float = np.inf
    """See `EkfConfig`."""
    slip_gate: float = 60.0
    """Largest normalized innovation squared of an observation of a landmark at an uncertain
    position."""
    density: float = 0.1
    """Largest number of unmapped landmarks per square meter in view."""
    least_new_cost: float = 10.0
    """Least cost of an observation of a new landmark, however coarse the sensor; see `new_cost`."""
    window: float = 10.0
    """Largest cost of an alternative above the cost of the best one."""
    known: float = 2.0
    """Largest log ratio of the determinants of an innovation's covariance and of the noise for a
    landmark to be at a known position."""
    max_assignments: int = 6
    """Largest number of joint associations that become alternatives."""
    max_nodes: int = 500
    """Pairs of an observation and a landmark that are tried."""

    def new_cost(self, point_sigma: float) -> float:
        """Cost of a new landmark, relative to an observation of one at a known position.

        Args:
            point_sigma: standard deviation of the position of an observed point, in meters.
        """
        return max(self.least_new_cost, -2 * log(2 * pi * self.density * point_sigma**2))

    def __call__(
        self, ekf: EkfSlam, z: FloatArray, R: FloatArray, new_cost: float
    ) -> list["Alternative"]:
        """The alternatives, the best one first.

        An association has ids of landmarks, `NEW`, and `DROPPED` for an observation that is
        between the two gates of the nearest landmark. Associations that differ only between
        landmarks at known positions, or new landmarks beside them, move the estimate by less than
        the distance of these landmarks: only the best one is returned. Other associations move
        the estimate by as much as it is uncertain.

        Args:
            ekf: the filter, predicted to the pose of the scan.
            z: (m, 2) range in meters, bearing in radians.
            R: (m, 2, 2) their covariances.
            new_cost: of an observation of a new landmark, see the method.
        """
        gate, new_gate = chi_square_gate(2, self.gate), chi_square_gate(2, self.new_gate)
        slip_gate = max(self.slip_gate, new_gate)
        distance = mahalanobis_squared(ekf, z, R, slip_gate)  # (m, N)
        nearest = distance.min(1, initial=np.inf)
        unpaired = np.where((nearest > gate) & (nearest <= new_gate), DROPPED, NEW)
        columns = np.flatnonzero(np.isfinite(distance).any(0))
        landmarks = ekf.ids[columns]
        predicted, joint = ekf.predict_jointly(landmarks)  # (c, 2), (2c, 2c)
        noise = log_determinant(R)  # (m,)
        c = np.arange(len(columns))
        blocks = joint.reshape(len(c), 2, len(c), 2)[c, :, c]  # (c, 2, 2)
        log_ratio = log_determinant(blocks + R[:, None]) - noise[:, None]  # (m, c)
        known, square = log_ratio <= self.known, distance[:, columns]
        alone = np.where(square <= np.where(known, gate, slip_gate), square + log_ratio, np.inf)
        if not np.isfinite(alone).any():
            return [Alternative(len(z) * new_cost, unpaired)]
        rows = np.argsort(alone.min(1), kind="stable")
        order = np.argsort(alone[rows], axis=1, kind="stable")
        inside = np.isfinite(np.take_along_axis(alone[rows], order, 1))
        row, pair = rows[np.nonzero(inside)[0]], order[inside]  # (p,)
        state = (2 * pair[:, None] + [0, 1]).ravel()
        S = joint[np.ix_(state, state)]
        same = np.repeat(np.repeat(row[:, None] == row, 2, 0), 2, 1)
        S += same * np.tile(R[row].reshape(-1, 2), (1, len(row)))
        cost = np.empty(self.max_assignments)
        assigned = np.empty((len(cost), len(z)), np.int64)
        best_assignments(
            np.append(0, np.cumsum(inside.sum(1))),
            pair,
            difference(z[row], predicted[pair]),
            S,
            noise[row],
            self.huber,
            new_cost,
            self.window,
            self.max_nodes,
            cost,
            assigned,
        )
        found: dict[tuple[int, ...], Alternative] = {}
        by_known = np.isfinite(alone) & known
        for total, pairs in zip(cost.tolist(), assigned, strict=True):
            if total > cost[0] + self.window:
                break
            column = np.full(len(z), -1)
            column[rows] = np.where(pairs >= 0, pair[pairs], -1)
            settled = np.where(column < 0, by_known.any(1), by_known[np.arange(len(z)), column])
            which = tuple(np.where(settled, -2, column).tolist())
            association = np.where(column >= 0, landmarks[column], unpaired)
            found.setdefault(which, Alternative(total, association))
        return list(found.values())


class Alternative(NamedTuple):
    """A joint association of a scan."""

    cost: float
    """Minus twice the logarithm of its likelihood, up to a constant."""
    association: IntArray
    """(m,) ids of landmarks, `NEW` and `DROPPED`."""


def log_determinant(C: FloatArray) -> FloatArray:
    """Logarithms of the determinants of covariances (..., 2, 2).

    Infinite where rounding in a diverged estimate made a variance negative: nothing is near.
    """
    square = C[..., 0, 0] * C[..., 1, 1]
    least = np.maximum(square - C[..., 0, 1] * C[..., 1, 0], MIN_DETERMINANT_RATIO * square)
    valid = (C[..., 0, 0] > 0) & (C[..., 1, 1] > 0)
    return np.asarray(np.log(np.where(valid, least, np.inf)))
