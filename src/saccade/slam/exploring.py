"""Unknown association over consecutive poses of a log, in compiled code."""

import numpy as np

from saccade.slam._log_kernels import Replay, Search, Stretch, explore
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.map_management.candidates import Candidates
from saccade.slam.map_management.culling import NO_CULLING, Culling
from saccade.types import FloatArray, IntArray


class Explorer:
    """Runs the filter over stretches of a log with unknown association.

    Args:
        ekf: the filter; its motion and sensor model are those of this package.
        associate: the association.
        candidates: what may become a landmark.
        culling: removes landmarks; None if none are removed.
    """

    def __init__(
        self,
        ekf: EkfSlam,
        associate: NearestNeighbor,
        candidates: Candidates,
        culling: Culling | None,
    ) -> None:
        self._ekf, self._candidates = ekf, candidates
        self._culls = culling is not None
        self._culling = culling or Culling(NO_CULLING.field_of_view, NO_CULLING.min_ratio)
        rule = NO_CULLING if culling is None else culling.rule
        self._search = Search(associate.gates, candidates.policy, rule)

    def advance(self, s: Stretch, first: int, time: FloatArray, out: Replay) -> IntArray:
        """Process a stretch to its end, or to where landmarks are culled.

        Args:
            s: the stretch; its `landmark` is filled.
            first: the number of its first pose in the log.
            time: (t,) of its poses.
            out: filled.

        Returns:
            (g,) the landmarks that are to be removed.
        """
        ekf, candidates, culling = self._ekf, self._candidates, self._culling
        s = s._replace(bias_jacobian=ekf.bias_jacobian(s.control))
        max_scan = int(np.diff(s.edge).max(initial=0))
        culled = np.empty(0, np.int64)
        while s.next_pose[0] < len(s.control) and len(culled) == 0:
            ekf.reserve(max(max_scan, 1))
            candidates.reserve(max_scan)
            if self._culls:
                culling.reserve(len(ekf.filter_state.blocks))
            f, w, counts = ekf.filter_state, ekf.scratch, culling.counts
            explore(f, w, s, first, time, self._search, candidates.buffer, counts, out)
            culled = culling.remove_culled()
        return culled
