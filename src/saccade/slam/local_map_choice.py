"""Decides in which local map of a large map the next step is taken."""

from math import hypot, isfinite, sqrt
from typing import Literal

import numpy as np

from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.models import control_bias
from saccade.slam.scans import Scan
from saccade.types import FloatArray, IntArray

LARGE = 1000
"""Landmarks in a map from which "auto" uses local maps."""
MAX_FRACTION = 0.25
"""Of the map; with "auto", a larger local map is not entered."""
MARGIN = 1.0
"""Distance that a robot goes in a local map, as a fraction of the range that its scans need."""


class LocalMapChoice:
    """Decides in which local map of a large map the next step is taken.

    Args:
        submaps: whether local maps are used "always", "never", or in large maps ("auto").
        gate: squared Mahalanobis distance within which an observation may be of a landmark.
    """

    def __init__(self, submaps: Literal["auto", "always", "never"], gate: float) -> None:
        self._enabled, self._always = submaps != "never", submaps == "always"
        self._gate = sqrt(gate) if isfinite(gate) else 0.0
        self._radius = -1.0
        self._in_whole = False
        self._way = self._needed = 0.0
        self._position = self._heading = self._position_bias = self._heading_bias = 0.0
        self._bias = self._bias_sigma = np.zeros(0)

    def choose_view(self, ekf: EkfSlam, scan: Scan, named: IntArray, reach: float) -> None:
        """Choose the part of the map in which a step works, and make room for the step.

        Args:
            ekf: the filter, before the motion.
            scan: the step.
            named: (k,) landmarks that the scan names, -1 for none.
            reach: metres within which landmarks are expected in view, whatever is observed.
        """
        ekf.inflate_heading_covariance()
        if self._enabled:
            self._choose(ekf, scan.control, scan.z, scan.R, named, reach)
        ekf.reserve(len(scan.z))

    def _choose(
        self,
        ekf: EkfSlam,
        control: tuple[FloatArray, FloatArray] | None,
        z: FloatArray,
        R: FloatArray,
        named: IntArray,
        reach: float,
    ) -> None:
        """Enter a local map for a step, or leave it; most often the one of the last step serves."""
        if not self._always and len(ekf) + (ekf.local_map is None) * len(z) < LARGE:
            self._radius = -1.0
            ekf.leave()
            return
        if len(z) > 0:
            reach = max(reach, float((z[:, 0] + self._gate * np.sqrt(R[:, 0, 0])).max()))
        left = ekf.local_map is None and not self._in_whole
        if self._radius < 0 or left:
            self._enter(ekf, control, named, reach)
            return
        self._add_motion(control, ekf.view.robot_size)
        outside = ekf.local_map is not None and bool((ekf.to_view(named[named >= 0]) < 0).any())
        if outside or self._way_needed() + reach > self._radius:
            self._enter(ekf, control, named, reach)
        self._needed = max(self._needed, reach)

    def _enter(
        self,
        ekf: EkfSlam,
        control: tuple[FloatArray, FloatArray] | None,
        named: IntArray,
        needed: float,
    ) -> None:
        """Enter the local map of the robot for the next step and some that may follow."""
        f, r = ekf.view, ekf.view.robot_size
        self._bias = f.state[3:r].copy()
        self._bias_sigma = np.sqrt(np.abs(f.P[range(3, r), range(3, r)]))
        self._way = 0.0
        self._position = self._heading = self._position_bias = self._heading_bias = 0.0
        self._add_motion(control, r)
        self._radius = max(needed, self._needed) * (1 + MARGIN) + self._way_needed()
        self._needed = needed
        predicted, S = ekf.predict_observations()
        q = predicted[:, 0]
        sigma = np.sqrt(np.abs(S[:, 0, 0]) + q * q * np.abs(S[:, 1, 1]))
        near = q - 2 * self._gate * sigma <= self._radius
        near[named[(named >= 0) & (named < len(near))]] = True
        self._in_whole = not self._always and near.mean() > MAX_FRACTION
        if not self._in_whole:
            ekf.enter(np.flatnonzero(near))

    def _add_motion(self, control: tuple[FloatArray, FloatArray] | None, robot_size: int) -> None:
        """Add a step to the way since the local map was entered, with its uncertainty."""
        if control is None:
            return
        u, U = control
        c = len(u) - 1  # the heading's
        if robot_size > 3:
            D = control_bias(u, robot_size)
            u, bias = u + D @ self._bias, np.abs(D) @ self._bias_sigma
            self._position_bias += float(np.hypot.reduce(bias[:c]))
            self._heading_bias += float(bias[c])
        length = hypot(u[0], u[1]) if c == 2 else abs(float(u[0]))
        heading = float(U[c, c])
        self._way += length
        self._position += float(U[0, 0] + (U[1, 1] if c == 2 else 0.0)) + length**2 * heading
        self._heading += heading

    def _way_needed(self) -> float:
        """Metres that the robot may have gone, by a bound of its standard deviation."""
        heading = sqrt(self._heading) + self._heading_bias
        sigma = sqrt(self._position) + self._position_bias + self._way * heading
        return self._way + self._gate * sigma
