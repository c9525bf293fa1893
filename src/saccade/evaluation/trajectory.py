"""Errors of an estimated trajectory and map against ground truth.

Errors of poses in SE(3) follow evo and KITTI's benchmark, after Sturm, Engelhard, Endres, Burgard &
Cremers (2012) and Geiger, Lenz & Urtasun (2012).
"""

from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np

from saccade.errors import LogError, Settings, setting
from saccade.frames import Poses
from saccade.landmark_names import labels_of, number_labels
from saccade.plane import rotations
from saccade.slam.consistency import normalized_squared
from saccade.types import THREE_SIGMA_2D, FloatArray, IntArray, LandmarkMap, Trajectory

TRIMMED_ITERATIONS = 30
"""Iterations of the trimmed alignment."""
MIN_SPREAD = 1e-12
"""Minimum singular value of points that span a dimension, as a fraction of the largest."""


class Similarity(NamedTuple):
    """A similarity transformation; rigid for scale 1."""

    rotation: FloatArray
    """(d, d)."""
    translation: FloatArray
    """(d,)."""
    scale: float
    rank: int
    """Dimension of the points' span; below d - 1 the rotation is undetermined."""

    def __call__(self, points: FloatArray) -> FloatArray:
        """The transformed points (n, d)."""
        return np.asarray(self.scale * points @ self.rotation.T + self.translation)


def umeyama(points: FloatArray, onto: FloatArray, with_scale: bool = False) -> Similarity:
    """Least-squares alignment of points (n, d) to corresponding points (n, d).

    Args:
        points: points to be moved.
        onto: their correspondences.
        with_scale: whether to estimate the scale; otherwise it is 1.

    Source: Umeyama (1991).
    """
    mean, target_mean = points.mean(0), onto.mean(0)
    centered = points - mean
    U, values, Vt = np.linalg.svd((onto - target_mean).T @ centered)
    signs = np.ones(len(values))
    signs[-1] = np.sign(np.linalg.det(U @ Vt))
    rotation = (U * signs) @ Vt
    spread = np.square(centered).sum()
    scale = float((values * signs).sum() / spread) if with_scale and spread > 0 else 1.0
    rank = int((values > MIN_SPREAD * max(values[0], 1e-300)).sum())
    return Similarity(rotation, target_mean - scale * rotation @ mean, scale, rank)


def position_rmse(
    trajectory: Trajectory, truth: Trajectory, *, keep: float = 1.0, aligned: bool = True
) -> float:
    """Absolute trajectory error (ATE) on the plane: root mean square position error in meters.

    Args:
        trajectory: estimated poses.
        truth: true positions, at any times.
        keep: fraction of the smallest errors that count and determine the alignment; below 1 for
            ground truth with outliers, such as GPS among trees.
        aligned: whether to align the trajectory first; False if it is in the frame of the truth.

    Returns:
        The error at `common_times`; NaN for fewer than two.
    """
    time = common_times(trajectory, truth)
    points, true = (each.interpolate(time)[:, :2] for each in (trajectory, truth))
    return point_rmse(points, true, keep=keep, aligned=aligned)


def common_times(trajectory: Trajectory, truth: Trajectory) -> FloatArray:
    """(n,) times for the comparison of two trajectories, from the sparser trajectory.

    Both cover these times (`Trajectory.covers`). An estimate may have any regular pose interval.
    """
    time = min(trajectory, truth, key=len).time
    return time[truth.covers(time) & trajectory.covers(time, longest=np.inf)]


MIN_COMPARED = 10
"""Minimum number of poses with ground truth for meaningful errors."""
MIN_FRACTION = 0.1
"""Minimum fraction of poses with ground truth for meaningful errors."""


def coverage_remarks(compared: int | None, poses: int) -> tuple[str, ...]:
    """Remarks on incomplete ground truth; empty without ground truth."""
    if compared is None or compared >= poses:
        return ()
    remark = f"truth for {compared} of {poses} poses: the errors refer to this part"
    if compared < max(MIN_COMPARED, MIN_FRACTION * poses):
        remark = f"warning: truth for only {compared} of {poses} poses: not representative"
    return (remark,)


def landmark_rmse(landmarks: LandmarkMap, truth: LandmarkMap, *, aligned: bool = True) -> float:
    """Root mean square error of the landmarks in both maps, in meters; NaN for fewer than two.

    Args:
        landmarks: the estimates.
        truth: true positions of landmarks with the same labels.
        aligned: whether to align the estimates with the truth first.
    """
    ids, _ = number_labels(labels_of(truth.id, truth.text_names), landmarks.text_names)
    _, ours, theirs = np.intersect1d(landmarks.id, ids, return_indices=True)
    return point_rmse(landmarks.xy[ours], truth.xy[theirs], aligned=aligned)


