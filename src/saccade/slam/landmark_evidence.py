"""Evidence of a scan of landmarks against the estimated pose."""

from dataclasses import dataclass
from math import cos, log, pi, sin
from typing import NamedTuple

import numpy as np

from saccade.slam._evidence_kernels import compare_scan
from saccade.slam.filter._state_kernels import FilterState
from saccade.slam.scans import Scan
from saccade.types import BoolArray, FloatArray, IntArray

WRONG_LABELS = 1.0
"""Initial number of labels that are not of their landmarks."""
LABELS = 100.0
"""Initial number of labels."""
MAX_UNEXPLAINED = 1.5
"""Largest evidence of an observation that no landmark explains."""
SCAN_MEMORY = 50.0
"""Length of the average of unexplained observations, in scans."""
RAREST = 0.01
"""Least expected number of unexplained observations in a scan."""
MAX_OBSERVATIONS = 2.0
"""Largest number of observations of an unexplained point that count."""
MAX_UNEXPLAINED_POINTS = 32
"""Largest number of unexplained points."""
MAX_SCAN_EVIDENCE = 3.0
"""Largest evidence of one scan, of either sign: its misses have common causes."""
MAX_LABEL_EVIDENCE = 7.0
"""Largest evidence of one scan by labels of landmarks that did not move."""


class ScanComparison(NamedTuple):
    """Comparison of k observations with the c landmarks that are labeled, or expected in view."""

    z: FloatArray
    """(k, 2) range and bearing."""
    R: FloatArray
    """(k, 2, 2) their covariances."""
    labeled: BoolArray
    """(k,) whether an observation has the label of a landmark."""
    density: FloatArray
    """(k,) sum of the densities for all landmarks that an observation may be of, else zero."""
    expected_density: FloatArray
    """(k,) sum of the densities times detection rates."""
    explained: BoolArray
    """(k,) whether an observation is the likeliest one of its likeliest landmark."""
    observed: BoolArray
    """(c,) whether each landmark explains an observation."""
    rate: FloatArray
    """(c,) detection rate in the cell."""
    num_expected: float
    """Expected number of landmarks that are observed."""
    view: float
    """Area of the view, in meters times radians."""
    num_labeled: int
    """Number of observations that have the label of a landmark."""
    num_contradicted_labels: int
    """Number of labels whose landmarks are not where the filter expects them."""


@dataclass
class UnexplainedPoint:
    """Position of observations that no landmark explains."""

    x: float
    y: float
    evidence: float = 1e-9
    """Evidence so far; positive at first, so that two observations of the same point alone never
    contradict a pose."""


