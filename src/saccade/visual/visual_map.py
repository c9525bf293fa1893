"""The map of a drive: the filter, and what is known of its landmarks."""

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from saccade.frames import Drive, steps_between
from saccade.slam.association.jcbb import predict_jointly
from saccade.slam.checkpoint import Arrays, attribute_arrays, merge, restore_attributes, select
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.error_state import INVARIANT
from saccade.slam.models import compose
from saccade.slam.results import PredictedObservations
from saccade.types import FloatArray, IntArray
from saccade.visual.camera import RangeBearings
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Motion, Prior
from saccade.visual.ground_scale import WHITE_NOISE, GroundMotion, OdometryScale
from saccade.visual.landmarks import Landmarks
from saccade.visual.motion_prior import (
    MotionPrior,
    TurnRateBias,
    correlated_covariance,
    fuse,
    systematic_covariance,
)
from saccade.visual.planarity import Planarity

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

    def __init__(self, drive: Drive, config: VisualConfig, has_depth: bool) -> None:
        scale_bias, *others = drive.odometry_bias
        self.scale = OdometryScale(
            scale_bias, config.relative_motion_sigma[0] if has_depth else config.height_sigma
        )
        self._map_scale = self.scale.factor
        self._has_depth = has_depth
        bias = (0.0, *others) if any(others) and not has_depth else ()
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
        self.planarity = Planarity(float(np.radians(config.tilt_sigma)))
        self._turn_bias = TurnRateBias(
            variance=STILL**2 + (drive.odometry_bias[1] * _speed(drive)) ** 2
        )
        self._odometry: Prior = np.zeros(3), np.zeros((3, 3))
        self._motion_prior = MotionPrior(np.array([ahead, ahead / 4, turn]))

    def predict_motion(self, number: int) -> Prior:
        """The control that is expected to lead to a frame after the first.

        A single camera takes the length of a step from it. With the last steps in it their errors
        would count anew in each, and where the robot speeds up for seconds it would lag behind.
        """
        drive, factor = self._drive, self.scale.factor
        seconds = self._seconds(number)
        control = drive.control[number - 1] * (factor, factor, 1.0)
        control = self._turn_bias.corrected(control, seconds)
        self._odometry = control, drive.control_covariance[number - 1]
        if not self._has_depth:
            return self._odometry
        return self._motion_prior.predict(*self._odometry, seconds)

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
        systematic = systematic_covariance(
            expected[0], seconds, self.scale.sigma if self._has_depth else 0.0, self._turn_bias
        )
        taken = expected[0], expected[1] + systematic
        if motion is not None:
            self.planarity.update(motion.tilt, seconds)
            taken = (
                motion.control,
                correlated_covariance(motion, seconds, self._config, self.planarity.tilt),
            )
            turned = float(self._drive.control[number - 1, 2] - motion.control[2])
            noise = self._drive.control_covariance[number - 1, 2, 2] + taken[1][2, 2]
            self._turn_bias.update(turned, seconds, float(noise))
            if not motion.with_prior:
                self._update_scale(self._odometry[0], motion)
                taken = fuse(taken, (self._odometry[0], self._odometry[1] + systematic))
        self.ekf.predict(*taken)

    def apply_ground_motion(self, motion: Motion, ground: GroundMotion) -> Motion:
        """Learn from the road how long odometry's metre is, and this step.

        What was mapped with another metre is made larger or smaller as a whole.

        Args:
            motion: the step by odometry and by what one camera saw.
            ground: the same by the road.

        Returns:
            The step by both.
        """
        before = self.scale.factor
        ratio = ground.distance / float(np.linalg.norm(motion.translation))
        self.scale.update(ratio)
        grown = self.scale.factor / before
        self._apply_scale()
        length = float(np.hypot(*motion.control[:2]))
        along = np.append(motion.control[:2] / length, 0.0)
        spread = motion.covariance @ along
        total = float(along @ spread) + (WHITE_NOISE * length) ** 2
        missed = (ratio / self.scale.ground_factor - grown) * length
        control = motion.control + spread * missed / total
        covariance = motion.covariance - np.outer(spread, spread) / total
        longer = float(np.hypot(*control[:2])) / length
        return motion._replace(
            control=control,
            translation=motion.translation * longer,
            covariance=(covariance + covariance.T) / 2,
        )

    def _apply_scale(self) -> None:
        """Redraw the map once its metre is off by `STRETCH`: that takes as long as a frame."""
        stretch = self.scale.factor / self._map_scale
        if abs(stretch - 1) > STRETCH:
            self.ekf.rescale(stretch, self._drive.start[:2])
            self._map_scale = self.scale.factor

    def _update_scale(self, expected: FloatArray, motion: Motion) -> None:
        """Learn how long odometry's metre is from a camera that measures depth."""
        way, seen = (float(np.hypot(*each[:2])) for each in (expected, motion.control))
        if way > SHORTEST:
            self.scale.update(seen / way)

    def _seconds(self, number: int) -> float:
        return float(self._drive.time[number] - self._drive.time[number - 1])

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3), with what is not known of the scale: all that was driven may be longer."""
        if self._has_depth:
            return self.ekf.pose_covariance
        way = np.append(self.ekf.pose[:2] - self._drive.start[:2], 0.0)
        return self.ekf.pose_covariance + self.scale.sigma**2 * np.outer(way, way)

    @property
    def landmark_covariances(self) -> FloatArray:
        """(n, 2, 2), with what is not known of the scale."""
        if self._has_depth:
            return self.ekf.landmark_covariances
        way = self.ekf.landmarks - self._drive.start[:2]
        scale = self.scale.sigma**2 * way[:, :, None] * way[:, None]
        return self.ekf.landmark_covariances + scale

    def update_motion_prior(self, number: int, before: FloatArray, observations: int) -> None:
        """Remember how the robot moved, for `foretell`, once all that the frame showed is in.

        Args:
            number: of the frame.
            before: (3,) pose of the last one.
            observations: sightings that said so.
        """
        if number == 0 or not self._has_depth:
            return
        step = steps_between(np.stack([before, self.ekf.pose]))[0]
        blind = self._drive.control_covariance[number - 1]
        self._motion_prior.update(step, blind / (1 + observations) ** 2, self._seconds(number))

    def observe(
        self,
        landmark: IntArray,
        seen: RangeBearings,
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
        self.ekf.update_scan(seen.z[again], R[again], rows[again])
        self.landmarks.count_observed(rows, number)
        self.landmarks.height[rows] += (seen.height - self.landmarks.height[rows]) / (
            self.landmarks.observations[rows]
        )

    def initialize(
        self, seen: RangeBearings, descriptors: npt.NDArray[np.uint8], number: int
    ) -> IntArray:
        """Make landmarks of k sightings; returns their numbers (k,)."""
        first = len(self.ekf)
        R = self._covariance(seen, 1)
        self.ekf.update_scan(seen.z, R, np.arange(first, first + len(R)))
        return self.landmarks.add(seen.height, descriptors, number)

    def predict_observations(self, rows: IntArray) -> PredictedObservations:
        """What should be seen of landmarks (k,)."""
        every = self.ekf.predict_observations()
        return PredictedObservations(every.z[rows], every.covariance[rows])

    def innovation(
        self, seen: RangeBearings, expected: PredictedObservations, again: npt.NDArray[np.bool_]
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

    def joint_innovation(
        self, rows: IntArray, seen: RangeBearings
    ) -> tuple[FloatArray, FloatArray]:
        """What k sightings say of landmarks (k,) beyond what is expected.

        Returns:
            (k, 2), and their covariance (2k, 2k) with what they get wrong together.
        """
        z, S = predict_jointly(self.ekf, rows)
        fraction, degrees = self._config.shared_error_sigma
        common = np.zeros((2, 2 * len(rows)))
        common[0, ::2], common[1, 1::2] = fraction * seen.z[:, 0], np.radians(degrees)
        return self.ekf.sensor.difference(seen.z, z), (
            S + common.T @ common + block_diag(*seen.covariance)
        )

    def enforce_budget(self, followed: IntArray, number: int) -> None:
        """Give up what is too much for the budget."""
        surplus = len(self.landmarks) - self._config.max_landmarks
        if surplus > 0:
            gone = self.landmarks.least_useful(surplus, followed, number)
            self.remove(gone)

    def remove(self, rows: IntArray) -> None:
        """Take landmarks out of the map."""
        kept = np.ones(len(self.landmarks), np.bool_)
        kept[rows] = False
        self.ekf.remove(rows)
        self.landmarks.keep(kept)

    def _parts(self) -> dict[str, object]:
        return {
            "landmarks": self.landmarks,
            "scale": self.scale,
            "planarity": self.planarity,
            "turn_bias": self._turn_bias,
            "motion_prior": self._motion_prior,
        }

    def to_arrays(self) -> Arrays:
        """Its state as named arrays, for a checkpoint."""
        parts = {name: attribute_arrays(part) for name, part in self._parts().items()}
        return {
            **merge({"ekf": self.ekf.to_arrays(), **parts}),
            "map_scale": np.array(self._map_scale),
        }

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        self.ekf.from_arrays(select(arrays, "ekf"))
        for name, part in self._parts().items():
            restore_attributes(part, select(arrays, name))
        self._map_scale = float(arrays["map_scale"])

    def _covariance(self, seen: RangeBearings, together: int) -> FloatArray:
        fraction, degrees = self._config.shared_error_sigma
        common = np.zeros_like(seen.covariance)
        common[:, 0, 0] = together * np.square(fraction * seen.z[:, 0])
        common[:, 1, 1] = together * np.radians(degrees) ** 2
        return seen.covariance + common


def _speed(drive: Drive) -> float:
    """Metres per second of the whole drive by its odometry."""
    seconds = float(drive.time[-1] - drive.time[0])
    return float(np.hypot(*drive.control[:, :2].T).sum()) / seconds if seconds > 0 else 0.0