def point_rmse(
    points: FloatArray, truth: FloatArray, *, keep: float = 1.0, aligned: bool = True
) -> float:
    """Root mean square distance of points (n, d) to their true positions; see `position_rmse`."""
    if len(points) < 2:
        return float("nan")
    inliers = np.ones(len(points), bool)
    for _ in range(TRIMMED_ITERATIONS if keep < 1 else 1):
        moved = umeyama(points[inliers], truth[inliers])(points) if aligned else points
        error = np.linalg.norm(moved - truth, axis=1)
        inliers = error <= np.quantile(error, keep)
    return root_mean_square(error[inliers])


def root_mean_square(errors: FloatArray) -> float:
    """Root mean square of errors (n,); NaN for none."""
    return float(np.sqrt(np.square(errors).mean())) if len(errors) else float("nan")


def none_if_nan(value: float) -> float | None:
    """A finite number, else None: JSON has neither NaN nor infinity."""
    return value if isfinite(value) else None


@dataclass(frozen=True)
class DriveScore:
    """Errors of an estimated trajectory on the plane, in meters, at poses with ground truth."""

    poses_compared: int
    """Number of poses in the absolute errors."""
    ate_m: float
    """Absolute trajectory error: RMSE of the position after alignment without scale (evo's APE)."""
    ate_unaligned_m: float
    """ATE without alignment, if the start is known."""
    rpe_m: float
    """Relative pose error: RMSE of the translation between frames (evo's RPE)."""
    end_m: float
    """Position error at the last pose with ground truth, if the start is known."""
    inside_3sigma: float
    """Fraction of frames with the true position inside the 99.7 % ellipse; NaN without
    covariances."""


def score_drive(estimate: Trajectory, truth: Trajectory, *, start_known: bool = True) -> DriveScore:
    """Compares poses with interpolated ground truth, where available (`Trajectory.covers`).

    Args:
        estimate: n poses.
        truth: true poses in the same frame.
        start_known: whether the estimate starts at the true pose; otherwise errors without
            alignment are NaN.
    """
    true_pose = truth.at(estimate.time)
    covered = truth.covers(estimate.time)
    error = estimate.pose[:, :2] - true_pose[:, :2]
    first = np.flatnonzero(covered[:-1] & covered[1:])
    poses = _in_space(estimate.time, estimate.pose)
    steps = relative_errors(poses, _in_space(estimate.time, true_pose), first, first + 1)
    later = np.flatnonzero(covered[1:]) + 1  # the first pose is exact
    unaligned = end = inside = float("nan")
    if start_known and covered.any():
        unaligned = position_rmse(estimate, truth, aligned=False)
        end = float(np.hypot(*error[covered][-1]))
    if start_known and estimate.covariance is not None and len(later):
        covariance = estimate.covariance[later, :2, :2] + 1e-12 * np.eye(2)
        inside = float((normalized_squared(error[later], covariance) < THREE_SIGMA_2D).mean())
    return DriveScore(
        poses_compared=len(common_times(estimate, truth)),
        ate_m=position_rmse(estimate, truth),
        ate_unaligned_m=unaligned,
        rpe_m=root_mean_square(steps.translation),
        end_m=end,
        inside_3sigma=inside,
    )


def _in_space(time: FloatArray, pose: FloatArray) -> Poses:
    """Poses on the plane (n, 3) as poses in space."""
    rotation = np.tile(np.eye(3), (len(pose), 1, 1))
    rotation[:, :2, :2] = rotations(pose[:, 2])
    return Poses(time, rotation, pose * (1.0, 1.0, 0.0))


SEGMENTS = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
"""Lengths of KITTI's segments in meters; a segment of each length starts at every tenth pose."""


@dataclass(frozen=True)
class PoseErrorConfig(Settings):
    """Association of estimated with true poses, and their alignment."""

    max_difference: float = setting(0.01, 0)
    """Maximum time difference in seconds between a pose and the true pose."""
    scale: bool = False
    """Whether the alignment estimates the scale, as for a monocular camera."""


class Errors(NamedTuple):
    """Errors of n poses, pairs or segments."""

    translation: FloatArray
    """(n,) meters; for segments, percent of the length."""
    rotation: FloatArray
    """(n,) degrees; for segments, degrees per 100 m; NaN if the alignment leaves it undetermined
    (see `score_poses`)."""


class PoseScores(NamedTuple):
    """Errors of n estimated poses with ground truth."""

    poses: int
    """Number of poses of the estimate, with and without ground truth."""
    estimate: Poses
    """Aligned."""
    truth: Poses
    """True poses at the same times, within `PoseErrorConfig.max_difference`."""
    aligned: Errors
    """Errors after rigid alignment, or after alignment with scale if configured."""
    unaligned: Errors
    """Errors without alignment, for an estimate in the frame of the truth."""
    scale: float
    """Scale of the alignment; 1 if not estimated."""
    relative: Errors
    """(n - 1,) errors of the motion from each pose to the next (RPE)."""
    segments: Errors
    """KITTI's errors over segments of 100 to 800 m; empty for paths shorter than 100 m."""


