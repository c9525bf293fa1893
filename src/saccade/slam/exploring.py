"""Through a stretch of a log that does not say what is seen, in compiled code.

Predict, gate, choose, correct, confirm candidates, and miss what should have been seen: what
`NearestNeighbor`, `Candidates` and `Culling` do one after the other, many poses at a time.
"""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.association.gating import NEW, associate_nearest
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.filter._kernels import is_full
from saccade.slam.filter._range_bearing_kernels import (
    augment_range_bearing,
    expected_observation,
    inverse_observe,
)
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import LANDMARKS, FilterState
from saccade.slam.map_management.candidates import (
    CandidateBuffer,
    Candidates,
    ConfirmationPolicy,
    confirm,
)
from saccade.slam.map_management.culling import (
    NO_CULLING,
    Culling,
    CullingRule,
    VisibilityCounts,
    check_visibility,
)
from saccade.slam.results import Replay
from saccade.slam.stretch import Stretch, arrive, see, step
from saccade.types import FloatArray, IntArray


class Search(NamedTuple):
    """How what is seen is told."""

    limit: float
    outer: float
    """Normalized distances squared at the gates of `NearestNeighbor`."""
    mutual: bool
    patience: ConfirmationPolicy
    rule: CullingRule
    """That of `Culling`; looks at the map every 0 poses, which is never, if there is none."""


class Explorer:
    """Takes a filter through the stretches of a log.

    Args:
        ekf: the filter; its motion and sensor model are those of this package.
        associate: which observation is of which landmark.
        candidates: what becomes a landmark.
        presence: what is none any more; None if that is never so.
    """

    def __init__(
        self,
        ekf: EkfSlam,
        associate: NearestNeighbor,
        candidates: Candidates,
        presence: Culling | None,
    ) -> None:
        self._ekf, self._candidates, self._presence = ekf, candidates, presence
        self._search = Search(
            *associate.limits,
            mutual=associate.mutual,
            patience=candidates.patience,
            rule=NO_CULLING if presence is None else presence.rule,
        )

    def go_on(self, s: Stretch, first: int, time: FloatArray, out: Replay) -> IntArray:
        """Go on to the end of a stretch, or to where landmarks are found to be none.

        Args:
            s: the stretch; its `landmark` is filled.
            first: the number of its first pose in the log.
            time: (t,) of its poses.
            out: filled.

        Returns:
            (g,) the landmarks that are to be removed.
        """
        s = s._replace(slopes=self._ekf._slopes(s.control))
        most = int(np.diff(s.edge).max(initial=0))
        gone = np.empty(0, np.int64)
        while s.at[0] < len(s.control) and len(gone) == 0:
            self._ekf._make_room(max(most, 1))
            self._candidates.make_room(most)
            b, how = self._ekf._filter_state, self._ekf._huber_kind
            w, watched = (
                self._candidates.waiting,
                VisibilityCounts.from_counts(np.empty((0, 2), np.int64)),
            )
            if self._presence is not None:
                self._presence.make_room(len(b.blocks))
                watched = self._presence.counts
            explore(b, *how, s, first, time, self._search, w, watched, out)
            if self._presence is not None:
                gone = self._presence.remove_culled()
        return gone


@kernel()
def explore(
    b: FilterState,
    kind: int,
    huber: float,
    s: Stretch,
    first: int,
    time: FloatArray,
    search: Search,
    waiting: CandidateBuffer,
    watch: VisibilityCounts,
    out: Replay,
) -> None:
    """Go on as far as there is room, and until landmarks are gone."""
    gone = False
    while s.at[0] < len(s.control) and not is_full(b) and not gone:
        i = s.at[0]
        start, end = s.edge[i], s.edge[i + 1]
        found, looks = s.landmark[start:end], False
        if end > start and search.rule.interval > 0:
            looks = (first + i) % search.rule.interval == 0
        if s.at[1] < 0:
            step(b, kind, s)
            if end > start:
                how = search.limit, search.outer, search.mutual
                associate_nearest(b, kind, s.z[start:end], s.R[start:end], *how, found)
            if looks:
                _expect(b, watch)
        if not see(b, kind, huber, s, out):
            return
        if (found == NEW).any():
            new = start + np.flatnonzero(found == NEW)
            if len(b.blocks) - b.counts[LANDMARKS] < len(new):
                return
            if len(waiting.last_observed) - waiting.size[0] < len(new):
                return
            _found(b, s, new, time[i], search.patience, waiting)
        for k in range(end - start):
            found[k] = max(found[k], -1)
        if looks:
            gone = check_visibility(watch, search.rule, b.counts[LANDMARKS], found)
        arrive(b, kind, s, out)


@kernel()
def _found(
    b: FilterState,
    s: Stretch,
    new: IntArray,
    time: float,
    patience: ConfirmationPolicy,
    waiting: CandidateBuffer,
) -> None:
    """Look for new observations (m,) among the candidates; the map takes in what that confirms."""
    xy, C = np.empty((len(new), 2)), np.empty((len(new), 2, 2))
    confirmed = np.empty(len(new), np.bool_)
    for i in range(len(new)):
        inverse_observe(b, s.z[new[i]], s.R[new[i]], xy[i], C[i])
    confirm(waiting, patience, xy, C, time, confirmed)
    for i in range(len(new)):
        if confirmed[i]:
            s.landmark[new[i]] = b.counts[LANDMARKS]
            augment_range_bearing(b, s.z[new[i]], s.R[new[i]])


@kernel()
def _expect(b: FilterState, watch: VisibilityCounts) -> None:
    """Note where every landmark should be seen."""
    for i in range(b.counts[LANDMARKS]):
        watch.expected[i, 0], watch.expected[i, 1] = expected_observation(b, i)
    watch.mapped_before[0] = b.counts[LANDMARKS]
