"""Re-identification of lost landmarks: by descriptor, validation gate, and layout."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from saccade.keypoints.matching import match
from saccade.slam.consistency import chi_square_gate, normalized_squared
from saccade.slam.filter.models import PredictedObservations
from saccade.slam.models import wrap
from saccade.types import BoolArray, FloatArray, IntArray, Keypoints
from saccade.visual.camera import is_inside, to_pixels
from saccade.visual.config import VisualConfig
from saccade.visual.optical_flow import ByteArray
from saccade.visual.tables import RangeBearings, TrackedPoints
from saccade.visual.visual_map import VisualMap

HEIGHT_TOLERANCE = 0.15
"""Largest difference of the height between observation and map, which includes pitch, in meters
plus the same fraction of the range."""
POSITION_TOLERANCE = 0.05
"""Largest difference of the position, in meters plus the same fraction of the range."""
BEARING_TOLERANCE = 0.02
"""Largest difference of a position by its bearing alone, in the same unit."""
REMATCH_RADIUS = 4.0
"""Pixels within which a tracked point is re-matched."""
MIN_CONSISTENT = 4
"""Landmarks that must agree on one pose; all where there are fewer."""


class Reidentification(NamedTuple):
    """Lost landmarks among the detected points of a frame."""

    points: IntArray
    """(m,) indices of the points."""
    rows: IntArray
    """(m,) rows of their landmarks."""
    missed: IntArray
    """Rows of landmarks that were expected in view, neither tracked nor found."""
    elsewhere: int
    """Landmarks outside of their gates that agree on another pose."""


def reidentify(
    points: TrackedPoints, visual_map: VisualMap, tracked: TrackedPoints, config: VisualConfig
) -> Reidentification:
    """Find lost landmarks among k detected points."""
    landmarks, lost = visual_map.landmarks, _expected_in_view(visual_map, tracked, config)
    if len(lost) == 0 or len(points) == 0:
        none = np.zeros(0, np.int64)
        return Reidentification(none, none, none, 0)
    pairs = descriptor_matches(points.keypoints, landmarks.descriptor[lost], config.ratio)
    index, rows = pairs[:, 0], lost[pairs[:, 1]]
    expected = visual_map.predict_observations(rows)
    observations, usable = visual_map.observe(points[index], expected)
    same_height = usable & has_same_height(observations, landmarks.height[rows])
    keep = same_height & within_gate(observations, expected, config.gate)
    tolerance, elsewhere = BEARING_TOLERANCE, 0
    if visual_map.motion.measures_range:  # without, the ranges are those of the believed pose
        tolerance = POSITION_TOLERANCE
        layout = visual_map.ekf.landmarks[rows[same_height]]
        agree = consistent_layout(observations.z[same_height], layout, tolerance)
        elsewhere = int((agree & ~keep[same_height]).sum())
    index, rows = index[keep], rows[keep]
    keep = consistent_layout(observations.z[keep], visual_map.ekf.landmarks[rows], tolerance)
    index, rows = index[keep], rows[keep]
    return Reidentification(index, rows, lost[~np.isin(lost, rows)], elsewhere)


def _expected_in_view(
    visual_map: VisualMap, tracked: TrackedPoints, config: VisualConfig
) -> IntArray:
    """(m,) rows of landmarks that are not tracked and within 3 sigma of the field of view."""
    landmarks, camera = visual_map.landmarks, visual_map.camera
    if len(landmarks) == 0:
        return np.zeros(0, np.int64)
    z, S = visual_map.ekf.predict_observations()
    r, bearing = z[:, 0], z[:, 1]
    xyz = np.stack([r * np.cos(bearing), r * np.sin(bearing), landmarks.height], 1)
    xy, _ = to_pixels(camera, xyz)
    slack = 3 * np.sqrt(S[:, 1, 1])
    border = -camera.fx * np.tan(slack.clip(0, 1.5))
    inside = is_inside(camera, xy, np.maximum(border, -camera.width))
    inside &= r < config.range_limits[1] + 3 * np.sqrt(S[:, 0, 0])
    rows = landmarks.rows(tracked.landmark)
    inside[rows[rows >= 0]] = False
    return np.flatnonzero(inside)


def descriptor_matches(points: Keypoints, descriptors: ByteArray, ratio: float) -> IntArray:
    """(m, 2) points and landmarks whose descriptors pass ratio test and mutual check."""
    landmarks = Keypoints.at(np.zeros((len(descriptors), 2)), 1.0)
    return match(points, replace(landmarks, descriptors=descriptors), ratio=ratio)


def has_same_height(observations: RangeBearings, height: FloatArray) -> BoolArray:
    """(m,) whether observations agree with heights (m,) in meters."""
    tolerance = HEIGHT_TOLERANCE * observations.z[:, 0] + HEIGHT_TOLERANCE
    return np.asarray(np.abs(observations.height - height) < tolerance)


def within_gate(
    observations: RangeBearings, expected: PredictedObservations, gate: float
) -> BoolArray:
    """(m,) whether observations pass the gate: correct ones do with that probability."""
    v = observations.z - expected.z
    v[:, 1] = wrap(v[:, 1])
    d = normalized_squared(v, expected.covariance + observations.covariance)
    return np.asarray(d < chi_square_gate(2, gate))


def consistent_layout(
    z: FloatArray, positions: FloatArray, tolerance: float = POSITION_TOLERANCE
) -> BoolArray:
    """(m,) geometric verification: which landmarks agree on one pose of the robot.

    Two observations z (m, 2) and their landmarks' positions (m, 2) determine a pose; that of most
    inliers is taken (exhaustive RANSAC). Fewer than three cannot be verified, so none passes. The
    tolerance is in meters plus the same fraction of the range.
    """
    m = len(z)
    if m < 3:
        return np.zeros(m, np.bool_)
    observed = z[:, 0] * np.exp(1j * z[:, 1])  # in the robot's frame
    mapped = positions[:, 0] + 1j * positions[:, 1]
    i, j = np.triu_indices(m, 1)
    rotation = (mapped[j] - mapped[i]) * np.conj(observed[j] - observed[i])
    rotation /= np.maximum(np.abs(rotation), 1e-12)
    center, mapped_center = (observed[i] + observed[j]) / 2, (mapped[i] + mapped[j]) / 2
    error = np.abs(
        mapped_center[:, None] + rotation[:, None] * (observed - center[:, None]) - mapped
    )  # (pairs, m)
    inliers = error < tolerance * z[:, 0] + tolerance
    best = inliers[np.argmax(inliers.sum(1))]
    return best if best.sum() >= min(MIN_CONSISTENT, m) else np.zeros(m, np.bool_)


def count_rematches(tracked: TrackedPoints, detected: TrackedPoints, ratio: float) -> TrackedPoints:
    """Re-match tracked points by descriptor alone to those detected in the same frame.

    A point that is not re-matched while it is tracked will not be re-identified later.
    """
    pairs = descriptor_matches(detected.keypoints, tracked.descriptor, ratio)
    distance = np.hypot(*(detected.xy[pairs[:, 0]] - tracked.xy[pairs[:, 1]]).T)
    rematches = tracked.rematches.copy()
    rematches[pairs[distance < REMATCH_RADIUS, 1]] += 1
    attempts = tracked.rematch_attempts + 1
    return replace(tracked, rematch_attempts=attempts, rematches=rematches)
