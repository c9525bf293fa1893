"""The result of `saccade.textbook.sift`: interest points and all intermediate results."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from saccade.types import FloatArray, Keypoints

Status: TypeAlias = Literal["kept", "low contrast", "edge", "unstable"]


@dataclass(frozen=True, eq=False)
class Candidate:
    """An extremum of the differences of Gaussians, and the result of its tests."""

    octave: int
    """The octave whose differences hold it; 0 is the image itself."""
    i: int
    """Index of the difference within the octave, from 1 to s."""
    row: int
    """Row of the sample in it."""
    column: int
    """Column of the sample in it."""
    offset: FloatArray
    """(3,) xhat of B.5 in samples, in the order x, y, sigma; NaN where there is none."""
    value: float
    """D(xhat) of B.6; NaN where there is no xhat."""
    curvature_ratio: float
    """Tr(H)^2 / Det(H) of B.10; infinite where Det(H) is not positive."""
    status: Status
    """The first test that it failed, in the order unstable, low contrast, edge; or "kept"."""


@dataclass(frozen=True, eq=False)
class Description:
    """A point with one dominant orientation; coordinates and scale in pixels of its octave."""

    x: float
    """Re-estimated column."""
    y: float
    """Re-estimated row."""
    sigma: float
    """Re-estimated scale."""
    angle: float
    """The dominant orientation in radians, from x towards y."""
    grid: FloatArray
    """(16, 16, 2) sample points (x, y) of a grid rotated by `angle`."""
    magnitudes: FloatArray
    """(16, 16) m of B.11 at the sample points."""
    orientations: FloatArray
    """(16, 16) theta of B.12 less `angle`, in radians."""
    weights: FloatArray
    """(16, 16) Gaussian of the distance to the point."""
    subregions: FloatArray
    """(4, 4, 8) histograms before they are normalized: row, column, bin."""
    vector: FloatArray
    """(128,) the same in that order, normalized: the descriptor."""
    candidate: int = -1
    """Index in `SiftResult.candidates`; -1 if computed for a point alone."""
    histogram: FloatArray | None = None
    """(36,) orientations around the point; None if computed for a point alone."""


@dataclass(frozen=True, eq=False, repr=False)
class SiftResult:
    """Interest points and all intermediate results."""

    keypoints: Keypoints
    """Strongest first, in image pixels; `response` is abs(D(xhat)), `size` twice sigma, and
    `descriptors` are float32 of unit length."""
    candidates: tuple[Candidate, ...]
    """All extrema, kept or not, by octave, scale, row and column."""
    scale_space: tuple[tuple[FloatArray, ...], ...]
    """L: `[octave][i]`, s + 3 images per octave, of scale BASE_SIGMA * K ** i in its pixels."""
    differences: tuple[tuple[FloatArray, ...], ...]
    """D: `[octave][i]`, s + 2 images per octave, each at the scale of the finer of its two."""
    descriptions: tuple[Description, ...]
    """One for each keypoint, in their order."""

    def __repr__(self) -> str:
        return f"SiftResult({len(self.keypoints)} keypoints of {len(self.candidates)} candidates)"


def to_keypoints(descriptions: list[Description], candidates: tuple[Candidate, ...]) -> Keypoints:
    """The points in image pixels, the bins of their descriptors in the order of `Keypoints`."""
    origin = [candidates[d.candidate] for d in descriptions]
    octave = np.array([c.octave for c in origin], np.int32)
    x_y_sigma = np.array([(d.x, d.y, d.sigma) for d in descriptions]).reshape(-1, 3)
    x_y_sigma *= 2.0 ** octave[:, None]
    vectors = np.array([d.vector for d in descriptions], np.float32).reshape(-1, 16, 8)
    return Keypoints(
        xy=x_y_sigma[:, :2].astype(np.float32),
        size=(2 * x_y_sigma[:, 2]).astype(np.float32),
        angle=np.array([d.angle for d in descriptions], np.float32),
        response=np.array([abs(c.value) for c in origin], np.float32),
        octave=octave,
        descriptors=vectors[:, :, -np.arange(8)].reshape(-1, 128),
    )
