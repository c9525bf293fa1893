"""Errors of an estimated trajectory and map on the plane against ground truth.

Absolute and relative errors are those of Sturm, Engelhard, Endres, Burgard & Cremers (2012); evo
reads `trajectory.tum` and computes them in space.
"""

from dataclasses import dataclass, replace
from math import isfinite
from typing import NamedTuple

import numpy as np

from saccade.landmark_names import labels_of, number_labels
from saccade.plane import relative_poses
from saccade.slam.consistency import normalized_squared
from saccade.types import THREE_SIGMA_2D, FloatArray, LandmarkMap, Trajectory

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
MIN_TRUTH_FRACTION = 0.1
"""Minimum fraction of poses with ground truth for meaningful errors."""


def coverage_remarks(compared: int | None, poses: int) -> tuple[str, ...]:
    """Remarks on incomplete ground truth; empty without ground truth."""
    if compared is None or compared >= poses:
        return ()
    remark = f"truth for {compared} of {poses} poses: the errors refer to this part"
    if compared < max(MIN_COMPARED, MIN_TRUTH_FRACTION * poses):
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
    alignment_scale: float = 1.0
    """Scale of the alignment; 1 where the scale of the estimate is known."""


def score_drive(
    estimate: Trajectory,
    truth: Trajectory,
    *,
    start_known: bool = True,
    scale_known: bool = True,
) -> DriveScore:
    """Compares poses with interpolated ground truth, where available (`Trajectory.covers`).

    Args:
        estimate: n poses.
        truth: true poses in the same frame.
        start_known: whether the estimate starts at the true pose; otherwise errors without
            alignment are NaN.
        scale_known: whether the estimate is in meters; otherwise it is aligned with scale (Sim3),
            and errors without alignment are NaN.
    """
    scale = 1.0
    if not scale_known:
        time = common_times(estimate, truth)
        if len(time) >= 2:
            points, true = (each.interpolate(time)[:, :2] for each in (estimate, truth))
            scale = umeyama(points, true, with_scale=True).scale
        estimate = replace(estimate, pose=estimate.pose * (scale, scale, 1.0), covariance=None)
        start_known = False
    true_pose = truth.at(estimate.time)
    covered = truth.covers(estimate.time)
    error = estimate.pose[:, :2] - true_pose[:, :2]
    first = np.flatnonzero(covered[:-1] & covered[1:])
    step, true_step = (
        relative_poses(pose[first], pose[first + 1]) for pose in (estimate.pose, true_pose)
    )
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
        rpe_m=root_mean_square(np.hypot(*(step - true_step)[:, :2].T)),
        end_m=end,
        inside_3sigma=inside,
        alignment_scale=scale,
    )


def path_length(position: FloatArray) -> FloatArray:
    """Arc length (n,) in meters along a path (n, d)."""
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
