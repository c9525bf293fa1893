"""In which coordinates the error of the state is Gaussian, and how a correction is applied.

The filter of the source measures errors along the axes of the map. Turning the
whole map, about which nothing can be observed, is not a straight line in those
coordinates: a filter that linearizes along the way believes to have learnt its
heading. The right-invariant filter measures errors in the Lie group of the plane, where it is
one. Its covariance is kept in the coordinates of the map all the same.
"""

from math import cos, sin
from typing import NamedTuple, Protocol

import numpy as np

from saccade.slam.models import Sensor
from saccade.types import FloatArray

QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


class Linearization(NamedTuple):
    """An observation as a linear one: innovation = H error + noise."""

    innovation: FloatArray
    """(2,)."""
    H: FloatArray
    """(2, 5) by the pose and the landmark."""
    noise: FloatArray
    """(2, 2) covariance."""


class Retraction(Protocol):
    """How errors are measured; stands between the sensor and the update."""

    def linearize(
        self, sensor: Sensor, pose: FloatArray, landmark: FloatArray, z: FloatArray, R: FloatArray
    ) -> Linearization:
        """Compare an observation with what is expected of a landmark (2,) from a pose (3,)."""

    def apply(self, s: FloatArray, correction: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Correct a state (n,).

        Returns:
            The new state (n,), its heading not wrapped, and the transport of the covariance:
            P becomes (I + D e^T) P (I + e D^T), with D (n,) and e the unit vector of the
            heading; None where P stays.
        """


class Standard:
    """Errors along the axes of the map: C.10-C.14 to the letter."""

    def linearize(
        self, sensor: Sensor, pose: FloatArray, landmark: FloatArray, z: FloatArray, R: FloatArray
    ) -> Linearization:
        """Observed less expected, in range and bearing (C.14)."""
        expected, H = sensor.observe(pose, landmark)
        return Linearization(sensor.difference(z, expected), H, R)

    def apply(self, s: FloatArray, correction: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Add it (C.10)."""
        return s + correction, None


class Invariant:
    """Errors in SE(2), from the right: a turn swings all points about the map's origin.

    After Barrau & Bonnabel (2015), "An EKF-SLAM algorithm with consistency
    properties". With J a quarter turn, the errors are xi = (e_p - J p e_theta,
    e_theta) for the robot and for each landmark; a common turn of robot and map is straight.
    An observation is compared in the frame of the map, as the place where it puts
    the landmark (C.15): in these errors it is linear.
    """

    def linearize(
        self, sensor: Sensor, pose: FloatArray, landmark: FloatArray, z: FloatArray, R: FloatArray
    ) -> Linearization:
        """Where the observation puts the landmark, less where it is believed to be."""
        seen, _, Gz = sensor.place(pose, z)
        dx, dy = (landmark - pose[:2]).tolist()
        H = np.array([[-1.0, 0.0, dy, 1.0, 0.0], [0.0, -1.0, -dx, 0.0, 1.0]])  # xi_m - xi_p
        return Linearization(seen - landmark, H, Gz @ R @ Gz.T)

    def apply(self, s: FloatArray, correction: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Move every point by the exponential of xi, and carry the covariance along."""
        turn = float(correction[2])
        c, k = cos(turn), sin(turn)
        a = float(np.sinc(turn / np.pi))  # sin(turn) / turn
        b = float(np.sinc(turn / (2 * np.pi))) * sin(turn / 2)  # (1 - cos(turn)) / turn
        points = np.concatenate([s[:2], s[3:]]).reshape(-1, 2)  # (1 + N, 2)
        step = np.concatenate([correction[:2], correction[3:]]).reshape(-1, 2)
        xi = step - turn * points @ QUARTER_TURN.T
        moved = points @ np.array([[c, k], [-k, c]]) + xi @ np.array([[a, b], [-b, a]])
        swing = (moved - points) @ QUARTER_TURN.T
        corrected, D = np.empty(len(s)), np.zeros(len(s))
        corrected[:2], corrected[2], corrected[3:] = moved[0], s[2] + turn, moved[1:].ravel()
        D[:2], D[3:] = swing[0], swing[1:].ravel()
        return corrected, D


STANDARD = Standard()
INVARIANT = Invariant()
