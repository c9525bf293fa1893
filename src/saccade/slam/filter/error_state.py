"""Error parametrizations (standard and right-invariant) and their Jacobians.

The source's filter has its errors along the axes of the map. A rotation of the whole map, which
is unobservable, is not linear in those coordinates: Jacobians at successive estimates make the
filter overconfident in its heading.

The right-invariant filter, after Barrau & Bonnabel (2015), "An EKF-SLAM algorithm with
consistency properties", has right-invariant errors of SE(2): with J a quarter turn,
xi = (e_p - J p e_theta, e_theta) for the robot and for each landmark. In them a rotation of
robot and map is linear, a correction moves every point by the exponential of xi, and an
observation from the robot depends on the difference of two points' xi alone.

First-estimates Jacobians (Huang, Mourikis & Roumeliotis 2008) are not offered: on a held-back log
they diverged to 245 m. The Jacobians here are those of any sensor model, to first order; the
invariant filter takes range and bearing to second order, see `_range_bearing_kernels`.
"""

from enum import IntEnum

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


STANDARD, INVARIANT = Retraction


def linearize(
    sensor: Sensor, s: FloatArray, lever: FloatArray, z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Linearize an observation of a landmark: innovation = H eta + noise.

    Args:
        sensor: the sensor model.
        s: (r + 2,) robot and landmark.
        lever: (r + 2,) their heading levers, see `_kernels`; zero for the standard filter.
        z: (2,) observation.

    Returns:
        The innovation (2,), and H (2, r + 2) by the robot and the landmark.
    """
    predicted, H = sensor.observe(s[:-2], s[-2:])
    by_heading = H[:, 2] + H @ lever
    H = np.column_stack([H[:, :2], by_heading, H[:, 3:]])
    return sensor.difference(z, predicted), H  # C.14
