"""The map of a drive: the filter, and what is known of its landmarks."""

import numpy as np
import numpy.typing as npt

from saccade.frames import Drive
from saccade.slam.ekf import EkfSlam
from saccade.slam.models import compose
from saccade.slam.outcomes import Expectation
from saccade.slam.retraction import INVARIANT
from saccade.types import FloatArray, IntArray
from saccade.visual.camera import Sightings
from saccade.visual.config import VisualConfig
from saccade.visual.landmarks import Landmarks
from saccade.visual.motion import Foresight, Motion, joined, step_between


class VisualMap:
    """A pose, landmarks around it, and how they look.

    Args:
        drive: where it begins, and its odometry.
        config: how to map.
    """

    def __init__(self, drive: Drive, config: VisualConfig) -> None:
        bias = drive.odometry_bias if any(drive.odometry_bias) else ()
        self.ekf = EkfSlam(
            np.concatenate([drive.start, np.zeros(len(bias))]),
            np.diag(np.square([0.0, 0.0, 0.0, *bias])),
            motion=compose,
            retraction=INVARIANT,
            huber=config.huber,
        )
        self.landmarks = Landmarks()
        self._drive, self._config = drive, config
        ahead, turn = config.acceleration
        self._foresight = Foresight(np.array([ahead, ahead / 4, turn]))

    def predict(self, number: int, motion: Motion | None) -> FloatArray:
        """Go to a frame after the first.

        Args:
            number: of the frame.
            motion: what the camera says of the way, if anything.

        Returns:
            The control (3,) that was taken for true, without the camera.
        """
        drive = self._drive
        seconds = float(drive.time[number] - drive.time[number - 1])
        odometry = drive.control[number - 1], drive.control_covariance[number - 1]
        control, covariance = self._foresight.foresee(*odometry, seconds)
        taken = control, covariance
        if motion is not None:
            taken = joined((motion.control, motion.covariance), taken)
        self.ekf.predict(*taken)
        return control

    def moved(self, number: int, before: FloatArray, told: int) -> None:
        """Remember how the robot moved, once all that the frame showed is in.

        Args:
            number: of the frame.
            before: (3,) pose of the last one.
            told: sightings that said so.
        """
        if number == 0:
            return
        drive = self._drive
        seconds = float(drive.time[number] - drive.time[number - 1])
        step = step_between(before, self.ekf.pose)
        blind = drive.control_covariance[number - 1]
        self._foresight.saw(step, blind / (1 + told) ** 2, seconds)

    def meet(self, landmark: IntArray, seen: Sightings, number: int) -> None:
        """Take in sightings of landmarks of the map.

        What they get wrong together would be taken for knowledge if each counted as another
        one: each of k has k times the variance of the common error, so that together they
        say of it what one does.

        Args:
            landmark: (k,) numbers.
            seen: k sightings.
            number: of the frame.
        """
        rows = self.landmarks.rows(landmark)
        if len(rows) > 0:
            self.ekf.look(seen.z, self._covariance(seen, len(rows)), rows)
            self.landmarks.met(rows, number)

    def take_in(self, seen: Sightings, descriptors: npt.NDArray[np.uint8], number: int) -> IntArray:
        """Make landmarks of k sightings; returns their numbers (k,)."""
        first = len(self.ekf)
        R = self._covariance(seen, 1)
        self.ekf.look(seen.z, R, np.arange(first, first + len(R)))
        return self.landmarks.add(seen.height, descriptors, number)

    def expect(self, rows: IntArray) -> Expectation:
        """What should be seen of landmarks (k,)."""
        every = self.ekf.expect()
        return Expectation(every.z[rows], every.covariance[rows])

    def shrink(self, followed: IntArray, number: int) -> None:
        """Give up what is too much for the budget."""
        surplus = len(self.landmarks) - self._config.landmarks
        if surplus > 0:
            gone = self.landmarks.least_wanted(surplus, followed, number)
            self.forget(gone)

    def forget(self, rows: IntArray) -> None:
        """Take landmarks out of the map."""
        kept = np.ones(len(self.landmarks), np.bool_)
        kept[rows] = False
        self.ekf.remove(rows)
        self.landmarks.keep(kept)

    def _covariance(self, seen: Sightings, together: int) -> FloatArray:
        share, degrees = self._config.common_sigma
        common = np.zeros_like(seen.covariance)
        common[:, 0, 0] = together * np.square(share * seen.z[:, 0])
        common[:, 1, 1] = together * np.radians(degrees) ** 2
        return seen.covariance + common
