"""Whether a filter's errors are as large as it says: NIS, NEES and their bands.

After Bar-Shalom, Li & Kirubarajan (2001), section 5.4.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.special import chdtri

from saccade.errors import LogError, require
from saccade.slam.filter._kernels import TINY
from saccade.slam.filter.error_state import INVARIANT, Retraction
from saccade.slam.models import wrap
from saccade.types import FloatArray, Trajectory

REGULAR = 1e-6
"""Smallest eigenvalue of the correlations of a covariance that counts as regular."""

MIN_OBSERVATIONS = 20
"""Innovations that say something about a model."""
TOLERATED_FRACTION = 1.5
"""Factor by which deviations may be wrong before it is worth a word."""
WRONG_FRACTION = 0.005
"""Share of observations that may be wrong before it is worth a warning."""


@dataclass(frozen=True, eq=False, repr=False)
class Consistency:
    """Normalized innovations squared of a run, against the chi-square distribution."""

    nis: FloatArray
    """(k,) of each observation; NaN where it corrected nothing (a new landmark, or not used)."""
    dof: int
    """Degrees of freedom of one innovation: the mean that a consistent filter has."""
    mean: float
    """Of the observations that corrected; NaN if there were none."""
    band: tuple[float, float]
    """Where the mean of a consistent filter lies, with 95 % probability."""
    inside: float
    """Share of the innovations within the 95 % band of a single one; NaN if there were none."""

    @property
    def warning(self) -> str:
        """What the innovations say against the model, in a sentence; empty if nothing.

        Of a filter that is surer than it may be. The median tells of the noise, whatever wrong
        observations there are; how many are far out tells of those.
        """
        if self._count < MIN_OBSERVATIONS:
            return ""
        found = []
        if self._factor > TOLERATED_FRACTION:
            found.append(f"the innovations are {self._factor:.1f} times as large as it lets expect")
        if self._impossible.mean() > WRONG_FRACTION:
            found.append(f"{self._impossible.mean():.1%} of the observations are impossible")
        return f"the model is wrong: {', '.join(found)}; see --tune" if found else ""

    @property
    def remark(self) -> str:
        """What is worth knowing of the innovations though no harm is done; empty if nothing."""
        if self._count < MIN_OBSERVATIONS:
            return ""
        found = []
        if self._factor < 1 / TOLERATED_FRACTION:
            found.append(
                f"the noise of the log is cautious, the innovations are {self._factor:.2f} of what "
                "it lets expect; --tune finds one that fits"
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


def pose_nees(estimate: Trajectory, truth: Trajectory, retraction: Retraction) -> FloatArray:
    """NEES of the poses of a trajectory, in the coordinates in which its filter measures errors.

    Args:
        estimate: (t) poses with covariance.
        truth: the true poses at the same times.
        retraction: the filter's; the error of the invariant one is that whose exponential
            takes the estimate to the truth.

    Returns:
        (t,) values, chi-square with three degrees if the filter is consistent; NaN where
        the covariance is singular.
    """
    if estimate.covariance is None:
        raise LogError("estimate: expected a trajectory with covariance, found one without")
    error, C = truth.pose - estimate.pose, estimate.covariance
    error[:, 2] = wrap(error[:, 2])
    if retraction == INVARIANT:  # xi, in the coordinates of the covariance
        x, y = estimate.pose[:, 0], estimate.pose[:, 1]
        swing = error[:, 2:] * np.stack([-y, x], 1)
        error[:, :2] = _shift(estimate.pose, truth.pose[:, :2], error[:, 2]) + swing
    scale = np.sqrt(np.maximum(C.diagonal(0, 1, 2), TINY))
    correlation = C / (scale[:, :, None] * scale[:, None, :])
    regular = np.linalg.eigvalsh(correlation)[:, 0] > REGULAR
    nees = np.full(len(error), np.nan)
    nees[regular] = normalized_squared((error / scale)[regular], correlation[regular])
    return nees


def _shift(pose: FloatArray, xy: FloatArray, turn: FloatArray) -> FloatArray:
    """The xi (t, 2) whose exponential, with a turn (t,), takes the pose to xy."""
    c, s = np.cos(turn), np.sin(turn)
    x = xy[:, 0] - c * pose[:, 0] + s * pose[:, 1]
    y = xy[:, 1] - s * pose[:, 0] - c * pose[:, 1]
    half = turn / 2
    h = np.cos(half) / np.sinc(half / np.pi)  # half / tan(half)
    return np.stack([h * x + half * y, h * y - half * x], 1)


@cache
def chi_square_gate(dof: int, confidence: float) -> float:
    """The value under which a chi-square variable of `dof` degrees stays with `confidence`."""
    require(0 < confidence < 1, "confidence", "a probability between 0 and 1", confidence)
    return float(chdtri(dof, 1 - confidence))


def chi_square_band(dof: int, count: int = 1, confidence: float = 0.95) -> tuple[float, float]:
    """Where the mean of `count` independent chi-square variables lies with `confidence`.

    Args:
        dof: degrees of freedom of each.
        count: how many are averaged.
        confidence: probability of the band, which leaves out as much below as above.

    Returns:
        Its lower and upper end.
    """
    require(count > 0, "count", "at least 1", count)
    tail = (1 - confidence) / 2
    low, high = chi_square_gate(dof * count, tail), chi_square_gate(dof * count, 1 - tail)
    return low / count, high / count


def summarize(nis: FloatArray, dof: int = 2) -> Consistency:
    """The NIS of a run, NaN where an observation corrected nothing, in a few numbers."""
    used = nis[np.isfinite(nis)]
    low, high = chi_square_band(dof)
    inside = (used >= low) & (used <= high)
    return Consistency(
        nis=nis,
        dof=dof,
        mean=float(used.mean()) if len(used) else float("nan"),
        band=chi_square_band(dof, max(len(used), 1)),
        inside=float(inside.mean()) if len(used) else float("nan"),
    )
