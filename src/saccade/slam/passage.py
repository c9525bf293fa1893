"""Runs the filter over a log: pose by pose, or many poses at once in compiled code."""

from dataclasses import dataclass

import numpy as np

from saccade.errors import LogError
from saccade.slam._log_kernels import Replay, Stretch
from saccade.slam.association._kernels import NEW
from saccade.slam.association.known import KnownIdentity, number_by_first_observation
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.association.rule import Association
from saccade.slam.checkpoint import Arrays
from saccade.slam.exploring import Explorer
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.map_management.candidates import Candidates
from saccade.slam.map_management.culling import Culling
from saccade.slam.stretch import new_stretch
from saccade.types import FloatArray, IntArray, LandmarkLog

MAX_COORDINATE = 1e9
"""Metres from the origin at which the estimate has diverged."""


@dataclass(eq=False)
class Passage:
    """The filter on a log, and its results so far."""

    log: LandmarkLog
    ekf: EkfSlam
    associate: Association
    candidates: Candidates
    culling: Culling | None
    """None where no landmark is culled."""
    U: FloatArray
    """(t, c, c)."""
    R: FloatArray
    """(k, 2, 2)."""
    scans: IntArray
    """(t + 2,) observations scans[i] to scans[i + 1] are made from pose i."""
    results: Replay
    association: IntArray
    """(k,)."""

    def scan(self, start: int, end: int) -> slice:
        """The observations made from poses."""
        return slice(int(self.scans[start]), int(self.scans[end]))

    def __post_init__(self) -> None:
        self._known = type(self.associate) is KnownIdentity and not self.associate.number
        self._explorer: Explorer | None = None
        if self.ekf.is_compiled and type(self.associate) is NearestNeighbor:
            self._explorer = Explorer(self.ekf, self.associate, self.candidates, self.culling)

    @property
    def in_stretches(self) -> bool:
        """Whether many poses are processed at once."""
        return self._known or self._explorer is not None

    def advance(self, start: int, end: int) -> None:
        """Process the poses from `start` to `end`.

        Raises:
            LogError: the estimate diverged; names the pose.
        """
        done = start
        if start == 0 or not self.in_stretches:
            self._step(start)
            if start == 0 and self._known:
                number = number_by_first_observation(self.log.landmark, self.log.observation_pose)
                self.association[:] = np.maximum(number, -1)
            done += 1
        if done < end:
            stretch, results = self._stretch(done, end)
            if self._explorer is None:
                self.ekf.replay_into(stretch, results)
            while self._explorer is not None and stretch.next_pose[0] < end - done:
                time = self.log.time[done:end]
                self.remove(self._explorer.advance(stretch, done, time, results))
        self._check(start, end)

    def remove(self, landmarks: IntArray) -> None:
        """Remove landmarks from the map; their observations become unassociated."""
        if len(landmarks) > 0:
            kept = np.ones(len(self.ekf) + 1, np.bool_)
            kept[landmarks] = False
            number = np.cumsum(kept) - 1
            number[~kept] = number[-1] = -1  # the last is for unassociated observations
            self.ekf.remove(landmarks)
            self.association[:] = number[self.association]

    def to_arrays(self) -> Arrays:
        """The results so far as named arrays."""
        return {"association": self.association, **self.results._asdict()}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        for name, array in self.to_arrays().items():
            array[...] = arrays[name]

    def _step(self, step: int) -> None:
        """Process one pose."""
        log, ekf, results = self.log, self.ekf, self.results
        if step > 0:
            ekf.predict(log.control[step - 1], self.U[step - 1])  # C.5-C.9
        scan = np.arange(self.scans[step], self.scans[step + 1])
        if len(scan) > 0:
            z, R = log.observation, self.R
            check = self.culling is not None and self.culling.is_due(step)
            expected = ekf.predict_observations().z if check else None
            found = self.associate(ekf, z[scan], R[scan], log.landmark[scan])
            old, new = scan[found >= 0], scan[found == NEW]
            update = ekf.update_scan(z[old], R[old], found[found >= 0])  # C.10-C.14
            results.innovation[old] = update.innovation
            results.innovation_covariance[old] = update.innovation_covariance
            results.nis[old] = update.nis
            confirmed = self.candidates.confirm(ekf, z[new], R[new], log.time[step])
            self.association[scan] = np.maximum(found, -1)
            for k in new[confirmed]:
                self.association[k] = ekf.augment(z[k], R[k])  # C.15-C.18
                self.associate.added(int(self.association[k]), int(log.landmark[k]))
            if self.culling is not None and expected is not None:
                self.remove(self.culling.update(ekf, expected, self.association[scan]))
        results.pose[step], results.covariance[step] = ekf.pose, ekf.pose_covariance

    def _stretch(self, start: int, end: int) -> tuple[Stretch, Replay]:
        """The stretch of the log that leads to poses, and views of its results."""
        log, scan = self.log, self.scan(start, end)
        stretch = new_stretch(
            log.control[start - 1 : end - 1],
            self.U[start - 1 : end - 1],
            log.observation_pose[scan] - start,
            log.observation[scan],
            self.R[scan],
            self.association[scan],
        )
        poses, observations = self.results[:2], self.results[2:]
        return stretch, Replay(*(p[start:end] for p in poses), *(k[scan] for k in observations))

    def _check(self, start: int, end: int) -> None:
        """Raise for the first of some poses that diverged."""
        diverged = ~(np.abs(self.results.pose[start:end]).max(1) < MAX_COORDINATE)
        if diverged.any():
            raise LogError(
                f"pose {start + int(diverged.argmax())}: expected an estimate on this planet, "
                "found that it has gone astray; observations or controls contradict the "
                "deviations they are said to have"
            )
