"""Evidence of a scan of landmarks that the robot is not where the filter believes."""

from dataclasses import dataclass
from math import cos, exp, inf, log, pi, sin, sqrt

import numpy as np

from saccade.slam.association._kernels import mahalanobis_distances
from saccade.slam.filter._state_kernels import FilterState
from saccade.slam.filter.models import expected
from saccade.slam.filter.state import state_size
from saccade.slam.scans import Scan
from saccade.types import BoolArray, FloatArray, IntArray

RANGES = 0.1 * 2 ** (np.arange(1, 64) / 4)
"""(63,) ranges between the cells of the sensor's view, in meters: quarter octaves."""
BEARINGS = np.linspace(-pi, pi, 17)[1:-1]
"""(15,) bearings between the cells of the sensor's view."""
UNTRIED = 10.0
"""Misses that every cell begins with: without experience, no evidence."""
MEMORY = 500.0
"""Expected landmarks in a cell after which its counts are halved, so that they follow changes."""
WRONG_LABEL = 0.05
"""Probability that a labeled observation is not of its landmark."""
SCALE_MEMORY = 200.0
"""Observations over which the normalized innovation squared is averaged."""
MAX_UNEXPLAINED = 1.5
"""Largest evidence of an observation that no landmark explains."""
SCAN_MEMORY = 50.0
"""Scans over which the numbers of unexplained observations and of misses are averaged."""
RAREST = 0.01
"""Least number of unexplained observations, and of squared misses, that is expected in a scan."""
MAX_OBSERVATIONS = 2.0
"""Observations of an unexplained point that count, however often it is observed."""
MAX_POINTS = 32
"""Number of unexplained points that are remembered."""
MAX_EVIDENCE = 3.0
"""Largest evidence of one scan, for or against: its misses have common causes."""


@dataclass
class ComparedObservation:
    """An observation, compared with the landmarks in view."""

    z: list[float]
    """(2,) range and bearing."""
    R: list[list[float]]
    """(2, 2)."""
    row: int
    """Row of the landmark of its label, negative for none."""
    nis: float = inf
    """Least normalized innovation squared."""
    density: float = 0.0
    """Sum of the densities for all landmarks of which it may be, zero outside their gates."""
    expected_density: float = 0.0
    """Sum of the densities times detection rates."""
    landmark: int = -1
    """Index of the likeliest landmark."""
    likelihood: float = 0.0
    """Density for that landmark."""


@dataclass
class ScanComparison:
    """Comparison of a scan with the c landmarks that are labeled, or expected in view."""

    observations: list[ComparedObservation]
    cell: IntArray
    """(c,) cell of the view in which each landmark is expected."""
    rate: FloatArray
    """(c,) detection rate in that cell."""
    view: float
    """Area of the view, in meters times radians."""

    def __post_init__(self) -> None:
        self.num_expected = float(self.rate.sum())
        """Expected number of landmarks that are observed."""
        self.observers: dict[int, ComparedObservation] = {}
        """Observations of landmarks, by the landmarks' indices."""
        for each in self.observations:
            rival = self.observers.get(each.landmark)
            if each.landmark >= 0 and (rival is None or each.likelihood > rival.likelihood):
                self.observers[each.landmark] = each
        self.unexplained = [
            each for each in self.observations if self.observers.get(each.landmark) is not each
        ]
        """Observations that no landmark explains."""
        self.labeled = [each for each in self.observations if each.row >= 0]
        """Observations with the label of a landmark."""

    @property
    def num_contradicted_labels(self) -> int:
        """Labels whose landmarks are not where the filter expects them."""
        return sum(each.density == 0 for each in self.labeled)


@dataclass
class UnexplainedPoint:
    """Position of observations that no landmark explains."""

    x: float
    y: float
    evidence: float = 1e-9
    """Evidence so far; positive at first, so that a second observation of a point by itself has
    less than that of a contradiction."""


