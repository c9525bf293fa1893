"""When the compressed filter is used, and among which landmarks.

A neighborhood is entered with every landmark that an observation can be of until the robot has
gone some way: those within a radius of its position, or outside of it by less than twice their
gate. Each step needs the range up to which its scan may be of a landmark, and the way since then
with the gate of its odometry; the neighborhood is left where this exceeds the radius, or where a
landmark outside is observed by its identity.
"""

from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Any

import numpy as np

from saccade.slam._step_kernels import Rules, Steps
from saccade.slam.association._name_table_kernels import UNDECIDED, NameTable, may_cull
from saccade.slam.filter.compressed import CompressedSlam, Neighborhood
from saccade.slam.map_management._kernels import VisibilityCounts
from saccade.slam.map_management.culling import PER_LANDMARK
from saccade.types import BoolArray, FloatArray, IntArray

LARGE = 1000
"""Landmarks in a map from which "auto" uses neighborhoods."""
MAX_FRACTION = 0.25
"""Of the map; with "auto", a larger neighborhood is not entered."""
MARGIN = 1.0
"""Distance that a robot goes in a neighborhood, as a fraction of the range that its scans need."""


@dataclass(frozen=True)
class Way:
    """Each (t,) of steps, from the entry to the neighborhood on."""

    length: FloatArray
    """Metres."""
    position: FloatArray
    """Variance of the positions that the controls add, in square metres."""
    heading: FloatArray
    """Variance of the headings, in square radians."""
    position_bias: FloatArray
    """Standard deviation that the odometry biases add to the position, in metres."""
    heading_bias: FloatArray
    """The same of the heading, in radians."""

    @property
    def sigma(self) -> FloatArray:
        """(t,) bound of the standard deviation of the position by odometry, in metres."""
        heading = np.sqrt(self.heading) + self.heading_bias
        return np.asarray(np.sqrt(self.position) + self.position_bias + self.length * heading)


class Submaps:
    """Decides in which neighborhood of a large map the next steps are taken.

    Args:
        always: whether neighborhoods are used in every map, or only in large ones.
        rules: of the steps.
    """

    def __init__(self, always: bool, rules: Rules) -> None:
        self._always = always
        self._doubts, self._recovers = rules.culling.enabled, rules.lost.enabled
        self._view = 0.0
        gate = rules.gates.new_gate
        self._gate = sqrt(gate) if isfinite(gate) else 0.0
        self._radius = -1.0
        self._in_whole = False
        self._way = np.zeros(5)
        self._bias = self._bias_sigma = np.zeros(0)
        self._needed = 0.0

    def is_small(self, ekf: CompressedSlam, observations: int) -> bool:
        """Whether the map is too small for neighborhoods, also after so many observations."""
        if self._always or ekf.neighborhood is not None or len(ekf) + observations >= LARGE:
            return False
        self._radius = -1.0
        return True

    def plan(
        self, ekf: CompressedSlam, s: Steps, end: int, names: NameTable, reach: float
    ) -> tuple[int, Neighborhood | None]:
        """The neighborhood for the next steps, None for the whole map, and their end.

        The sensor has observed landmarks up to a range of `reach` so far.
        """
        i = int(s.position[0])
        begun = s.position[1] >= 0
        room = LARGE - len(ekf)
        if not begun and not self._always and room > 0:
            self._radius = -1.0
            if s.edge[end] - s.edge[i] > room:  # it may become large before the end
                end = max(i + 1, int(np.searchsorted(s.edge, s.edge[i] + room, "right")) - 1)
            return end, None
        expects = self._recovers or (self._doubts and may_cull(names))
        self._view = max(reach, 0.0) if expects else 0.0
        if begun and ekf.neighborhood is None and self._radius < 0:
            return i + 1, None
        if not begun and (self._radius < 0 or (ekf.neighborhood is None and not self._in_whole)):
            self._enter(ekf, s, names)
        covered = self._covered(ekf, s, end, names)
        if not covered[0] and not begun:
            self._enter(ekf, s, names)
            covered = self._covered(ekf, s, end, names)
        covered[0] = True
        stop = end if covered.all() else i + int(covered.argmin())
        return stop, ekf.neighborhood

    def count(self, s: Steps, first: int) -> None:
        """Count the way of the steps that were taken since `first`."""
        last = int(s.position[0])
        if last > first and self._radius >= 0:
            way = self._way_of(s, first, last)
            self._way = np.array([each[-1] for each in vars(way).values()])
            self._needed = max(self._needed, float(self._range_of(s, first, last).max()))

    def _enter(self, ekf: CompressedSlam, s: Steps, names: NameTable) -> None:
        """Enter the neighborhood of the robot for the next step and some that may follow."""
        i = int(s.position[0])
        f, r = ekf.robot_filter, ekf.robot_filter.robot_size
        self._bias = f.state[3:r].copy()
        self._bias_sigma = np.sqrt(np.abs(f.P[range(3, r), range(3, r)]))
        self._way = np.zeros(5)
        way, needed = self._way_of(s, i, i + 1), float(self._range_of(s, i, i + 1)[0])
        reach = max(needed, self._needed)
        self._radius = reach * (1 + MARGIN) + float(way.length[0] + self._gate * way.sigma[0])
        self._needed = 0.0
        predicted, S = ekf.predict_observations()
        q = predicted[:, 0]
        sigma = np.sqrt(np.abs(S[:, 0, 0]) + q * q * np.abs(S[:, 1, 1]))
        near = q - 2 * self._gate * sigma <= self._radius
        pending = names.landmark[names.votes > 0], names.target[names.votes > 0]
        for named in (*_named(s, names, i, i + 1), *pending):
            near[named[(named >= 0) & (named < len(near))]] = True
        self._in_whole = not self._always and near.mean() > MAX_FRACTION
        if not self._in_whole:
            ekf.enter(np.flatnonzero(near))

    def _covered(self, ekf: CompressedSlam, s: Steps, end: int, names: NameTable) -> BoolArray:
        """Whether each step from the next one on can be taken in the neighborhood."""
        i = int(s.position[0])
        way = self._way_of(s, i, end)
        needed = way.length + self._gate * way.sigma + self._range_of(s, i, end)
        covered = np.asarray(needed <= self._radius)
        if ekf.neighborhood is not None:
            for named in _named(s, names, i, end):
                is_outside = (named >= 0) & (ekf.neighborhood.from_map(named) < 0)
                outside = s.edge[i] + np.flatnonzero(is_outside)
                covered[np.searchsorted(s.edge, outside, "right") - 1 - i] = False
        return covered

    def _way_of(self, s: Steps, start: int, end: int) -> Way:
        """The way to each step from `start` to `end`."""
        u, U, D = s.control[start:end], s.U[start:end], s.bias_jacobian[start:end]
        c = u.shape[1] - 1  # the heading's
        u = u + D @ self._bias
        bias = np.abs(D) @ self._bias_sigma
        length = np.hypot(u[:, 0], u[:, 1]) if c == 2 else np.abs(u[:, 0])
        heading = U[:, c, c]
        parts = (
            length,
            U[:, :c, :c].trace(axis1=1, axis2=2) + length**2 * heading,
            heading,
            np.hypot.reduce(bias[:, :c], axis=1),
            bias[:, c],
        )
        return Way(*(np.cumsum([w, *p])[1:] for w, p in zip(self._way, parts, strict=True)))

    def _range_of(self, s: Steps, start: int, end: int) -> FloatArray:
        """(t,) range that the scan of each step needs, in metres."""
        needed = np.full(end - start, self._view)
        first, last = s.edge[start], s.edge[end]
        reach = s.z[first:last, 0] + self._gate * np.sqrt(s.R[first:last, 0, 0])
        step = np.searchsorted(s.edge, np.arange(first, last), "right") - 1 - start
        np.maximum.at(needed, step, reach)
        return np.maximum.accumulate(needed) if self._doubts or self._recovers else needed


