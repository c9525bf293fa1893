"""The choice of the submap in which the next step is taken.

A submap contains every landmark that may be observed while the robot moves a certain distance:
all landmarks within a radius of its position, widened by twice their gate. The filter leaves it
when the range of a scan plus the distance since the entry, with the gate of its odometry, exceeds
the radius, or when the label of a landmark outside is observed.
"""

from math import hypot, isfinite, sqrt
from typing import Literal

import numpy as np

from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.landmarks import LandmarkTable
from saccade.slam.scans import Scan
from saccade.types import IntArray

LARGE_MAP = 350
"""Minimum number of landmarks for "auto" to use submaps."""
MAX_FRACTION = 0.25
"""Largest submap that "auto" enters, as a fraction of the map."""
SUBMAP_MARGINS = (1.5, 2.5)
"""Least and largest distance that a robot can move in a submap, in ranges of its scans."""
MARGIN_LANDMARKS = 2000
"""Landmarks for each range of this distance: leaving a submap costs more in a larger map."""
MAX_BIAS = 0.1
"""Largest relative error of the distances that the odometry reports."""


class SubmapChoice:
    """Chooses the submap in which the next step is taken.

    Args:
        submaps: whether submaps are used "always", "never", or in large maps ("auto").
        gate: squared Mahalanobis distance within which an observation may be of a landmark.
    """

    def __init__(self, submaps: Literal["auto", "always", "never"], gate: float) -> None:
        self._enabled, self._always = submaps != "never", submaps == "always"
        self._gate = sqrt(gate) if isfinite(gate) else 0.0
        self._radius = -1.0
        self._in_whole = False
        self._needed = 0.0
        self._length = self._variance = 0.0  # meters since the entry, square meters of noise

    def update(self, ekf: EkfSlam, table: LandmarkTable, scan: Scan, max_range: float) -> None:
        """Enters or leaves a submap for a step, if the present one does not suffice.

        Args:
            ekf: the filter, before the motion.
            table: its landmarks.
            scan: the step.
            max_range: meters within which landmarks are expected.
        """
        if not self._enabled:
            return
        z, R = scan.complete.z, scan.complete.R
        if not self._always and len(ekf) + (ekf.submap is None) * len(z) < LARGE_MAP:
            self._radius = -1.0
            ekf.leave()
            return
        labeled = table.landmarks_of(scan.labels)
        labeled = labeled[labeled >= 0]
        if len(z) > 0:
            max_range = max(max_range, float((z[:, 0] + self._gate * np.sqrt(R[:, 0, 0])).max()))
        if self._radius < 0 or (ekf.submap is None and not self._in_whole):
            self._enter(ekf, scan, labeled, max_range)
            return
        self._advance(scan)
        outside = ekf.submap is not None and bool((ekf.rows(labeled) < 0).any())
        if outside or self._reach + max_range > self._radius:
            self._enter(ekf, scan, labeled, max_range)
        else:
            ekf.flush_early()
        self._needed = max(self._needed, max_range)

    def _enter(self, ekf: EkfSlam, scan: Scan, labeled: IntArray, needed: float) -> None:
        """Enters the submap around the robot for this step and later ones."""
        ekf.leave()
        self._length = self._variance = 0.0
        self._advance(scan)
        low, high = SUBMAP_MARGINS
        margin = min(max(len(ekf) / MARGIN_LANDMARKS, low), high)
        self._radius = max(needed, self._needed) * (1 + margin) + self._reach
        self._needed = needed
        predicted, S = ekf.predict_observations()
        q = predicted[:, 0]
        sigma = np.sqrt(np.abs(S[:, 0, 0]) + q * q * np.abs(S[:, 1, 1]))
        near = q - 2 * self._gate * sigma <= self._radius
        near[ekf.rows(labeled)] = True
        many = np.count_nonzero(near) > MAX_FRACTION * len(near)
        self._in_whole = bool(many) and not self._always
        if not self._in_whole:
            ekf.enter(np.flatnonzero(near))

    def _advance(self, scan: Scan) -> None:
        """Adds the motion of a scan to the path since the entry."""
        if scan.control is not None:
            u, U, _ = scan.control
            self._length += hypot(*u[:-1])
            self._variance += float(U[:-1, :-1].trace())

    @property
    def _reach(self) -> float:
        """Largest distance that the robot may have moved since the entry, in meters."""
        return (1 + MAX_BIAS) * self._length + self._gate * sqrt(self._variance)
