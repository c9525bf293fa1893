"""Through a stretch of a log that does not say what is seen, in compiled code.

Predict, gate, choose, correct, confirm candidates, and miss what should have been seen: what
`NearestNeighbor`, `Candidates` and `Presence` do one after the other, many poses at a time.
"""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.association.gating import NEW, associate
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.filter._kernels import is_full
from saccade.slam.filter._range_bearing_kernels import place, take_in, toward
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import LANDMARKS, Belief
from saccade.slam.map_management.candidates import Candidates, Patience, Waiting, confirm
from saccade.slam.map_management.culling import NEVER, Presence, Rule, Watch, look
from saccade.slam.results import Replay
from saccade.slam.stretch import Stretch, arrive, see, step
from saccade.types import FloatArray, IntArray


class Search(NamedTuple):
    """How what is seen is told."""

    limit: float
    outer: float
    """Normalized distances squared at the gates of `NearestNeighbor`."""
    mutual: bool
    patience: Patience
    rule: Rule
    """That of `Presence`; looks at the map every 0 poses, which is never, if there is none."""


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
        presence: Presence | None,
    ) -> None:
        self._ekf, self._candidates, self._presence = ekf, candidates, presence
        self._search = Search(
            *associate.limits,
            mutual=associate.mutual,
            patience=candidates.patience,
            rule=NEVER if presence is None else presence.rule,
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
            b, how = self._ekf._belief, self._ekf._how
            w, watched = self._candidates.waiting, Watch.of(np.empty((0, 2), np.int64))
            if self._presence is not None:
                self._presence.make_room(len(b.own))
                watched = self._presence.watch
            explore(b, *how, s, first, time, self._search, w, watched, out)
            if self._presence is not None:
                gone = self._presence.forget()
        return gone


@kernel()
def explore(
    b: Belief,
    kind: int,
    huber: float,
    s: Stretch,
    first: int,
    time: FloatArray,
    search: Search,
    waiting: Waiting,
    watch: Watch,
    out: Replay,
) -> None:
    """Go on as far as there is room, and until landmarks are gone."""
    gone = False
    while s.at[0] < len(s.control) and not is_full(b) and not gone:
        i = s.at[0]
        start, end = s.edge[i], s.edge[i + 1]
        found, looks = s.landmark[start:end], False
        if end > start and search.rule.every > 0:
            looks = (first + i) % search.rule.every == 0
        if s.at[1] < 0:
            step(b, kind, s)
            if end > start:
                how = search.limit, search.outer, search.mutual
                associate(b, kind, s.z[start:end], s.R[start:end], *how, found)
            if looks:
                _expect(b, watch)
        if not see(b, kind, huber, s, out):
            return
        if (found == NEW).any():
            new = start + np.flatnonzero(found == NEW)
            if len(b.own) - b.used[LANDMARKS] < len(new):
                return
            if len(waiting.last) - waiting.used[0] < len(new):
                return
            _found(b, s, new, time[i], search.patience, waiting)
        for k in range(end - start):
            found[k] = max(found[k], -1)
        if looks:
            gone = look(watch, search.rule, b.used[LANDMARKS], found)
        arrive(b, kind, s, out)


@kernel()
def _found(
    b: Belief, s: Stretch, new: IntArray, time: float, patience: Patience, waiting: Waiting
) -> None:
    """Look for new observations (m,) among the candidates; the map takes in what that confirms."""
    xy, C = np.empty((len(new), 2)), np.empty((len(new), 2, 2))
    confirmed = np.empty(len(new), np.bool_)
    for i in range(len(new)):
        place(b, s.z[new[i]], s.R[new[i]], xy[i], C[i])
    confirm(waiting, patience, xy, C, time, confirmed)
    for i in range(len(new)):
        if confirmed[i]:
            s.landmark[new[i]] = b.used[LANDMARKS]
            take_in(b, s.z[new[i]], s.R[new[i]])


@kernel()
def _expect(b: Belief, watch: Watch) -> None:
    """Note where every landmark should be seen."""
    for i in range(b.used[LANDMARKS]):
        watch.expected[i, 0], watch.expected[i, 1] = toward(b, i)
    watch.before[0] = b.used[LANDMARKS]
