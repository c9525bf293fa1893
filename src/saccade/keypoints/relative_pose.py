"""Relative pose of two calibrated views, and triangulation of their matches."""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from saccade.keypoints._two_view_kernels import fill_beyond
from saccade.keypoints.two_view_fit import (
    CAUCHY_WIDTH,
    CROSS,
    homogeneous,
    nearest_model,
    project,
    residuals_of,
    tangents,
)
from saccade.keypoints.two_view_models import Matches
from saccade.types import BoolArray, FloatArray

MAX_EXCESS = 0.05
"""Largest distance from infinity that counts, in the plane z = 1."""
UNKNOWN_DIRECTION = 0.6
"""Standard deviation of a direction in radians above which the direction is unknown: the covariance
follows from derivatives, which hold for small errors."""
CURVATURE_STEP = 0.5
"""Step of the second differences of the loss, in standard deviations."""
MOST = 90
"""Percentile of the inverse depths of matches that are plausible."""
MAX_PLAUSIBLE_INVERSE_DEPTH = 2.0
"""Largest inverse depth of a plausible match, in that percentile."""
TWIN = 0.9
"""Points in front of the cameras in the second solution of a plane, as a fraction of those in the
first, from which the two cannot be told apart."""
SMALL_TURN = 1e-3
"""Largest angle in radians at which a rotation vector is linear in the matrix."""
SAME_SOLUTION = 1e-8
"""Squared difference of two solutions that are one."""


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Pose of the second camera: a point X of the first one's frame is `rotation` X + translation.

    The frames of cameras are x right, y down, z ahead.
    """

    rotation: FloatArray
    """(3, 3)."""
    translation: FloatArray
    """(3,) of length 1, since two images do not determine the distance; 0 where the camera has not
    moved, or only turned."""
    covariance: FloatArray | None
    """(6, 6) of the rotation vector, in radians along the axes of the second camera, and of
    `translation`, which is infinite where its direction is unknown; None where the matches do not
    determine it. Errors of the calibration are not in it."""

    @property
    def rotation_sigma(self) -> float:
        """Standard deviation of the rotation in degrees; infinite if unknown."""
        return self._sigma(slice(3))

    @property
    def direction_sigma(self) -> float:
        """Standard deviation of the translation's direction in degrees; infinite if unknown."""
        return self._sigma(slice(3, 6))

    def _sigma(self, rows: slice) -> float:
        if self.covariance is None:
            return float("inf")
        return float(np.degrees(np.sqrt(np.trace(self.covariance[rows, rows]))))


class Triangulation(NamedTuple):
    """Points of matches in space, in the frame of the first camera; the baseline has length 1."""

    xyz: FloatArray
    """(m, 3); NaN where a match is no inlier, or its depth is unknown."""
    covariance: FloatArray
    """(m, 3, 3) from the errors of the positions and of the pose; NaN as `xyz`."""


def pose_of(
    essential: FloatArray, rays: FloatArray, covariance: FloatArray | None = None
) -> RelativePose:
    """The pose of an essential matrix whose points are in front of both cameras.

    Points that are not count by their distance from infinity, since the noise of far points decides
    where they seem to be.

    Args:
        essential: (3, 3).
        rays: (m, 4) rows x1, y1, x2, y2, points in the planes z = 1 of the cameras.
        covariance: (9, 9) of the entries of `essential`, row by row.
    """
    *rotations, t = (np.asarray(each, float) for each in cv2.decomposeEssentialMat(essential))
    t = t.ravel()
    poses = [
        (float(np.minimum(beyond, MAX_EXCESS).sum()), R, sign * t)
        for R in rotations
        for sign, beyond in zip((1, -1), _both_beyond_infinity(R, t, rays), strict=True)
    ]
    _, R, t = min(poses, key=lambda pose: pose[0])
    if covariance is None:
        return RelativePose(R, t, None)
    cross = cross_matrix(t)  # E is [t]x R times a scale
    scale = (cross @ R * essential).sum() / 2
    by_rotation = cross @ CROSS @ R  # (3, 3, 3)
    by_translation = np.tensordot(np.eye(3) - np.outer(t, t), CROSS @ R, 1)
    J = np.linalg.pinv(scale * np.concatenate([by_rotation, by_translation]).reshape(6, 9).T)
    return with_unknown(RelativePose(R, t, J @ covariance @ J.T))


