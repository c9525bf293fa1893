"""In which errors the state is Gaussian, and how an observation looks in them.

The filter of the source measures errors along the axes of the map. Turning the
whole map, about which nothing can be observed, is not a straight line in those
coordinates: a filter that linearizes along the way believes to have learnt its
heading.

The right-invariant filter, after Barrau & Bonnabel (2015), "An EKF-SLAM algorithm with
consistency properties", measures errors in SE(2), from the right: with J a quarter turn,
xi = (e_p - J p e_theta, e_theta) for the robot and for each landmark. A common turn of
robot and map is straight, a correction moves every point by the exponential of xi, and an
observation is compared in the frame of the map, as the place where it puts the landmark
(C.15): in these errors it is linear.

First-estimates Jacobians, after Huang, Mourikis & Roumeliotis (2008), keep the errors of
the source but take every slope where a landmark, or the pose that moved, was believed to
be first, so that the slopes of different times agree on what cannot be observed.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from saccade.slam.filter import state
from saccade.slam.models import Sensor
from saccade.types import FloatArray


class Retraction(IntEnum):
    """How errors are measured."""

    STANDARD = state.STANDARD
    """Along the axes of the map: C.10-C.14 to the letter."""
    INVARIANT = state.INVARIANT
    """In SE(2), from the right."""
    FIRST_ESTIMATES = state.FIRST_ESTIMATES
    """Along the axes of the map, slopes at first estimates."""


STANDARD, INVARIANT, FIRST_ESTIMATES = Retraction


class Linearization(NamedTuple):
    """An observation as a linear one: innovation = H error + noise."""

    innovation: FloatArray
    """(2,) range and bearing; map coordinates for the invariant filter."""
    H: FloatArray
    """(2, r + 2) by the robot and the landmark."""
    noise: FloatArray
    """(2, 2) covariance."""


def linearize(
    retraction: int,
    sensor: Sensor,
    s: FloatArray,
    first: FloatArray,
    z: FloatArray,
    R: FloatArray,
) -> Linearization:
    """Compare an observation with what is expected of a landmark.

    Args:
        retraction: how errors are measured.
        sensor: the sensor model.
        s: (r + 2,) robot and landmark.
        first: (r + 2,) where they were first believed to be.
        z: (2,) observation.
        R: (2, 2) its covariance.
    """
    if retraction == STANDARD:
        expected, H = sensor.observe(s[:-2], s[-2:])
        return Linearization(sensor.difference(z, expected), H, R)  # C.14
    seen, Gp, Gz = sensor.inverse_observe(s[:-2], z)
    dx, dy = (first[-2:] - first[:2]).tolist()
    H = np.concatenate([-Gp, np.eye(2)], 1)
    H[:, :3] = [[-1.0, 0.0, dy], [0.0, -1.0, -dx]]
    return Linearization(seen - s[-2:], H, Gz @ R @ Gz.T)
