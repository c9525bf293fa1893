"""Summaries of SLAM runs and camera drives, with errors against ground truth."""

from dataclasses import asdict, fields
from math import floor, log10
from typing import Any

import numpy as np

from saccade.evaluation.trajectory import (
    DriveScore,
    common_times,
    coverage_remarks,
    landmark_rmse,
    none_if_nan,
    position_rmse,
    score_drive,
)
from saccade.frames import Drive
from saccade.plane import point_covariance, rotated, rotations, to_points
from saccade.slam import SlamResult
from saccade.slam.consistency import normalized_squared
from saccade.slam.results import MAX_NONLINEARITY
from saccade.types import THREE_SIGMA_2D, BoolArray, FloatArray, IntArray, LandmarkLog, Trajectory
from saccade.visual import ObservationKind, VisualResult

GROSS_WEIGHT = 0.25
"""Maximum weight of a gross error (over 5 sigma) in the smoothing."""
GPS_INLIERS = 0.9
"""Fraction of GPS positions used; the rest may be multipath reflections."""
MIN_DEVIATION = 5e-4
"""Standard deviation in the unit of the words below which a bias was declared, not estimated."""


def summarize_run(log: LandmarkLog, result: SlamResult) -> dict[str, Any]:
    """Figures of a run, as in run.json, with errors if the log has ground truth.

    The name of an error includes its estimate: smoothed, filtered, or odometry alone. Errors are
    given after alignment and, if the ground truth is in the frame of the log, also without; see
    `LandmarkLog.aligned_truth`.
    """
    row: dict[str, Any] = {
        "log": log.name,
        "estimate": result.estimate,
        "poses": len(result.trajectory),
        "observations": len(log.observation),
        "observations_used": int((result.association >= 0).sum()),
        "observations_downweighted": None
        if result.weight is None
        else int((result.weight < GROSS_WEIGHT).sum()),
        "labels_rejected": int(result.rejected.sum()),
        "landmarks": len(result.map),
        "landmarks_culled": result.removed,
        **_odometry_end(log, result),
        "lost": lost_times(result.trajectory, result.lost),
        **_odometry_biases(result),
        "nis_mean": none_if_nan(result.consistency.mean),
        "nis_band": list(result.consistency.band),
        "nonlinearity": result.nonlinearity,
        "consistency": result.consistency.verdict or "too few observations for a verdict",
        "warning": _doubt(result),
    }
    remarks = [result.remark, result.consistency.remark]
    trajectories = {
        "odometry": result.dead_reckoning,
        "filtered": result.filtered,
        result.estimate: result.trajectory,
    }
    if log.truth is not None:
        exact = has_headings(log.truth)
        compared = len(common_times(result.trajectory, log.truth))
        row["poses_compared"] = compared
        remarks += coverage_remarks(compared, len(result.trajectory))
        for name, trajectory in trajectories.items():
            rmse = position_rmse(trajectory, log.truth, keep=1.0 if exact else GPS_INLIERS)
            row[f"{name}_position_{'rmse_m' if exact else 'gps_rmse_m'}"] = none_if_nan(rmse)
            if log.aligned_truth is not None:
                rmse = position_rmse(trajectory, log.truth, aligned=False)
                row[f"{name}_position_unaligned_rmse_m"] = none_if_nan(rmse)
    if log.landmark_truth is not None:
        for kind, aligned in (("rmse_m", True), ("unaligned_rmse_m", False)):
            rmse = landmark_rmse(result.map, log.landmark_truth, aligned=aligned)
            row[f"{result.estimate}_landmark_{kind}"] = none_if_nan(rmse)
    return row | {"remark": "; ".join(filter(None, remarks))}


def _odometry_biases(result: SlamResult) -> dict[str, Any]:
    """Estimated odometry biases with standard deviations, as numbers and as text."""
    bias, covariance = result.odometry_bias, result.bias_covariance
    if bias is None or covariance is None:
        return {"odometry_bias": None, "odometry_bias_sigma": None, "odometry_correction": ""}
    names, sigma = ("distance_scale", "turn_rad_per_m", "distance_m_per_rad"), covariance.diagonal()
    pairs = np.stack([bias, np.sqrt(sigma)], 1)  # (3, 2)
    units = (
        (100.0, "% of the distance"),
        (np.degrees(1.0), "degrees per meter"),
        (100.0, "cm per radian"),
    )
    words = (
        f"{_with_deviation(factor * mean, factor * std)} {unit}"
        for (mean, std), (factor, unit) in zip(pairs.tolist(), units, strict=True)
        if factor * std >= MIN_DEVIATION
    )
    return {
        "odometry_bias": dict(zip(names, pairs[:, 0].tolist(), strict=True)),
        "odometry_bias_sigma": dict(zip(names, pairs[:, 1].tolist(), strict=True)),
        "odometry_correction": ", ".join(words),
    }


def _with_deviation(mean: float, std: float) -> str:
    """Both to the second digit of the standard deviation."""
    digits = max(1 - floor(log10(std)), 0)
    return f"{mean:+.{digits}f} ± {std:.{digits}f}"


def _doubt(result: SlamResult) -> str:
    """Why the covariances of a filter are too small, in words; empty where they are not."""
    if result.estimate == "smoothed" or result.nonlinearity <= MAX_NONLINEARITY:
        return ""
    return (
        f"the covariances are too small: the uncertainty is large against the distances "
        f"(nonlinearity {result.nonlinearity:.2f}, over {MAX_NONLINEARITY:g}); smoothing "
        "linearizes all of the log again"
    )