class LandmarkEvidence:
    """Clutter, wrong labels and unexplained points, and the evidence of a scan.

    Args:
        gate: squared Mahalanobis distance within which an observation may be of a landmark.
    """

    def __init__(self, gate: float) -> None:
        self.points: list[UnexplainedPoint] = []
        """Points that no landmark explains, since the cumulative evidence was last zero."""
        self.max_range = 0.0
        """Meters to the most distant landmark observed."""
        self._gate = gate
        self._clutter = 1.0  # mean number of unexplained observations in a scan
        self._wrong_labels, self._labels = WRONG_LABELS, LABELS

    def compare(
        self,
        f: FilterState,
        scan: Scan,
        confirmed: BoolArray,
        rows: IntArray,
        counts: FloatArray,
    ) -> ScanComparison:
        """Compares a scan with landmarks in view that are `confirmed` (N,) or labeled.

        The landmarks of labels are at `rows` (k,); others are negative. The detections and
        checks are those of `LandmarkTable.detection_counts`.
        """
        k, N = len(scan.z), f.now.landmarks
        max_range = max(self.max_range, *scan.z[:, 0].tolist())
        rate, observed, explained = np.empty(N), np.empty(N, np.bool_), np.zeros(k, np.bool_)
        sums = np.empty((k, 2))
        count = compare_scan(
            *(f, scan.z, scan.R, rows, confirmed, max_range, self._gate, counts),
            *(rate, observed, explained, sums),
        )
        rate, labeled = rate[:count], rows >= 0
        num_labeled = int(np.count_nonzero(labeled))
        contradicted = labeled & (sums[:, 0] == 0) if num_labeled > 0 else labeled
        return ScanComparison(
            z=scan.z,
            R=scan.R,
            labeled=labeled,
            density=sums[:, 0],
            expected_density=sums[:, 1],
            explained=explained,
            observed=observed[:count],
            rate=rate,
            num_expected=float(rate.sum()),
            view=2 * pi * max_range,
            num_labeled=num_labeled,
            num_contradicted_labels=int(np.count_nonzero(contradicted)),
        )

    @property
    def wrong_label(self) -> float:
        """Probability that a labeled observation is not of its landmark."""
        return self._wrong_labels / self._labels

    def evaluate(self, f: FilterState, compared: ScanComparison, *, standing: bool) -> float:
        """Log-likelihood ratio of a lost robot to a localized one, limited by unexplained points.

        An observation of a localized robot is of an expected landmark, with the density of the
        filter, or of clutter, uniform in the view; their prior is their numbers in a scan.
        Observations of a lost robot are uniform in the view. Labels of landmarks that are known to
        be `standing` where they are in the map have no such limit.
        """
        clutter, num_expected, wrong = self._clutter, compared.num_expected, self.wrong_label
        ratio = np.where(
            compared.labeled,
            wrong + (1 - wrong) * compared.view * compared.density,
            (clutter + compared.view * compared.expected_density) / (clutter + num_expected),
        )
        if standing:
            labels = -float(np.log(ratio[compared.labeled]).sum())
            return max(min(labels, MAX_LABEL_EVIDENCE), -MAX_SCAN_EVIDENCE)
        value = float(np.minimum(-np.log(ratio), MAX_UNEXPLAINED).sum())
        information = np.log1p(-compared.rate)  # of each miss, negative
        value += float(information @ (compared.observed - compared.rate))
        rarity = min(log((clutter + num_expected) / clutter), MAX_UNEXPLAINED)
        return max(self._limit(value, f, compared, rarity), -MAX_SCAN_EVIDENCE)

    def _limit(
        self, value: float, f: FilterState, compared: ScanComparison, rarity: float
    ) -> float:
        """Limits the evidence of a scan by its unexplained points.

        A point that is observed again is no new evidence; a view without such points is occluded.
        """
        x, y, heading = f.state[:3].tolist()
        limits: list[tuple[UnexplainedPoint, float]] = []
        for k in np.flatnonzero(~compared.explained).tolist():
            limit = MAX_UNEXPLAINED if compared.labeled[k] else rarity
            (q, bearing), R = compared.z[k].tolist(), compared.R[k]
            direction, variance = heading + bearing, float(R[0, 0] + q * q * R[1, 1])
            seen = UnexplainedPoint(x + q * cos(direction), y + q * sin(direction))
            point = self._point_near(seen, 2 * self._gate * variance)
            limits.append((point, min(limit, max(MAX_OBSERVATIONS * limit - point.evidence, 0.0))))
        total = sum(limit for _, limit in limits)
        limited = min(value, total, MAX_SCAN_EVIDENCE)
        if limited > 0:
            for point, limit in limits:
                point.evidence += limited * limit / total
        return limited

    def _point_near(self, seen: UnexplainedPoint, max_square: float) -> UnexplainedPoint:
        """The unexplained point next to an observed point, moved there; else a new point."""

        def squared_distance(point: UnexplainedPoint) -> float:
            return (point.x - seen.x) ** 2 + (point.y - seen.y) ** 2

        nearest = min(self.points, key=squared_distance, default=None)
        if nearest is not None and squared_distance(nearest) <= max_square:
            nearest.x, nearest.y = seen.x, seen.y
            return nearest
        if len(self.points) == MAX_UNEXPLAINED_POINTS:
            self.points.remove(min(self.points, key=lambda point: point.evidence))
        self.points.append(seen)
        return seen

    def learn(self, compared: ScanComparison) -> None:
        """Updates averages by a scan that does not contradict the pose."""
        explained = compared.explained
        self._wrong_labels += compared.num_contradicted_labels
        self._labels += compared.num_labeled
        self.max_range = max(self.max_range, float(compared.z[explained, 0].max(initial=0.0)))
        unexplained = int(np.count_nonzero(~explained))
        clutter = self._clutter + (unexplained - self._clutter) / SCAN_MEMORY
        self._clutter = max(clutter, RAREST)
