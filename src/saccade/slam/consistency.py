"""Filter consistency: NIS, NEES and their chi-square bands.

After Bar-Shalom, Li & Kirubarajan (2001), section 5.4.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.special import chdtri

from saccade.errors import LogError, require
from saccade.slam.filter._kernels import NEGLIGIBLE_VARIANCE
from saccade.slam.filter.robot_models import wrap
from saccade.slam.filter.state import Errors
from saccade.types import FloatArray, IntArray, Trajectory

REGULAR = 1e-6
"""Smallest eigenvalue of the correlation matrix of a regular covariance."""

MIN_WHITENED_INNOVATIONS = 20
"""Minimum number of innovations for a warning or a remark."""
TOLERATED_FRACTION = 1.5
"""Largest factor between innovations and noise without a warning or a remark."""
WRONG_FRACTION = 0.1
"""Largest fraction of outliers, and of rejected labels, without a warning."""


@dataclass(frozen=True, eq=False, repr=False)
class Consistency:
    """Normalized innovations squared of a run, against the chi-square distribution."""

    nis: FloatArray
    """(k,) of each observation; NaN where it updated nothing (a new landmark, or not used)."""
    dof: int
    """Degrees of freedom of one innovation: the expected mean."""
    mean: float
    """Mean NIS; NaN without any."""
    band: tuple[float, float]
    """95 % band of the mean of a consistent filter."""
    inside: float
    """Fraction of the innovations within the 95 % band of a single one; NaN without any."""
    rejected: float = 0.0
    """Fraction of the observations whose label contradicted the map and was rejected."""

    @property
    def warning(self) -> str:
        """Errors of the model that the innovations indicate; empty if there are none.

        The median innovation measures the noise robustly; innovations far outside are outliers.
        """
        found = []
        if self.rejected > WRONG_FRACTION:
            found.append(f"{self.rejected:.1%} of the labels contradict the map and were rejected")
        if self._count < MIN_WHITENED_INNOVATIONS:
            return "; ".join(found)
        if self._factor > TOLERATED_FRACTION:
            found.append(
                f"the innovations are {self._factor:.1f} times as large as the noise of the log "
                "predicts"
            )
        elif self._impossible.mean() > WRONG_FRACTION:
            found.append(
                f"{self._impossible.mean():.1%} of the observations are impossible while the "
                "others fit their noise: outliers of the sensor or wrong associations"
            )
        return "; ".join(found)

    @property
    def verdict(self) -> str:
        """Whether the innovations fit their covariances; empty with few observations."""
        if self._count < MIN_WHITENED_INNOVATIONS:
            return ""
        name = "consistent"
        if self._factor > TOLERATED_FRACTION:
            name = "overconfident"
        elif self._factor < 1 / TOLERATED_FRACTION:
            name = "conservative"
        return f"{name}: innovations {self._factor:.2f} times as large as predicted"

    @property
    def remark(self) -> str:
        """Signs of a conservative filter and of few outliers; empty if there are none."""
        found = []
        if 0 < self.rejected <= WRONG_FRACTION:
            found.append(f"{self.rejected:.2%} of the labels contradict the map: rejected")
        if self._count < MIN_WHITENED_INNOVATIONS:
            return "; ".join(found)
        if self._factor < 1 / TOLERATED_FRACTION:
            found.append(
                "the noise of the log is conservative: the innovations are "
                f"{self._factor:.2f} times as large as it predicts"
            )
        wrong = self._impossible
        if 0 < wrong.mean() <= WRONG_FRACTION and self.mean > self.band[1]:
            rest = float(self._used[~wrong].mean())
            found.append(
                f"{wrong.sum()} of {self._count} observations are impossible and count less, the "
                f"mean NIS of the others is {rest:.2f}"
            )
        return "; ".join(found)

    @property
    def _used(self) -> FloatArray:
        return self.nis[np.isfinite(self.nis)]

    @property
    def _count(self) -> int:
        return len(self._used)

    @property
    def _factor(self) -> float:
        return float(np.sqrt(np.median(self._used) / chi_square_gate(self.dof, 0.5)))

    @property
    def _impossible(self) -> npt.NDArray[np.bool_]:
        return self._used > chi_square_gate(self.dof, 0.9999)

    def __repr__(self) -> str:
        low, high = self.band
        return f"Consistency(NIS {self.mean:.2f}, band {low:.2f}-{high:.2f}, {self.inside:.1%} in)"


def normalized_squared(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """e^T C^-1 e: the NIS of innovations, or the NEES of errors of the state.

    Args:
        error: (..., d); angles already wrapped.
        covariance: (..., d, d), positive definite.

    Returns:
        (...,) values, chi-square with d degrees of freedom if the covariance is right.
    """
    solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    return np.asarray((error * solved).sum(-1))


def difference_covariances(C: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
    """(..., 2, 2) of the differences of points i (...) and j (...), from all, C (2 n, 2 n)."""
    n = len(C) // 2
    blocks = C.reshape(n, 2, n, 2).transpose(0, 2, 1, 3)
    cross = blocks[i, j]
    return np.asarray(blocks[i, i] + blocks[j, j] - cross - cross.swapaxes(-1, -2))


def pose_nees(estimate: Trajectory, truth: Trajectory, errors: Errors) -> FloatArray:
    """NEES of the poses of a trajectory, in the filter's error parametrization.

    Args:
        estimate: (t) poses with covariance.
        truth: the true poses at the same times.
        errors: the filter's error parametrization; the error of the invariant one is that
            whose exponential moves the estimate to the truth.

    Returns:
        (t,) values, chi-square with three degrees if the filter is consistent; NaN where
        the covariance is singular.
    """
    if estimate.covariance is None:
        raise LogError("estimate: expected a trajectory with covariance, found one without")
    error, C = truth.pose - estimate.pose, estimate.covariance
    error[:, 2] = wrap(error[:, 2])
    if errors == "invariant":  # xi, in the coordinates of the covariance
        x, y = estimate.pose[:, 0], estimate.pose[:, 1]
        rotation = error[:, 2:] * np.stack([-y, x], 1)
        error[:, :2] = (
            invariant_translation(estimate.pose, truth.pose[:, :2], error[:, 2]) + rotation
        )
    return regular_nees(error, C)


def regular_nees(error: FloatArray, C: FloatArray) -> FloatArray:
    """(n,) NEES of errors (n, d) with covariances C (n, d, d); NaN where C is singular."""
    scale = np.sqrt(np.maximum(C.diagonal(0, 1, 2), NEGLIGIBLE_VARIANCE))
    correlation = C / (scale[:, :, None] * scale[:, None, :])
    regular = np.linalg.eigvalsh(correlation)[:, 0] > REGULAR
    nees = np.full(len(error), np.nan)
    nees[regular] = normalized_squared((error / scale)[regular], correlation[regular])
    return nees


def invariant_translation(pose: FloatArray, xy: FloatArray, turn: FloatArray) -> FloatArray:
    """The translation xi (t, 2) whose exponential, with a turn (t,), moves the pose to xy."""
    c, s = np.cos(turn), np.sin(turn)
    x = xy[:, 0] - c * pose[:, 0] + s * pose[:, 1]
    y = xy[:, 1] - s * pose[:, 0] - c * pose[:, 1]
    half = turn / 2
    h = np.cos(half) / np.sinc(half / np.pi)  # half / tan(half)
    return np.stack([h * x + half * y, h * y - half * x], 1)


@cache
def chi_square_gate(dof: int, confidence: float) -> float:
    """The `confidence` quantile of the chi-square distribution with `dof` degrees of freedom."""
    require(0 < confidence < 1, "confidence", "a probability between 0 and 1", confidence)
    return float(chdtri(dof, 1 - confidence))


def chi_square_band(dof: int, count: int = 1, confidence: float = 0.95) -> tuple[float, float]:
    """Band of the mean of `count` independent chi-square variables.

    Args:
        dof: degrees of freedom of each.
        count: number of averaged variables.
        confidence: probability of the band, with equal tails.

    Returns:
        Its lower and upper end.
    """
    require(count > 0, "count", "at least 1", count)
    tail = (1 - confidence) / 2
    low, high = chi_square_gate(dof * count, tail), chi_square_gate(dof * count, 1 - tail)
    return low / count, high / count


def summarize(nis: FloatArray, dof: int = 2, rejected: float = 0.0) -> Consistency:
    """Consistency of a run by its NIS, NaN where an observation updated nothing.

    Args:
        nis: (k,) of each observation.
        dof: degrees of freedom of one innovation.
        rejected: fraction of the observations whose label was rejected.
    """
    used = nis[np.isfinite(nis)]
    low, high = chi_square_band(dof)
    inside = (used >= low) & (used <= high)
    return Consistency(
        nis=nis,
        dof=dof,
        mean=float(used.mean()) if len(used) else float("nan"),
        band=chi_square_band(dof, max(len(used), 1)),
        inside=float(inside.mean()) if len(used) else float("nan"),
        rejected=rejected,
    )