def _named(s: Steps, names: NameTable, start: int, end: int) -> tuple[IntArray, ...]:
    """Landmarks (k,) that the observations of some steps may be of, whatever their position.

    Those that are known, those that their names say, and those to which these names may move.
    """
    scans = slice(s.edge[start], s.edge[end])
    known, name = s.landmark[scans], s.name[scans]
    if len(names.landmark) == 0:
        return (known,)
    return known, *(np.where(name >= 0, each[name], -1) for each in (names.landmark, names.target))


def read_names(names: NameTable, place: Neighborhood) -> NameTable:
    """The names with the landmarks' numbers in a neighborhood."""
    target = place.from_map(names.target)
    target[(names.target >= 0) & (target < 0)] = UNDECIDED
    landmark, stale = place.from_map(names.landmark), place.from_map(names.stale)
    return names._replace(landmark=landmark, target=target, stale=stale)


def write_names(names: NameTable, local: NameTable, place: Neighborhood) -> None:
    """Write what `read_names` gave back, where it has changed."""
    before = read_names(names, place)
    for name in ("landmark", "target", "stale"):
        new, old = getattr(local, name), getattr(before, name)
        getattr(names, name)[new != old] = place.to_map(new)[new != old]


def read_counts(counts: VisibilityCounts, place: Neighborhood) -> VisibilityCounts:
    """The counts of a neighborhood, of those of the map."""
    numbers = place.numbers(len(place.filter_state.blocks))
    return counts._replace(
        **{name: array[numbers] for name, array in _by_landmark(counts)},
    )


def write_counts(counts: VisibilityCounts, local: VisibilityCounts, place: Neighborhood) -> None:
    """Write what `read_counts` gave back."""
    numbers = place.numbers(len(place.filter_state.blocks))
    for name, array in _by_landmark(counts):
        array[numbers] = getattr(local, name)


def _by_landmark(counts: VisibilityCounts) -> list[tuple[str, Any]]:
    return [(name, getattr(counts, name)) for name in PER_LANDMARK]
