"""Many steps at once in compiled code, in the whole map or in a neighborhood of the robot."""

from math import inf
from operator import is_not
from typing import Any, NamedTuple

import numpy as np

from saccade._jit import Bound
from saccade.slam._recovery_kernels import OUTSIDE, SKIPPED, LostEvidence, LostRule
from saccade.slam._step_kernels import (
    CONTRADICTED,
    Rules,
    StepResults,
    Steps,
    bind_steps,
    take_steps,
)
from saccade.slam.association._kernels import NEW, Gates
from saccade.slam.association._name_table_kernels import NameGates, NameTable
from saccade.slam.association.doubted import DoubtedIdentity
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.association.rule import Association
from saccade.slam.filter.compressed import CompressedSlam, Neighborhood
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.map_management._kernels import CullingRule
from saccade.slam.map_management.culling import Culling
from saccade.slam.results import new_innovations
from saccade.slam.submaps import Submaps, read_counts, read_names, write_counts, write_names

NO_GATES = Gates(inf, inf, False)
"""For rules that are not nearest-neighbor association."""


class Binding:
    """Binds the arguments of `take_steps`, anew where they are others than before."""

    def __init__(self) -> None:
        self._arguments: tuple[object, ...] = ()
        self._bound: Bound | None = None

    def __call__(self, *arguments: Any) -> Bound:
        """The arguments of `bind_steps`, bound."""
        if self._bound is None or any(map(is_not, arguments, self._arguments)):
            self._arguments, self._bound = arguments, bind_steps(*arguments)
        return self._bound

    def __reduce__(self) -> tuple[type["Binding"], tuple[()]]:
        """A copy binds arrays of its own."""
        return Binding, ()


class Stride(NamedTuple):
    """How steps are taken, and in which part of the map."""

    rules: Rules
    submaps: Submaps
    binding: Binding


def new_stride(
    associate: Association, culling: CullingRule, lost: LostRule, *, adds: bool, submaps: bool
) -> Stride:
    """How steps are taken with an association rule; `submaps` for neighborhoods in every map."""
    doubted = associate if isinstance(associate, DoubtedIdentity) else None
    nearest = doubted.geometry if doubted else associate
    rules = Rules(
        nearest=isinstance(nearest, NearestNeighbor),
        gates=nearest.gates if isinstance(nearest, NearestNeighbor) else NO_GATES,
        names=doubted.name_gates if doubted else NameGates(False, inf),
        culling=culling,
        lost=lost,
        adds=adds,
    )
    return Stride(rules, Submaps(submaps, rules), Binding())


def take_stride(
    ekf: EkfSlam,
    s: Steps,
    end: int,
    stride: Stride,
    names: NameTable,
    culling: Culling,
    evidence: LostEvidence,
    out: StepResults,
) -> bool:
    """Take the steps before `end`, as far as there is room; see `take_steps`."""
    position, place = s.position.tolist(), None
    observations = int(s.edge[end] - s.edge[position[0]])
    if isinstance(ekf, CompressedSlam) and not stride.submaps.is_small(ekf, observations):
        if position[1] < 0:
            ekf.spread()
        end, place = stride.submaps.plan(ekf, s, end, names, culling.reach)
    if place is not None:
        _take_in_neighborhood(place, s, end, stride, names, culling, evidence, out)
        stride.submaps.count(s, position[0])
        return False
    f = ekf.filter_state
    culling.reserve(len(f.blocks))
    evidence.values[OUTSIDE] = 0
    bound = stride.binding(f, ekf.scratch, s, stride.rules, names, culling.counts, evidence, out)
    done = bool(take_steps(bound, end))
    after = s.position.tolist()
    if after[1] >= 0 or after == position:  # there was no room for all of a step
        if after[1] < 0:
            ekf.spread()
        ekf.reserve(_count_new(s))
    stride.submaps.count(s, position[0])
    return done


def _take_in_neighborhood(
    place: Neighborhood,
    s: Steps,
    end: int,
    stride: Stride,
    names: NameTable,
    culling: Culling,
    evidence: LostEvidence,
    out: StepResults,
) -> None:
    """Take steps in a part of the map, whose landmarks have other numbers there."""
    mapped, scans = place.mapped, s.landmark[s.edge[s.position[0]] : s.edge[end]]
    place.reserve(_count_new(s))
    culling.reserve(mapped + len(place.filter_state.blocks) - len(place))
    scans[:] = place.from_map(scans)
    place.mark(scans)
    local_names, counts = read_names(names, place), read_counts(culling.counts, place)
    f, w, rules = place.filter_state, place.scratch, stride.rules
    evidence.values[OUTSIDE] = mapped - len(place)
    bound = stride.binding(f, w, s, rules, local_names, counts, evidence, out)
    take_steps(bound, end)
    while s.position[0] < end and not counts.culled.any() and not evidence.values[SKIPPED]:
        if s.position[1] == CONTRADICTED or not place.flush_if_full():
            break
        take_steps(bound, end)
    place.mark(scans)
    scans[:] = place.to_map(scans)
    write_names(names, local_names, place)
    write_counts(culling.counts, counts, place)


def _count_new(s: Steps) -> int:
    """Landmarks for which room is needed: those of a step that was interrupted, at least one."""
    if s.position[1] < 0:
        return 1
    i = int(s.position[0])
    return max(int(np.count_nonzero(s.landmark[s.edge[i] : s.edge[i + 1]] == NEW)), 1)


def new_results(t: int, k: int) -> StepResults:
    """Room for the results of so many steps and observations."""
    lost = np.zeros(t, np.bool_)
    return StepResults(np.empty((t, 3)), np.empty((t, 3, 3)), new_innovations(k), lost)