def cross_matrix(t: FloatArray) -> FloatArray:
    """(3, 3) matrix of the cross product with a vector (3,) from the left."""
    matrix: FloatArray = np.tensordot(t, CROSS, 1)
    return matrix


def with_unknown(pose: RelativePose) -> RelativePose:
    """The pose with an infinite covariance of its direction where that is as good as unknown."""
    assert pose.covariance is not None
    direction = pose.covariance[3:, 3:]
    if np.isfinite(direction).all() and np.linalg.eigvalsh(direction)[-1] < UNKNOWN_DIRECTION**2:
        return pose
    return RelativePose(pose.rotation, pose.translation, unknown_direction(pose.covariance[:3, :3]))


def unknown_direction(rotation: FloatArray) -> FloatArray:
    """(6, 6) covariance of a pose of unknown direction, from that of its rotation (3, 3)."""
    covariance = np.diag([0.0, 0, 0, np.inf, np.inf, np.inf])
    covariance[:3, :3] = rotation
    return covariance


def in_front(R: FloatArray, t: FloatArray, rays: FloatArray) -> BoolArray:
    """(m,) whether the rays of matches meet in front of both cameras, in a pose (R, t)."""
    return np.asarray(beyond_infinity(R, t, rays) == 0)


def beyond_infinity(R: FloatArray, t: FloatArray, rays: FloatArray) -> FloatArray:
    """(m,) distances in the second view of matches from points in front of the cameras.

    The points of a first ray lie on half of its epipolar line, which begins at their direction at
    infinity. The noise of a far point may put it a little beyond. 0 in front of both cameras, and
    infinite where the direction at infinity is behind the second one.

    Args:
        R: (3, 3) rotation.
        t: (3,) translation.
        rays: (m, 4) rows x1, y1, x2, y2.
    """
    return _both_beyond_infinity(R, t, rays)[0]


