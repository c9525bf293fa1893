"""Error parametrizations (standard, first-estimates, right-invariant) and their Jacobians.

The source's filter has its errors along the axes of the map. A rotation of the whole map, which
is unobservable, is not linear in those coordinates: Jacobians at successive estimates make the
filter overconfident in its heading.

The right-invariant filter, after Barrau & Bonnabel (2015), "An EKF-SLAM algorithm with
consistency properties", has right-invariant errors of SE(2): with J a quarter turn,
xi = (e_p - J p e_theta, e_theta) for the robot and for each landmark. In them a rotation of
robot and map is linear, a correction moves every point by the exponential of xi, and the
innovation is taken in the frame of the map, at the position at which the observation puts the
landmark (C.15).

First-estimates Jacobians, after Huang, Mourikis & Roumeliotis (2008), keep the errors of the
source but evaluate every Jacobian at the first estimate of a landmark, or of the moved pose, so
that the Jacobians of different times have the same unobservable directions.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from saccade.slam.filter import _state_kernels
from saccade.slam.models import Sensor
from saccade.types import FloatArray


class Retraction(IntEnum):
    """Error parametrizations of the state."""

    STANDARD = _state_kernels.STANDARD
    """Along the axes of the map: C.10-C.14."""
    INVARIANT = _state_kernels.INVARIANT
    """Right-invariant errors of SE(2)."""
    FIRST_ESTIMATES = _state_kernels.FIRST_ESTIMATES
    """Along the axes of the map, Jacobians at first estimates."""


STANDARD, INVARIANT, FIRST_ESTIMATES = Retraction


class Linearization(NamedTuple):
    """A linearized observation: innovation = H error + noise."""

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
    """Linearize an observation of a landmark.

    Args:
        retraction: the error parametrization.
        sensor: the sensor model.
        s: (r + 2,) robot and landmark.
        first: (r + 2,) their first estimates.
        z: (2,) observation.
        R: (2, 2) its covariance.
    """
    if retraction == STANDARD:
        predicted, H = sensor.observe(s[:-2], s[-2:])
        return Linearization(sensor.difference(z, predicted), H, R)  # C.14
    xy, Gp, Gz = sensor.inverse_observe(s[:-2], z)
    dx, dy = (first[-2:] - first[:2]).tolist()
    H = np.concatenate([-Gp, np.eye(2)], 1)
    H[:, :3] = [[-1.0, 0.0, dy], [0.0, -1.0, -dx]]
    return Linearization(xy - s[-2:], H, Gz @ R @ Gz.T)
