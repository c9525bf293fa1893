"""Re-identification of lost landmarks: by descriptor, joint covariance, and layout."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from saccade.keypoints.matching import match
from saccade.slam.consistency import chi_square_gate, normalized_squared
from saccade.slam.filter.robot_models import difference
from saccade.types import BoolArray, FloatArray, IntArray, Keypoints
from saccade.visual.camera import MIN_DEPTH, is_inside, to_pixels
from saccade.visual.config import VisualConfig
from saccade.visual.depth import measure_depth
from saccade.visual.optical_flow import ByteArray, PreparedFrame
from saccade.visual.points import RangeBearings, TrackedPoints
from saccade.visual.visual_map import VisualMap

HEIGHT_TOLERANCE = 0.15
"""Largest difference of the height between observation and map, which includes pitch, in meters
plus the same fraction of the range."""
POSITION_TOLERANCE = 0.05
"""Largest difference of the position, in meters plus the same fraction of the range."""
SAME_POINT = 1.0
"""Largest distance of two landmarks in meters that may be one point, mapped twice."""
REMATCH_RADIUS = 4.0
"""Pixels within which a tracked point is re-matched."""
BEARING_WEIGHT = 0.5
"""Weight of a landmark without a measured range, relative to one with a range."""
MIN_CONSISTENT = 4
"""Minimum number of landmarks that agree on one pose; all landmarks where there are fewer."""


class Reidentification(NamedTuple):
    """Lost landmarks among the detected points of a frame."""

    points: TrackedPoints
    """(m,) re-identified points, with depths where they can be measured."""
    rows: IntArray
    """(m,) rows of their landmarks."""
    missed: IntArray
    """Rows of landmarks that were expected in view, neither tracked nor found."""
    elsewhere: int
    """Landmarks outside of their gates that agree on another pose."""


def reidentify(
    points: TrackedPoints,
    visual_map: VisualMap,
    tracked: TrackedPoints,
    frame: PreparedFrame,
    config: VisualConfig,
) -> Reidentification:
    """Find lost landmarks among k points detected in a frame."""
    landmarks, in_view = visual_map.landmarks, _expected_in_view(visual_map, config)
    lost = np.setdiff1d(in_view, landmarks.rows(tracked.landmark))
    if len(lost) == 0 or len(points) == 0:
        none = np.zeros(0, np.int64)
        return Reidentification(points[none], none, none, 0)
    index, rows = _match_in_view(points, visual_map, in_view, config.ratio)
    was_lost = np.isin(rows, lost)  # others only make matches ambiguous
    found, rows = points[index[was_lost]], rows[was_lost]
    expected = visual_map.predict_jointly(rows)
    found = _with_depth(found, visual_map, expected.z, landmarks.height[rows], frame, config)
    observations = visual_map.observe(found, expected)[0]
    keep = np.flatnonzero(has_same_height(observations, landmarks.height[rows]))
    found, rows, observations = found[keep], rows[keep], observations[keep]
    weight = np.ones(len(rows))
    if visual_map.motion.measures_range:
        weight[np.isnan(found.depth)] = BEARING_WEIGHT
    joint = expected.z[keep], expected.covariance[keep][:, :, keep]
    agree = consistent_set(observations, *joint, weight, config.gate)
    elsewhere = 0
    if visual_map.motion.measures_range:  # otherwise ranges follow from the predicted pose
        known = np.isfinite(found.depth)
        layout = consistent_layout(observations.z[known], visual_map.ekf.landmarks[rows[known]])
        elsewhere = int((layout & ~agree[known]).sum())
    found, rows = found[agree], rows[agree]
    return Reidentification(found, rows, lost[~np.isin(lost, rows)], elsewhere)


def _with_depth(
    points: TrackedPoints,
    visual_map: VisualMap,
    expected: FloatArray,
    height: FloatArray,
    frame: PreparedFrame,
    config: VisualConfig,
) -> TrackedPoints:
    """Points (k,) with depths by disparities, which are tracked from the expected ones.

    Their landmarks are expected at ranges and bearings (k, 2), and have heights (k,).
    """
    unknown = np.flatnonzero(np.isnan(points.depth))
    if len(unknown) == 0 or frame.right is None:
        return points
    r, bearing = expected[unknown].T
    xyz = np.stack([r * np.cos(bearing), r * np.sin(bearing), height[unknown]], 1)
    camera = visual_map.camera
    _, depth = to_pixels(camera, xyz)
    measured = measure_depth(
        camera, frame, points.xy[unknown], config, np.maximum(depth, MIN_DEPTH)
    )
    points = replace(points, depth=points.depth.copy(), depth_sigma=points.depth_sigma.copy())
    points.depth[unknown], points.depth_sigma[unknown] = measured
    return points


def _expected_in_view(visual_map: VisualMap, config: VisualConfig) -> IntArray:
    """(m,) rows of landmarks within 3 sigma of the field of view, ascending."""
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
    inside &= ~landmarks.is_tag
    return np.flatnonzero(inside)


def _match_in_view(
    points: TrackedPoints, visual_map: VisualMap, in_view: IntArray, ratio: float
) -> tuple[IntArray, IntArray]:
    """Indices of points and rows of the landmarks in view (m,) that they match by descriptor.

    Mutual nearest neighbors that pass the ratio test against all landmarks at other positions, in
    view or not: a point may be mapped several times, a poster may hang in two places.
    """
    landmarks, xy = visual_map.landmarks, visual_map.ekf.landmarks
    a, b = (each.astype(np.float32) for each in (points.descriptor, landmarks.descriptor))
    squared = np.square(a).sum(1)[:, None] + np.square(b).sum(1) - 2 * a @ b.T
    candidates = squared[:, in_view]
    nearest = candidates.argmin(1)
    mutual = candidates.argmin(0)[nearest] == np.arange(len(a))
    index, rows = np.flatnonzero(mutual), in_view[nearest[mutual]]
    offset = xy - xy[rows][:, None]
    apart = np.hypot(offset[..., 0], offset[..., 1]) > SAME_POINT
    rival = np.where(apart, squared[index], np.inf).min(1)
    unique = squared[index, rows] < ratio**2 * rival
    return index[unique], rows[unique]


def descriptor_matches(points: Keypoints, descriptors: ByteArray, ratio: float) -> IntArray:
    """(m, 2) points and landmarks whose descriptors pass ratio test and mutual check."""
    landmarks = Keypoints.at(np.zeros((len(descriptors), 2)), 1.0)
    return match(points, replace(landmarks, descriptors=descriptors), ratio=ratio)


def has_same_height(observations: RangeBearings, height: FloatArray) -> BoolArray:
    """(m,) whether observations agree with heights (m,) in meters."""
    tolerance = HEIGHT_TOLERANCE * observations.z[:, 0] + HEIGHT_TOLERANCE
    return np.asarray(np.abs(observations.height - height) < tolerance)


def consistent_set(
    observations: RangeBearings,
    expected: FloatArray,
    covariance: FloatArray,
    weight: FloatArray,
    gate: float,
) -> BoolArray:
    """(m,) which observations agree with the map and with each other: one-point consensus.

    Shared errors, mainly the error of the pose, are in the joint covariance (m, 2, m, 2) of the
    expected observations (m, 2). All innovations are conditioned on each observation in its gate:
    the observations that are then inside their gates agree with it. The set of the largest weight
    (m,) is taken, without its members outside their gates given all other members. Sets of fewer
    than three cannot be verified and are rejected.

    Source: one-point RANSAC (Civera, Grasa, Davison & Montiel 2010), of every point.
    """
    m, threshold = len(observations), chi_square_gate(2, gate)
    v, S = difference(observations.z, expected), covariance.copy()
    S[np.arange(m), :, np.arange(m)] += observations.covariance
    own = S[np.arange(m), :, np.arange(m)]  # (m, 2, 2)
    seeds = np.flatnonzero(normalized_squared(v, own) < threshold)
    if m < 3 or len(seeds) == 0:
        return np.zeros(m, np.bool_)
    cross = S[:, :, seeds].transpose(2, 0, 1, 3)  # (s, m, 2, 2)
    gain = cross @ np.linalg.inv(own[seeds])[:, None]
    rest = v - (gain @ v[seeds][:, None, :, None])[..., 0]  # (s, m, 2)
    remaining = own - gain @ cross.swapaxes(2, 3)  # (s, m, 2, 2)
    remaining[np.arange(len(seeds)), seeds] = own[seeds]
    agree = normalized_squared(rest, remaining) < threshold
    best = agree[np.argmax(agree @ weight)]
    best[best] = _given_others(v[best], S[best][:, :, best]) < threshold
    enough = best.sum() >= 3 and best @ weight >= min(MIN_CONSISTENT, weight.sum())
    return best if enough else np.zeros(m, np.bool_)


def _given_others(v: FloatArray, S: FloatArray) -> FloatArray:
    """(m,) normalized squares of innovations (m, 2) of covariance (m, 2, m, 2), given all others.

    With the information matrix A = S^-1 the innovation given the others is A_ii^-1 (A v)_i, and
    its covariance A_ii^-1.
    """
    m = len(v)
    A = np.asarray(np.linalg.inv(S.reshape(2 * m, 2 * m)), np.float64)
    own = A.reshape(m, 2, m, 2)[np.arange(m), :, np.arange(m)]
    return normalized_squared(np.asarray(A @ v.ravel()).reshape(m, 2), own)


def consistent_layout(
    z: FloatArray, positions: FloatArray, tolerance: float = POSITION_TOLERANCE
) -> BoolArray:
    """(m,) geometric verification: which landmarks agree on one pose of the robot.

    Two observations z (m, 2) and their landmarks' positions (m, 2) determine a pose; the pose with
    most inliers is taken (exhaustive RANSAC). Fewer than three cannot be verified, so none passes.
    The tolerance is in meters plus the same fraction of the range.
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