class LandmarkEvidence:
    """Detection rates, innovations and unexplained points, and the evidence of a scan by them.

    Args:
        gate: squared Mahalanobis distance within which an observation may be of a landmark.
    """

    def __init__(self, gate: float) -> None:
        self.points: list[UnexplainedPoint] = []
        """Points that no landmark explained since there was no evidence."""
        self.max_range = 0.0
        """Meters to the most distant landmark observed."""
        self._gate = gate
        num_cells = (len(RANGES) + 1) * (len(BEARINGS) + 1)
        self._expected = np.zeros(num_cells)  # landmarks that were expected in each cell
        self._observed = np.zeros(num_cells)  # of these, how many were observed
        self._clutter = 1.0  # mean number of unexplained observations in a scan
        self._scale = 4.0  # mean of half the normalized innovation squared
        self._squares = 10.0  # mean of the square of excess misses in a scan
        self._variance = 1.0  # mean of its variance if they were independent

    def compare(
        self, f: FilterState, scan: Scan, confirmed: BoolArray, rows: IntArray
    ) -> ScanComparison:
        """Compares a scan with landmarks in view that are `confirmed` (N,) or labeled.

        The landmarks of labels are at `rows` (k,); others are negative.
        """
        observations = [
            ComparedObservation(*each)
            for each in zip(scan.z.tolist(), scan.R.tolist(), rows.tolist(), strict=True)
        ]
        max_range = max(self.max_range, *(each.z[0] for each in observations))
        points = f.state[f.robot_size : state_size(f)].view(np.complex128)  # x + iy
        in_view = confirmed & (np.abs(points - complex(*f.state[:2])) <= max_range)
        in_view[rows[rows >= 0]] = True
        landmarks = in_view.nonzero()[0]
        predicted, S = expected(f, landmarks)
        q, bearing = predicted.T
        cell = RANGES.searchsorted(q, "right") * (len(BEARINGS) + 1) + BEARINGS.searchsorted(
            bearing
        )
        rate = self._observed[cell] / (self._expected[cell] + UNTRIED)
        view = 2 * pi * max_range
        square = np.empty((len(observations), len(landmarks)))
        mahalanobis_distances(predicted, S, scan.z, scan.R, self._gate, square)
        k, j = (square <= self._gate).nonzero()
        values = zip(
            *(k.tolist(), j.tolist(), landmarks[j].tolist(), rate[j].tolist()),
            *(square[k, j].tolist(), (S[j] + scan.R[k]).tolist()),
            strict=True,
        )
        for k, j, landmark, p, nis, ((a, b), (_, d)) in values:
            observation = observations[k]
            observation.nis = min(observation.nis, nis)
            if observation.row not in (-1, landmark):
                continue
            area = min(2 * pi * self._scale * sqrt(a * d - b * b), view)
            density = exp(-nis / 2 / self._scale) / area
            observation.density += density
            observation.expected_density += p * density
            if density > observation.likelihood:
                observation.landmark, observation.likelihood = j, density
        return ScanComparison(observations, cell, rate, view)

    def evaluate(self, f: FilterState, compared: ScanComparison) -> float:
        """Log-likelihood ratio of a lost robot to one that is not, limited by unexplained points.

        Each observation of a robot that is not lost is of an expected landmark, with the density of
        the filter, or of something else, anywhere in the view; in proportion to how many of both
        there are in a scan. Those of a lost one are anywhere in the view. Missed landmarks count as
        far as misses were independent so far: one occluder may hide many.
        """
        clutter, num_expected, value = self._clutter, compared.num_expected, 0.0
        for each in compared.observations:
            if each.row >= 0:
                ratio = WRONG_LABEL + (1 - WRONG_LABEL) * compared.view * each.density
            else:
                ratio = clutter + compared.view * each.expected_density
                ratio /= clutter + num_expected
            value += min(-log(ratio), MAX_UNEXPLAINED)
        information = -np.log1p(-compared.rate)  # of each miss
        misses = float(information @ compared.rate)
        misses -= sum(float(information[j]) for j in compared.observers)
        value += misses * min(1.0, self._variance / self._squares)
        rarity = min(log((clutter + num_expected) / clutter), MAX_UNEXPLAINED)
        return max(self._limit(value, f, compared.unexplained, rarity), -MAX_EVIDENCE)

    def _limit(
        self,
        value: float,
        f: FilterState,
        unexplained: list[ComparedObservation],
        rarity: float,
    ) -> float:
        """Limits the evidence of a scan by the most that its unexplained points may add.

        A point that is observed again is no new evidence, and a view without any is blocked.
        """
        x, y, heading = f.state[:3].tolist()
        limits: list[tuple[UnexplainedPoint, float]] = []
        for each in unexplained:
            limit = MAX_UNEXPLAINED if each.row >= 0 else rarity
            q, direction = each.z[0], heading + each.z[1]
            variance = each.R[0][0] + q * q * each.R[1][1]
            seen = UnexplainedPoint(x + q * cos(direction), y + q * sin(direction))
            point = self._point_near(seen, 2 * self._gate * variance)
            limits.append((point, min(limit, max(MAX_OBSERVATIONS * limit - point.evidence, 0.0))))
        total = sum(limit for _, limit in limits)
        limited = min(value, total, MAX_EVIDENCE)
        if limited > 0:
            for point, limit in limits:
                point.evidence += limited * limit / total
        return limited

    def _point_near(self, seen: UnexplainedPoint, max_square: float) -> UnexplainedPoint:
        """The unexplained point next to an observed one, moved there; else a new one."""

        def squared_distance(point: UnexplainedPoint) -> float:
            return (point.x - seen.x) ** 2 + (point.y - seen.y) ** 2

        nearest = min(self.points, key=squared_distance, default=None)
        if nearest is not None and squared_distance(nearest) <= max_square:
            nearest.x, nearest.y = seen.x, seen.y
            return nearest
        if len(self.points) == MAX_POINTS:
            self.points.remove(min(self.points, key=lambda point: point.evidence))
        self.points.append(seen)
        return seen

    def learn(self, compared: ScanComparison) -> None:
        """Counts the landmarks of a scan that does not contradict the pose, and its innovations."""
        p, cell, observers = compared.rate, compared.cell, compared.observers
        misses = compared.num_expected - len(observers)
        self._squares = max(_averaged(self._squares, misses**2, SCAN_MEMORY), RAREST)
        self._variance = _averaged(self._variance, float(p @ (1 - p)), SCAN_MEMORY)
        for each in compared.observations:
            if observers.get(each.landmark) is each:
                self._scale = _averaged(self._scale, each.nis / 2, SCALE_MEMORY)
                self.max_range = max(self.max_range, each.z[0])
        self._scale = max(self._scale, 1.0)
        unexplained = len(compared.unexplained)
        self._clutter = max(_averaged(self._clutter, unexplained, SCAN_MEMORY), RAREST)
        full = cell[self._expected[cell] >= MEMORY]
        if len(full) > 0:
            self._expected[full] /= 2
            self._observed[full] /= 2
        np.add.at(self._expected, cell, 1)
        for j in observers:
            self._observed[cell[j]] += 1


def _averaged(mean: float, value: float, memory: float) -> float:
    """Exponential average over `memory` values, with one more."""
    return mean + (value - mean) / memory
