"""Many steps at once in compiled code, in the whole map or in a neighborhood of the robot."""

from math import inf
from typing import NamedTuple

import numpy as np

from saccade.slam._recovery_kernels import OUTSIDE, SKIPPED, LostEvidence, LostRule
from saccade.slam._step_kernels import Rules, StepResults, Steps, take_steps
from saccade.slam.association._kernels import NEW, Gates
from saccade.slam.association._name_kernels import NameGates
from saccade.slam.association._name_table_kernels import NameTable
from saccade.slam.association.doubted import DoubtedIdentity
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.association.rule import Association
from saccade.slam.filter.compressed import CompressedSlam
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.map_management._kernels import CullingRule
from saccade.slam.map_management.culling import Culling
from saccade.slam.results import new_innovations
from saccade.slam.submaps import Submaps, read_counts, read_names, write_counts, write_names

NO_GATES = Gates(inf, inf, False)
"""For rules that are not nearest-neighbor association."""


class Stride(NamedTuple):
    """How steps are taken, and in which part of the map."""

    rules: Rules
    submaps: Submaps


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
    return Stride(rules, Submaps(submaps, rules))


def take_stride(
    ekf: EkfSlam,
    s: Steps,
    end: int,
    stride: Stride,
    names: NameTable,
    culling: Culling,
    evidence: LostEvidence,
    out: StepResults,
) -> None:
    """Take the steps before `end`, as far as there is room; see `take_steps`."""
    i, new, place = int(s.position[0]), 0, None
    if s.position[1] >= 0:  # it was interrupted; a number that depends on this step alone
        new = int(np.count_nonzero(s.landmark[s.edge[i] : s.edge[i + 1]] == NEW))
    else:
        ekf.spread()
    if isinstance(ekf, CompressedSlam):
        end, place = stride.submaps.plan(ekf, s, end, names, culling.reach)
    part = ekf if place is None else place
    part.reserve(max(new, 1))
    f, w = part.filter_state, part.scratch
    mapped, scans = len(ekf), s.landmark[s.edge[i] : s.edge[end]]
    culling.reserve(mapped + len(f.blocks) - len(part))
    counts, local_names = culling.counts, names
    if place is not None:
        scans[:] = place.from_map(scans)
        place.mark(scans)
        local_names = read_names(names, place)
        counts = read_counts(counts, place)
    evidence.values[OUTSIDE] = mapped - len(part)
    take_steps(f, w, s, end, stride.rules, local_names, counts, evidence, out)
    while place is not None and s.position[0] < end and not counts.culled.any():
        if evidence.values[SKIPPED] or not place.flush_if_full():
            break
        take_steps(f, w, s, end, stride.rules, local_names, counts, evidence, out)
    if place is not None:
        place.mark(scans)
        scans[:] = place.to_map(scans)
        write_names(names, local_names, place)
        write_counts(culling.counts, counts, place)
    stride.submaps.count(s, i)


def new_results(t: int, k: int) -> StepResults:
    """Room for the results of so many steps and observations."""
    lost = np.zeros(t, np.bool_)
    return StepResults(np.empty((t, 3)), np.empty((t, 3, 3)), new_innovations(k), lost)