def _both_beyond_infinity(
    R: FloatArray, t: FloatArray, rays: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """`beyond_infinity` of a translation and of the opposite one."""
    ahead, behind = np.empty((2, len(rays)))
    R, t, rays = (np.ascontiguousarray(each) for each in (R, t, rays))
    fill_beyond(R, t, rays, ahead, behind)
    return ahead, behind


def is_plausibly_near(pose: RelativePose, matches: Matches) -> BoolArray:
    """(m,) whether matches are not much nearer to the camera than nearly all others.

    A wrong match that happens to lie near its epipolar line mostly seems near to the camera, and
    turns the pose more than the right ones.
    """
    R, t, rays = pose.rotation, pose.translation, matches.positions
    first, second = homogeneous(rays[:, :2]) @ R.T, homogeneous(rays[:, 2:])
    normal = np.cross(first, second)
    with np.errstate(divide="ignore"):
        nearness = (normal**2).sum(axis=1) / np.abs((np.cross(t, second) * normal).sum(axis=1))
    if not len(nearness):
        return np.zeros(0, np.bool_)
    plausible: BoolArray = nearness <= MAX_PLAUSIBLE_INVERSE_DEPTH * np.percentile(nearness, MOST)
    return plausible


def corrected_covariance(
    essential: FloatArray, covariance: FloatArray, matches: Matches, scale: float
) -> FloatArray:
    """(9, 9) covariance of an essential matrix with the curvature of its loss.

    Gauss-Newton's information counts the noise of the positions as parallax, and so is certain of a
    direction where there is none. The second derivatives of the loss do not.

    Args:
        essential: (3, 3), refined.
        covariance: (9, 9) of its entries, of Gauss-Newton's information.
        matches: inliers, in the planes z = 1.
        scale: robust standard deviation of the residuals.

    Source: Huber & Ronchetti (2009), section 6.3: the derivative of the scores.
    """
    norm = float(np.linalg.norm(essential))
    unit, width = essential / norm, CAUCHY_WIDTH * scale
    directions = tangents(unit, "essential")  # (5, 9)
    small = directions @ covariance @ directions.T / norm**2
    values, vectors = np.linalg.eigh(small)
    axes = vectors * np.sqrt(np.maximum(values, 1e-18))  # columns of one standard deviation
    steps = axes.T @ directions  # (5, 9)
    residuals = residuals_of("essential", unit, matches.positions, matches.sigma)

    def loss(change: FloatArray) -> float:
        moved = nearest_model(unit + change.reshape(3, 3), "essential")
        z, _ = residuals(moved)
        return float(np.log1p((z / width) ** 2).sum() * width**2 / 2)

    h, k = CURVATURE_STEP, len(steps)
    here = loss(np.zeros(9))

    def bend(change: FloatArray) -> float:
        """Second difference of the loss along a change."""
        return (loss(h * change) + loss(-h * change) - 2 * here) / h**2

    H = np.diag([bend(step) for step in steps])
    for i in range(k):
        for j in range(i):
            both = bend(steps[i] + steps[j])
            H[i, j] = H[j, i] = (both - H[i, i] - H[j, j]) / 2
    z, J = residuals(unit)
    weighted = 1 + (z / width) ** 2
    slope = float(((2 - weighted) / weighted**2).mean())
    by_step = (J @ steps.T).reshape(-1, k)
    information = slope * by_step.T @ by_step
    # The sandwich of `covariance` has this information on both sides, H takes its place.
    values, vectors = np.linalg.eigh(H)
    floor = np.maximum(values, 1e-3 * np.abs(values).max(initial=1e-12))
    ratio = vectors @ np.diag(1 / floor) @ vectors.T @ information
    corrected: FloatArray = norm**2 * steps.T @ ratio @ ratio.T @ steps
    return corrected


def turned_pose(R: FloatArray, matches: Matches) -> RelativePose:
    """The pose of a camera that only turned, with the covariance of the rotation."""
    z, J = residuals_of("homography", R, matches.positions, matches.sigma)(R)
    by_rotation = J @ (CROSS @ R).reshape(3, 9).T  # (m, 2, 3)
    information = np.tensordot(by_rotation, by_rotation, ((0, 1), (0, 1)))
    variance = float(np.median((z**2).sum(axis=1)) / (2 * np.log(2)))
    rotation = variance * np.asarray(np.linalg.inv(information), np.float64)
    return RelativePose(R, np.zeros(3), unknown_direction(rotation))


def planar_pose(
    homography: FloatArray, covariance: FloatArray, rays: FloatArray
) -> RelativePose | None:
    """The pose of a camera that views a plane; None without a solution in front of the cameras.

    A plane has up to two poses. Where points in front of the cameras do not tell them apart, the
    covariance contains both.

    Args:
        homography: (3, 3) between the planes z = 1.
        covariance: (9, 9) of its entries.
        rays: (m, 4) inliers.

    Source: Malis & Vargas (2007), OpenCV's `decomposeHomographyMat`.
    """
    middle = float(np.linalg.svd(homography, compute_uv=False)[1])
    solutions = decomposed(homography / np.copysign(middle, np.linalg.det(homography)))
    if not solutions:
        return None
    counts = [int(in_front(plane.R, plane.direction, rays).sum()) for plane in solutions]
    most = max(counts)
    best = solutions[counts.index(most)]
    pose = best.R, best.direction
    gaps = [
        difference((other.R, other.direction), pose)
        for other, count in zip(solutions, counts, strict=True)
        if count >= TWIN * most
    ]
    twins = [gap for gap in gaps if gap @ gap > SAME_SOLUTION]
    J = best.derivatives(homography)
    total = J @ covariance @ J.T
    for gap in twins[:1]:
        total = total + np.outer(gap, gap) / 2
    if not np.isfinite(total).all():
        return RelativePose(*pose, None)
    return with_unknown(RelativePose(*pose, total))


class PlanePose(NamedTuple):
    """A solution R + t n' of a homography between the planes z = 1, at a scale."""

    R: FloatArray
    """(3, 3) rotation."""
    t: FloatArray
    """(3,) translation over the distance of the plane."""
    n: FloatArray
    """(3,) unit normal of the plane in the first camera."""

    @property
    def direction(self) -> FloatArray:
        """(3,) unit vector of the translation."""
        unit: FloatArray = self.t / np.linalg.norm(self.t)
        return unit

    def derivatives(self, homography: FloatArray) -> FloatArray:
        """(6, 9) derivatives of rotation vector and direction by the entries of the homography."""
        scaled = self.R + np.outer(self.t, self.n)
        across = np.linalg.svd(self.n[None])[2][1:]  # (2, 3) in which the normal can move
        changes = np.concatenate(
            [
                CROSS @ self.R,
                np.eye(3)[:, :, None] * self.n,
                self.t[:, None] * across[:, None],
                scaled[None],
            ]
        ).reshape(9, 9)
        scale = float((homography * scaled).sum() / (scaled**2).sum())
        by_entries = np.linalg.inv(changes.T)[:6] / scale
        unit, length = self.direction, float(np.linalg.norm(self.t))
        by_entries[3:] = (np.eye(3) - np.outer(unit, unit)) / length @ by_entries[3:]
        return by_entries


def decomposed(homography: FloatArray) -> list[PlanePose]:
    """Solutions of a homography between the planes z = 1 whose middle singular value is 1."""
    _, *found = cv2.decomposeHomographyMat(homography, np.eye(3))
    solutions = [
        PlanePose(*(np.asarray(each, np.float64) for each in (R, t.ravel(), n.ravel())))
        for R, t, n in zip(*found, strict=True)
    ]
    return [each for each in solutions if np.linalg.norm(each.t) > 0]


def difference(
    pose: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """(6,) rotation vector and translation from one pose to another."""
    R = pose[0] @ other[0].T
    turn = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    if np.trace(R) < 3 - SMALL_TURN**2:  # OpenCV takes small turns for none
        turn = np.asarray(cv2.Rodrigues(R)[0], np.float64).ravel()
    return np.concatenate([turn, pose[1] - other[1]])


def triangulated(pose: RelativePose, matches: Matches) -> Triangulation:
    """Points of matches with covariances; see `Triangulation`.

    Args:
        pose: of known direction.
        matches: in the planes z = 1.

    Source: Hartley & Zisserman (2004), section 12.2, and one Gauss-Newton step.
    """
    R, t, rays = pose.rotation, pose.translation, matches.positions
    first, second = homogeneous(rays[:, :2]), homogeneous(rays[:, 2:])
    turned = first @ R.T
    normal = np.cross(turned, second)
    depth = -(np.cross(t, second) * normal).sum(axis=1) / (normal**2).sum(axis=1)
    xyz = depth[:, None] * first
    sigma = np.repeat(matches.sigma, 2, axis=1)  # (m, 4)

    def reprojection(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(m, 4) residuals in standard deviations, derivatives by points and by the pose."""
        moved = points @ R.T + t
        gap = np.hstack([project(np.eye(3), _plane(points)), _plane(moved)]) - rays
        by_first, by_second = _projection(points), _projection(moved)
        by_points = np.concatenate([by_first, by_second @ R], axis=1)
        by_pose = np.zeros((len(points), 4, 6))
        by_pose[:, 2:, :3] = by_second @ -np.cross(np.eye(3), (points @ R.T)[:, None])
        by_pose[:, 2:, 3:] = by_second
        return gap / sigma, by_points / sigma[:, :, None], by_pose / sigma[:, :, None]

    with np.errstate(all="ignore"):
        for _ in range(2):
            z, J, _ = reprojection(xyz)
            A = J.transpose(0, 2, 1) @ J
            xyz = xyz - _solved(A, (J.transpose(0, 2, 1) @ z[:, :, None]))[:, :, 0]
        _, J, by_pose = reprojection(xyz)
        A = J.transpose(0, 2, 1) @ J
        covariance = _solved(A, np.broadcast_to(np.eye(3), A.shape))
        if pose.covariance is not None and np.isfinite(pose.covariance).all():
            gain = covariance @ (J.transpose(0, 2, 1) @ by_pose)  # (m, 3, 6)
            covariance = covariance + gain @ pose.covariance @ gain.transpose(0, 2, 1)
        ahead = (xyz[:, 2] > 0) & ((xyz @ R.T + t)[:, 2] > 0) & np.isfinite(xyz).all(axis=1)
    return Triangulation(
        np.where(ahead[:, None], xyz, np.nan), np.where(ahead[:, None, None], covariance, np.nan)
    )


def _plane(points: FloatArray) -> FloatArray:
    xy: FloatArray = points[:, :2] / points[:, 2:]
    return xy


def _projection(points: FloatArray) -> FloatArray:
    """(m, 2, 3) derivatives of the projection onto the plane z = 1."""
    derivatives: FloatArray = (np.eye(3)[:2] - _plane(points)[:, :, None] * np.eye(3)[2]) / points[
        :, 2, None, None
    ]
    return derivatives


def _solved(A: FloatArray, b: FloatArray) -> FloatArray:
    """Solutions of (m, 3, 3) systems; NaN where they are singular."""
    usable = np.isfinite(A).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(A))) > 0)
    safe = np.where(usable[:, None, None], A, np.eye(3))
    return np.where(usable[:, None, None], np.linalg.solve(safe, b), np.nan)