class Statistics(NamedTuple):
    """Statistics of errors, in their unit."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float


def statistics(errors: FloatArray) -> Statistics:
    """Statistics of errors (n,); NaN for none."""
    if len(errors) == 0:
        return Statistics(*[float("nan")] * len(Statistics._fields))
    of_each = (np.mean, np.median, np.std, np.min, np.max)
    return Statistics(root_mean_square(errors), *(float(each(errors)) for each in of_each))


def score_poses(
    estimate: Poses, truth: Poses, config: PoseErrorConfig = PoseErrorConfig()
) -> PoseScores:
    """Compares estimated poses with ground truth.

    If all positions lie on a line, the alignment leaves the rotation about it undetermined, and the
    rotation errors after alignment are NaN.

    Args:
        estimate: estimated poses; unaligned errors require the frame of the truth.
        truth: true poses of the same body.
        config: association and alignment.

    Raises:
        LogError: fewer than two poses have ground truth.
    """
    poses = len(estimate.time)
    estimate, truth = associate(estimate, truth, config)
    fit = umeyama(estimate.position, truth.position, config.scale)
    moved = Poses(estimate.time, fit.rotation @ estimate.rotation, fit(estimate.position))
    aligned = _absolute(moved, truth)
    if fit.rank < 2:
        aligned = aligned._replace(rotation=np.full(len(aligned.rotation), np.nan))
    scaled = Poses(estimate.time, estimate.rotation, fit.scale * estimate.position)
    first = np.arange(len(truth.time) - 1)
    return PoseScores(
        poses=poses,
        estimate=moved,
        truth=truth,
        aligned=aligned,
        unaligned=_absolute(estimate, truth),
        scale=fit.scale,
        relative=relative_errors(scaled, truth, first, first + 1),
        segments=_segment_errors(scaled, truth),
    )


def associate(
    estimate: Poses, truth: Poses, config: PoseErrorConfig = PoseErrorConfig()
) -> tuple[Poses, Poses]:
    """Corresponding poses, one for each pose of the shorter trajectory.

    Raises:
        LogError: there are fewer than two.
    """
    swapped = len(truth.time) > len(estimate.time)
    few, many = (estimate, truth) if swapped else (truth, estimate)
    after = np.searchsorted(many.time, few.time).clip(1, max(len(many.time) - 1, 1))
    neighbors = np.stack([after - 1, after]).clip(0, len(many.time) - 1)  # (2, n)
    distance = np.abs(many.time[neighbors] - few.time)
    nearest = neighbors[distance.argmin(0), np.arange(len(few.time))]
    found = distance.min(0) <= config.max_difference
    if found.sum() < 2:
        raise LogError(
            f"expected at least 2 poses within {config.max_difference:g} s of a true pose, found "
            f"{int(found.sum())}, the nearest {distance.min():.3g} s away"
        )
    few, many = _select(few, found), _select(many, nearest[found])
    return (few, many) if swapped else (many, few)


def path_length(position: FloatArray) -> FloatArray:
    """Arc length (n,) in meters along a path (n, d)."""
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _absolute(estimate: Poses, truth: Poses) -> Errors:
    turn = truth.rotation.transpose(0, 2, 1) @ estimate.rotation
    distance = np.linalg.norm(estimate.position - truth.position, axis=1)
    return Errors(distance, np.degrees(rotation_angle(turn)))


def relative_errors(estimate: Poses, truth: Poses, first: IntArray, second: IntArray) -> Errors:
    """Relative pose errors (RPE) of the motions (m,) between pairs of poses."""
    turn, shift = _motion(estimate, first, second)
    true_turn, true_shift = _motion(truth, first, second)
    rotation = true_turn.transpose(0, 2, 1) @ turn
    return Errors(np.linalg.norm(shift - true_shift, axis=1), np.degrees(rotation_angle(rotation)))


def _motion(poses: Poses, first: IntArray, second: IntArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (m, 3, 3) and translations (m, 3) between poses, in the frames of the first."""
    back = poses.rotation[first].transpose(0, 2, 1)
    shift = (back @ (poses.position[second] - poses.position[first])[:, :, None])[:, :, 0]
    return back @ poses.rotation[second], shift


def _segment_errors(estimate: Poses, truth: Poses) -> Errors:
    reached = path_length(truth.position)
    start, length = (grid.ravel() for grid in np.meshgrid(np.arange(0, len(reached), 10), SEGMENTS))
    end = np.searchsorted(reached, reached[start] + length, side="right")
    inside = end < len(reached)
    meters = length[inside]
    errors = relative_errors(estimate, truth, start[inside], end[inside])
    return Errors(100 * errors.translation / meters, 100 * errors.rotation / meters)


def rotation_angle(rotation: FloatArray) -> FloatArray:
    """Angles (n,) of rotations (n, 3, 3) in radians, 0 to pi, accurate for small angles."""
    skew = rotation - rotation.transpose(0, 2, 1)
    sine = np.linalg.norm(skew[:, [2, 0, 1], [1, 2, 0]], axis=1) / 2
    return np.asarray(np.arctan2(sine, (np.trace(rotation, axis1=1, axis2=2) - 1) / 2))


def _select(poses: Poses, rows: FloatArray | IntArray) -> Poses:
    return Poses(poses.time[rows], poses.rotation[rows], poses.position[rows])