def lost_times(trajectory: Trajectory, lost: BoolArray | None) -> list[list[float | None]]:
    """Times of kidnapping and relocalization, in seconds since the first pose.

    Args:
        trajectory: t poses.
        lost: (t,) True while lost; None if not tested.
    """
    if lost is None or len(trajectory) == 0:
        return []
    change = np.diff(np.concatenate([[False], lost, [False]]).astype(np.int64))
    times = [*(trajectory.time - trajectory.time[0]).tolist(), None]
    starts, ends = np.flatnonzero(change > 0).tolist(), np.flatnonzero(change < 0).tolist()
    return [[times[a], times[b]] for a, b in zip(starts, ends, strict=True)]


def has_headings(truth: Trajectory) -> bool:
    """Whether ground truth has headings; if not, as for GPS, its frame differs from the log's."""
    return bool(np.isfinite(truth.pose[:, 2]).all())


def _odometry_end(log: LandmarkLog, result: SlamResult) -> dict[str, float | None]:
    """Error of dead reckoning at the end, against ground truth or else the estimate.

    The end is the last pose with ground truth.
    """
    odometry, reference = result.dead_reckoning, result.trajectory
    name = "odometry_end_from_estimate_m"
    if log.aligned_truth is not None:
        reference, name = log.aligned_truth, "odometry_end_error_m"
    error = odometry.pose[:, :2] - reference.at(odometry.time)[:, :2]
    error = error[np.isfinite(error[:, 0])]
    return {name: float(np.hypot(*error[-1])) if len(error) else None}


OBSERVATION_TOLERANCE = 0.1
"""Tolerance between two observations of a landmark in meters, plus a tenth of it per meter of
range, in addition to the standard deviations."""


def correct_associations(
    frame: IntArray, landmark: IntArray, z: FloatArray, sigma: FloatArray, poses: FloatArray
) -> BoolArray:
    """Tests whether each observation agrees with the first observation of its landmark.

    Observations are projected from the true poses. Two observations agree if they lie within three
    sigma (99.7 %) of their covariances, which are elongated along the line of sight.

    Args:
        frame: (k,) ascending frame numbers.
        landmark: (k,) landmark numbers.
        z: (k, 2) range and bearing.
        sigma: (k, 2) their standard deviations.
        poses: (n, 3) true poses of the frames.

    Returns:
        (k,) mask.
    """
    pose = poses[frame]
    position = pose[:, :2] + rotated(to_points(z), pose[:, 2])
    turn = rotations(pose[:, 2])
    covariance = point_covariance(z, np.square(sigma)[:, :, None] * np.eye(2))
    covariance = turn @ covariance @ turn.transpose(0, 2, 1)
    _, first, index = np.unique(landmark, return_index=True, return_inverse=True)
    tolerance = OBSERVATION_TOLERANCE * (1 + z[:, 0] / 10) / np.sqrt(THREE_SIGMA_2D)
    covariance = covariance + covariance[first][index]
    covariance = covariance + np.square(tolerance)[:, None, None] * np.eye(2)
    difference = position - position[first][index]
    return np.asarray(normalized_squared(difference, covariance) < THREE_SIGMA_2D)


def summarize_drive(drive: Drive, result: VisualResult) -> dict[str, Any]:
    """The figures of a mapped drive, as in run.json.

    The errors without a name are of `VisualResult.trajectory`, whose kind is `estimate`. Errors are
    None without truth, and for odometry also without odometry.
    """
    n, observed = len(result.trajectory), result.observations
    reidentified = observed.kind == ObservationKind.REIDENTIFIED
    precision = None
    if drive.truth is not None:
        true_poses = drive.truth.at(drive.time)
        known = np.isfinite(true_poses[observed.frame, 0])
        seen, counted = observed[known], reidentified[known]
        correct = correct_associations(seen.frame, seen.landmark, seen.z, seen.sigma, true_poses)
        precision = float(correct[counted].mean()) if counted.any() else None
    return {
        "sequence": drive.name,
        "frames": n,
        "estimate": result.estimate,
        "alignment": "SE2" if drive.scale == "metric" else "Sim2, with scale",
        **_errors(drive, result.trajectory),
        "filtered": _errors(drive, result.filtered),
        "odometry": _errors(drive, result.odometry if drive.has_odometry else None),
        "visual_odometry": _errors(drive, result.visual_odometry),
        "association_precision": precision,
        "self_calibration": None if result.calibration is None else asdict(result.calibration),
        "landmarks": len(result.map),
        "landmarks_observed": len(np.unique(observed.landmark)),
        "observations": len(observed),
        "reidentified": int(reidentified.sum()),
        "missed": result.missed,
        "lost": lost_times(result.trajectory, result.lost),
        "ms_per_frame": 1000 * float(result.frame_seconds.mean()),
    }


def _errors(drive: Drive, estimate: Trajectory | None) -> dict[str, float | None]:
    if drive.truth is None or estimate is None:
        return dict.fromkeys(field.name for field in fields(DriveScore))
    known = {"start_known": drive.start_known, "scale_known": drive.scale == "metric"}
    score = asdict(score_drive(estimate, drive.truth, **known))
    return {name: none_if_nan(value) for name, value in score.items()}
