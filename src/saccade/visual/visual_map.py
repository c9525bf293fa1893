"""The map of a drive: the filter, and what is known of its landmarks."""

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from saccade.frames import Drive, steps_between
from saccade.slam.association.jcbb import expect_together
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.error_state import INVARIANT
from saccade.slam.models import compose
from saccade.slam.results import Expectation
from saccade.types import FloatArray, IntArray
from saccade.visual.camera import Sightings
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Motion, Prior
from saccade.visual.ground_scale import WHITE, RoadMotion, Scale
from saccade.visual.landmarks import Landmarks
from saccade.visual.motion_prior import Foresight, TurnDrift, joined, lasting, lasting_of
from saccade.visual.planarity import Plane

STRETCH = 1e-3
"""Share by which the map may be too large or too small; its scale is known ten times less well."""
STILL = 0.02
"""Standard deviation of the turn rate, in rad/s, that odometry may always be off by."""
SHORTEST = 0.05
"""Metres of a step by which odometry and camera are compared."""


class VisualMap:
    """A pose, landmarks around it, and how they look.

    Args:
        drive: where it begins, and its odometry.
        config: how to map.
        ranged: whether frames tell by themselves how far points are.
    """

    def __init__(self, drive: Drive, config: VisualConfig, ranged: bool) -> None:
        share, *others = drive.odometry_bias
        self.scale = Scale(share, config.motion_share[0] if ranged else config.height_sigma)
        self._drawn = self.scale.factor
        self._ranged = ranged
        bias = (0.0, *others) if any(others) and not ranged else ()
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
        self.plane = Plane(float(np.radians(config.tilt_sigma)))
        self._drift = TurnDrift(variance=STILL**2 + (drive.odometry_bias[1] * _speed(drive)) ** 2)
        self._odometry: Prior = np.zeros(3), np.zeros((3, 3))
        self._foresight = Foresight(np.array([ahead, ahead / 4, turn]))

    def foretell(self, number: int) -> Prior:
        """The control that is expected to lead to a frame after the first.

        A single camera takes the length of a step from it. With the last steps in it their errors
        would count anew in each, and where the robot speeds up for seconds it would lag behind.
        """
        drive, factor = self._drive, self.scale.factor
        seconds = self._seconds(number)
        control = drive.control[number - 1] * (factor, factor, 1.0)
        control = self._drift.taken_off(control, seconds)
        self._odometry = control, drive.control_covariance[number - 1]
        if not self._ranged:
            return self._odometry
        return self._foresight.foresee(*self._odometry, seconds)

    def predict(self, number: int, expected: Prior, motion: Motion | None) -> None:
        """Go to a frame after the first.

        A motion that the camera has measured is joined with odometry alone: how the robot moved
        before says little beside it, and lags behind where it speeds up for seconds.

        Args:
            number: of the frame.
            expected: what `foretell` says.
            motion: what the camera says of the way, if anything.
        """
        seconds = self._seconds(number)
        unsure = lasting_of(
            expected[0], seconds, self.scale.sigma if self._ranged else 0.0, self._drift
        )
        taken = expected[0], expected[1] + unsure
        if motion is not None:
            self.plane.heard(motion.tilt, seconds)
            taken = motion.control, lasting(motion, seconds, self._config, self.plane.tilt)
            turned = float(self._drive.control[number - 1, 2] - motion.control[2])
            noise = self._drive.control_covariance[number - 1, 2, 2] + taken[1][2, 2]
            self._drift.heard(turned, seconds, float(noise))
            if not motion.with_prior:
                self._compare(self._odometry[0], motion)
                taken = joined(taken, (self._odometry[0], self._odometry[1] + unsure))
        self.ekf.predict(*taken)

    def along_road(self, motion: Motion, road: RoadMotion) -> Motion:
        """Learn from the road how long odometry's metre is, and this step.

        What was mapped with another metre is made larger or smaller as a whole.

        Args:
            motion: the step by odometry and by what one camera saw.
            road: the same by the road.

        Returns:
            The step by both.
        """
        before = self.scale.factor
        ratio = road.distance / float(np.linalg.norm(motion.shift))
        self.scale.heard(ratio)
        grown = self.scale.factor / before
        self._keep_to_scale()
        length = float(np.hypot(*motion.control[:2]))
        along = np.append(motion.control[:2] / length, 0.0)
        spread = motion.covariance @ along
        total = float(along @ spread) + (WHITE * length) ** 2
        missed = (ratio / self.scale.road - grown) * length
        control = motion.control + spread * missed / total
        covariance = motion.covariance - np.outer(spread, spread) / total
        longer = float(np.hypot(*control[:2])) / length
        return motion._replace(
            control=control,
            shift=motion.shift * longer,
            covariance=(covariance + covariance.T) / 2,
        )

    def _keep_to_scale(self) -> None:
        """Redraw the map once its metre is off by `STRETCH`: that takes as long as a frame."""
        stretch = self.scale.factor / self._drawn
        if abs(stretch - 1) > STRETCH:
            self.ekf.rescale(stretch, self._drive.start[:2])
            self._drawn = self.scale.factor

    def _compare(self, expected: FloatArray, motion: Motion) -> None:
        """Learn how long odometry's metre is from a camera that measures depth."""
        way, seen = (float(np.hypot(*each[:2])) for each in (expected, motion.control))
        if way > SHORTEST:
            self.scale.heard(seen / way)

    def _seconds(self, number: int) -> float:
        return float(self._drive.time[number] - self._drive.time[number - 1])

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3), with what is not known of the scale: all that was driven may be longer."""
        if self._ranged:
            return self.ekf.pose_covariance
        way = np.append(self.ekf.pose[:2] - self._drive.start[:2], 0.0)
        return self.ekf.pose_covariance + self.scale.sigma**2 * np.outer(way, way)

    @property
    def landmark_covariances(self) -> FloatArray:
        """(n, 2, 2), with what is not known of the scale."""
        if self._ranged:
            return self.ekf.landmark_covariances
        way = self.ekf.landmarks - self._drive.start[:2]
        scale = self.scale.sigma**2 * way[:, :, None] * way[:, None]
        return self.ekf.landmark_covariances + scale

    def moved(self, number: int, before: FloatArray, told: int) -> None:
        """Remember how the robot moved, for `foretell`, once all that the frame showed is in.

        Args:
            number: of the frame.
            before: (3,) pose of the last one.
            told: sightings that said so.
        """
        if number == 0 or not self._ranged:
            return
        step = steps_between(np.stack([before, self.ekf.pose]))[0]
        blind = self._drive.control_covariance[number - 1]
        self._foresight.saw(step, blind / (1 + told) ** 2, self._seconds(number))

    def meet(
        self,
        landmark: IntArray,
        seen: Sightings,
        again: npt.NDArray[np.bool_],
        number: int,
    ) -> None:
        """Take in sightings of landmarks of the map.

        A landmark that has been followed since it was taken in tells how the robot moved since,
        which its motion from frame to frame has told already, by the same pixels. Only one that
        had been out of sight tells something new.

        What sightings get wrong together would be taken for knowledge if each counted as
        another one: each of k has k times the variance of the common error, so that together
        they say of it what one does.

        Args:
            landmark: (k,) numbers.
            seen: k sightings.
            again: (k,) whether the landmark had been out of sight.
            number: of the frame.
        """
        rows = self.landmarks.rows(landmark)
        if len(rows) == 0:
            return
        R = self._covariance(seen, int(again.sum()))
        self.ekf.look(seen.z[again], R[again], rows[again])
        self.landmarks.met(rows, number)
        self.landmarks.height[rows] += (seen.height - self.landmarks.height[rows]) / (
            self.landmarks.seen[rows]
        )

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

    def surprise(
        self, seen: Sightings, expected: Expectation, again: npt.NDArray[np.bool_]
    ) -> tuple[FloatArray, FloatArray]:
        """What each of k sightings says beyond what is expected of its landmark.

        Returns:
            (k, 2), and its covariance (k, 2, 2); NaN for those not seen again, which correct
            nothing.
        """
        innovation = self.ekf.sensor.difference(seen.z, expected.z)
        S = expected.covariance + self._covariance(seen, 1)
        innovation[~again], S[~again] = np.nan, np.nan
        return innovation, S

    def innovations(self, rows: IntArray, seen: Sightings) -> tuple[FloatArray, FloatArray]:
        """What k sightings say of landmarks (k,) beyond what is expected.

        Returns:
            (k, 2), and their covariance (2k, 2k) with what they get wrong together.
        """
        z, S = expect_together(self.ekf, rows)
        share, degrees = self._config.common_sigma
        common = np.zeros((2, 2 * len(rows)))
        common[0, ::2], common[1, 1::2] = share * seen.z[:, 0], np.radians(degrees)
        return self.ekf.sensor.difference(seen.z, z), (
            S + common.T @ common + block_diag(*seen.covariance)
        )

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


def _speed(drive: Drive) -> float:
    """Metres per second of the whole drive by its odometry."""
    seconds = float(drive.time[-1] - drive.time[0])
    return float(np.hypot(*drive.control[:, :2].T).sum()) / seconds if seconds > 0 else 0.0
