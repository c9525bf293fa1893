"""A filter on its way through a log: pose by pose, or many poses at once in compiled code."""

from dataclasses import dataclass

import numpy as np

from saccade.errors import LogError
from saccade.slam.association.gating import NEW
from saccade.slam.association.nearest_neighbor import (
    Association,
    KnownIdentity,
    NearestNeighbor,
    number_by_first_observation,
)
from saccade.slam.exploring import Explorer
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.map_management.candidates import Candidates
from saccade.slam.map_management.culling import Culling
from saccade.slam.results import Replay
from saccade.slam.stretch import Stretch
from saccade.types import FloatArray, IntArray, LandmarkLog

FARTHEST = 1e9
"""Metres from the origin at which an estimate has gone astray."""


@dataclass(eq=False)
class Passage:
    """A filter on its way through a log, and what it has said so far."""

    log: LandmarkLog
    ekf: EkfSlam
    associate: Association
    candidates: Candidates
    presence: Culling | None
    """None where the log says what was seen."""
    U: FloatArray
    """(t, c, c)."""
    R: FloatArray
    """(k, 2, 2)."""
    scans: IntArray
    """(t + 2,) observations scans[i] to scans[i + 1] are made from pose i."""
    said: Replay
    association: IntArray
    """(k,)."""

    def scan(self, start: int, end: int) -> slice:
        """The observations made from poses."""
        return slice(int(self.scans[start]), int(self.scans[end]))

    def __post_init__(self) -> None:
        self._known = type(self.associate) is KnownIdentity and not self.associate.number
        self._explorer: Explorer | None = None
        if self.ekf.is_compiled and type(self.associate) is NearestNeighbor:
            self._explorer = Explorer(self.ekf, self.associate, self.candidates, self.presence)

    @property
    def in_stretches(self) -> bool:
        """Whether many poses at once take less time than one after the other."""
        return self._known or self._explorer is not None

    def go_on(self, start: int, end: int) -> None:
        """Go to some poses, and see what is to be seen there.

        Raises:
            LogError: a pose is nowhere; says which.
        """
        done = start
        if start == 0 or not self.in_stretches:
            self._step(start)
            if start == 0 and self._known:
                which = number_by_first_observation(self.log.landmark, self.log.observation_pose)
                self.association[:] = np.maximum(which, -1)
            done += 1
        if done < end:
            stretch, said = self._stretch(done, end)
            if self._explorer is None:
                self.ekf.replay_into(stretch, said)
            while self._explorer is not None and stretch.at[0] < end - done:
                self.forget(self._explorer.go_on(stretch, done, self.log.time[done:end], said))
        self._check(start, end)

    def _step(self, step: int) -> None:
        """Go to the next pose, and see what is to be seen there."""
        log, ekf, said = self.log, self.ekf, self.said
        if step > 0:
            ekf.predict(log.control[step - 1], self.U[step - 1])  # C.5-C.9
        scan = np.arange(self.scans[step], self.scans[step + 1])
        if len(scan) > 0:
            z, R = log.observation, self.R
            looks = self.presence is not None and step % self.presence.rule.interval == 0
            expected = ekf.predict_observations().z if looks else None
            found = self.associate(ekf, z[scan], R[scan], log.landmark[scan])
            old, new = scan[found >= 0], scan[found == NEW]
            what = ekf.update_scan(z[old], R[old], found[found >= 0])  # C.10-C.14
            said.innovation[old], said.innovation_covariance[old] = what[2:4]
            said.nis[old] = what.nis
            confirmed = self.candidates.confirm(ekf, z[new], R[new], log.time[step])
            self.association[scan] = np.maximum(found, -1)
            for k in new[confirmed]:
                self.association[k] = ekf.augment(z[k], R[k])  # C.15-C.18
                self.associate.added(int(self.association[k]), int(log.landmark[k]))
            if self.presence is not None and expected is not None:
                self.forget(self.presence.update(ekf, expected, self.association[scan]))
        said.pose[step], said.covariance[step] = ekf.pose, ekf.pose_covariance

    def forget(self, landmarks: IntArray) -> None:
        """Take landmarks out of the map; what was seen of them was nothing."""
        if len(landmarks) > 0:
            kept = np.ones(len(self.ekf) + 1, np.bool_)
            kept[landmarks] = False
            number = np.cumsum(kept) - 1
            number[~kept] = number[-1] = -1  # the last is for what is of none
            self.ekf.remove(landmarks)
            self.association[:] = number[self.association]

    def _stretch(self, start: int, end: int) -> tuple[Stretch, Replay]:
        """The stretch of the log that leads to poses, and where what is said of them is kept."""
        log, seen = self.log, self.scan(start, end)
        stretch = Stretch.of(
            log.control[start - 1 : end - 1],
            self.U[start - 1 : end - 1],
            log.observation_pose[seen] - start,
            log.observation[seen],
            self.R[seen],
            self.association[seen],
        )
        poses, observations = self.said[:2], self.said[2:]
        return stretch, Replay(*(p[start:end] for p in poses), *(k[seen] for k in observations))

    def _check(self, start: int, end: int) -> None:
        """Raise for the first of some poses that is nowhere."""
        astray = ~(np.abs(self.said.pose[start:end]).max(1) < FARTHEST)
        if astray.any():
            raise LogError(
                f"pose {start + int(astray.argmax())}: expected an estimate on this planet, found "
                "that it has gone astray; observations or controls contradict the deviations "
                "they are said to have"
            )
