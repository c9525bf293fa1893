"""How well a drive was mapped, where the truth is known."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from saccade.evaluation.trajectory import position_rmse
from saccade.frames import steps_between
from saccade.types import THREE_SIGMA_2D, FloatArray, IntArray, Trajectory

SAME_PLACE = 0.1
"""Metres, and a tenth of it for each metre of range, by which two sightings of one place may be
apart besides their deviations."""


@dataclass(frozen=True)
class DriveScore:
    """One estimate of a way against the truth."""

    ate_m: float
    """Root mean square distance after alignment without scale (evo's APE)."""
    rpe_m: float
    """Root mean square error of the way from one frame to the next (evo's RPE, translation)."""
    end_m: float
    """Distance from the true place at the end; the start is given."""
    inside_3sigma: float
    """Share of the frames at which the true place is in the ellipse of three sigma; NaN where
    the estimate does not say how sure it is."""


def score_drive(estimate: Trajectory, truth: Trajectory) -> DriveScore:
    """Compare poses with the truth at their times.

    Args:
        estimate: n poses.
        truth: with headings, in the same frame; times between its own are interpolated.
    """
    there = truth.at(estimate.time)
    apart = estimate.pose[:, :2] - there[:, :2]
    steps, true_steps = (steps_between(each)[:, :2] for each in (estimate.pose, there))
    missed = np.hypot(*(steps - true_steps).T) if len(steps) else np.full(1, np.nan)
    return DriveScore(
        ate_m=position_rmse(Trajectory(estimate.time, estimate.pose), truth),
        rpe_m=float(np.sqrt(np.square(missed).mean())),
        end_m=float(np.hypot(*apart[-1])),
        inside_3sigma=_inside(apart, estimate.covariance),
    )


def same_places(
    frame: IntArray, landmark: IntArray, z: FloatArray, sigma: FloatArray, poses: FloatArray
) -> npt.NDArray[np.bool_]:
    """Whether each sighting is of the place that its landmark was first seen at.

    The truth says where the robot was, the sighting where it saw something from there.

    Args:
        frame: (k,) in the order of the frames.
        landmark: (k,) numbers.
        z: (k, 2) range and bearing.
        sigma: (k, 2) their deviations.
        poses: (n, 3) true poses of the frames.

    Returns:
        (k,) true where the two are as near as their deviations allow: along the line of sight that
        of the range, which of far points is large, and across it that of the bearing.
    """
    here = poses[frame]
    beta = here[:, 2] + z[:, 1]
    ray = np.stack([np.cos(beta), np.sin(beta)], 1)
    place = here[:, :2] + z[:, :1] * ray
    across = np.stack([-ray[:, 1], ray[:, 0]], 1)
    axes = np.stack([ray * sigma[:, :1], across * z[:, :1] * sigma[:, 1:]], 1)
    spread = axes.transpose(0, 2, 1) @ axes
    _, first, which = np.unique(landmark, return_index=True, return_inverse=True)
    alike = SAME_PLACE * (1 + z[:, 0] / 10) / np.sqrt(THREE_SIGMA_2D)
    spread = spread + spread[first][which] + np.square(alike)[:, None, None] * np.eye(2)
    return _are_within(place - place[first][which], spread)


def _inside(apart: FloatArray, covariance: FloatArray | None) -> float:
    if covariance is None or len(apart) < 2:
        return float("nan")
    spread = covariance[1:, :2, :2] + 1e-12 * np.eye(2)  # the first pose is given
    return float(_are_within(apart[1:], spread).mean())


def _are_within(apart: FloatArray, spread: FloatArray) -> npt.NDArray[np.bool_]:
    """(n,) whether what is apart by (n, 2) is inside three sigma of covariances (n, 2, 2)."""
    return np.asarray(
        (apart * np.linalg.solve(spread, apart[..., None])[..., 0]).sum(1) < THREE_SIGMA_2D
    )
