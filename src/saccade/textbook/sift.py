"""The Scale-Invariant Feature Transform, equation by equation (appendix B).

Arrays are [row, column], points (x, y); angles run from x towards y. A pixel of an octave spans 2
** octave pixels of the image. Copy this file, change an equation, and run it:

    >>> y, x = np.mgrid[:64, :64]
    >>> result = sift(np.exp(-((x - 30) ** 2 + (y - 24) ** 2) / (2 * 3.0**2)))
    >>> [(c.octave, c.i, c.row, c.column) for c in result.candidates if c.status == "kept"]
    [(0, 2, 24, 30)]
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np
from scipy.ndimage import convolve1d, map_coordinates, maximum_filter, minimum_filter

from saccade.errors import ImageError
from saccade.io.image import as_gray
from saccade.types import FloatArray, Image, Keypoints

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
    """(3,) xhat of B.5 in samples, in the order x, y, sigma; NaN if undefined."""
    value: float
    """D(xhat) of B.6; NaN without xhat."""
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


S = 3
"""Intervals per octave."""
OCTAVES = 3
"""Maximum number of octaves."""
TAU_C = 0.02
"""Minimum contrast of an interest point."""
TAU_R = 10.0
"""Maximum ratio of the principal curvatures (B.10)."""
K = 2 ** (1 / S)

# Choices that the source leaves open:
BASE_SIGMA = 1.6
"""Scale of an octave's first image, as Lowe's; the input is neither doubled nor assumed blurred."""
BORDER: Literal["mirror"] = "mirror"
"""Mirrored about its outermost samples, an image filtered in steps is as if filtered at once."""
FIRST_SAMPLE = 0
"""Down-sampling keeps samples 0, 2, 4, ..., as appendix A does: coordinates halve exactly."""
SMALLEST_SIDE = 3
"""Minimum side of an octave in pixels, for samples with 26 neighbors."""
OUTSIDE = 0.0
"""Magnitude of gradients that need samples outside the image."""
ORIENTATION_REACH = 3.0
"""Radius of the orientation window in sigma: the source truncates to 6 sigma x 6 sigma."""
ORIENTATION_BIN_CENTER = 0.0
"""Center of bin 0, in bins: bin b of 36 is centered on 10 b degrees, as in the descriptor."""
PARABOLA_REACH = 0.5
"""Maximum offset of a parabola's peak, in bins, since a bin over 80 % may not be a peak."""
SAMPLE_SPACING = 0.75
"""Sample spacing in sigma: the 4 samples of a subregion span 3 sigma, as in Lowe's SIFT."""
DESCRIPTOR_BIN_CENTER = 0.0
"""Center of bin 0, in bins: the dominant orientation falls on the center of a bin."""
INTERPOLATION_REACH = 1.0
"""Support of the interpolation in bin spacings; weights fall linearly, since 1 / distance
diverges."""


def sift(image: Image) -> SiftResult:
    """Interest points and descriptors; raises `ImageError` below 3 x 3 pixels."""
    L = build_scale_space(as_gray(image).astype(np.float64))  # B.2, B.3
    D = tuple(differences(octave) for octave in L)  # B.1
    candidates = tuple(  # B.4-B.10
        localize(D[o], o, *sample) for o in range(len(D)) for sample in find_extrema(D[o])
    )
    gradient_images = [[gradients(each) for each in octave] for octave in L]  # B.11, B.12
    descriptions = []
    for index, c in enumerate(candidates):
        if c.status == "kept":
            x, y, i_hat = np.add(c.offset, (c.column, c.row, c.i))
            sigma = BASE_SIGMA * K**i_hat  # sigma of the lower L in B.1
            closest = round(float(np.clip(i_hat, 0, S + 2)))  # L of its octave, by ratio of scales
            histogram = orientation_histogram(*gradient_images[c.octave][closest], x, y, sigma)
            for angle in dominant_orientations(histogram):
                described = descriptor(L[c.octave][closest], x, y, sigma, angle)
                descriptions.append(replace(described, candidate=index, histogram=histogram))
    descriptions.sort(key=lambda d: -abs(candidates[d.candidate].value))
    return SiftResult(to_keypoints(descriptions, candidates), candidates, L, D, tuple(descriptions))


def build_scale_space(gray: FloatArray) -> tuple[tuple[FloatArray, ...], ...]:
    """L(x, y, sigma): s + 3 images per octave, each filtered from the previous image."""
    if min(gray.shape) < SMALLEST_SIDE:
        height, width = gray.shape
        raise ImageError(f"image: expected at least 3 x 3 pixels, found {width} x {height}")
    L: list[tuple[FloatArray, ...]] = []
    first = smooth(gray, BASE_SIGMA)
    while len(L) < OCTAVES and min(first.shape) >= SMALLEST_SIDE:
        octave = [first]
        for sigma, k_sigma in pairwise(BASE_SIGMA * K ** np.arange(S + 3)):
            octave.append(smooth(octave[-1], np.sqrt(k_sigma**2 - sigma**2)))
        L.append(tuple(octave))
        first = octave[S][FIRST_SAMPLE::2, FIRST_SAMPLE::2]  # twice the first sigma, half the size
    return tuple(L)


def differences(octave: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    """D(x, y, sigma): s + 2 images per octave."""
    return tuple(L_k_sigma - L_sigma for L_sigma, L_k_sigma in pairwise(octave))  # B.1


def smooth(image: FloatArray, sigma: float) -> FloatArray:
    """G * I: a horizontal pass, then a vertical one."""
    G = gaussian_kernel(sigma)
    return convolve1d(convolve1d(image, G, axis=1, mode=BORDER), G, axis=0, mode=BORDER)  # B.2


def gaussian_kernel(sigma: float) -> FloatArray:
    """One axis of G, cut to 6 sigma, rounded up; normalized to the sum 1."""
    x = np.arange(-np.ceil(3 * sigma), np.ceil(3 * sigma) + 1)
    G = np.exp(-(x**2) / (2 * sigma**2)) / (np.sqrt(2 * np.pi) * sigma)  # B.3
    kernel: FloatArray = G / G.sum()
    return kernel


def find_extrema(D: tuple[FloatArray, ...]) -> list[tuple[int, int, int]]:
    """Samples (i, row, column) above, or below, each of their 26 neighbors."""
    cube = np.stack(D)
    others = np.ones((3, 3, 3), bool)
    others[1, 1, 1] = False
    above = cube > maximum_filter(cube, footprint=others)
    below = cube < minimum_filter(cube, footprint=others)
    extrema = np.argwhere((above | below)[1:-1, 1:-1, 1:-1]) + 1
    return [(int(i), int(row), int(column)) for i, row, column in extrema]


def localize(D: tuple[FloatArray, ...], octave: int, i: int, row: int, column: int) -> Candidate:
    """Re-estimate an extremum, and test it; "unstable" is no xhat, or one outside of D."""
    gradient, hessian = gradient_and_hessian(D, i, row, column)
    xhat = refine(gradient, hessian)
    value = value_at(D[i][row, column], gradient, xhat)
    ratio = curvature_ratio(hessian)
    where = np.add(xhat, (column, row, i))
    last = (D[i].shape[1] - 1, D[i].shape[0] - 1, len(D) - 1)
    status: Status = "kept"
    if not np.all((where >= 0) & (where <= last)):
        status = "unstable"
    elif abs(value) < TAU_C:
        status = "low contrast"
    elif not ratio < (TAU_R + 1) ** 2 / TAU_R:  # B.10
        status = "edge"
    return Candidate(octave, i, row, column, xhat, value, ratio, status)


def gradient_and_hessian(
    D: tuple[FloatArray, ...], i: int, row: int, column: int
) -> tuple[FloatArray, FloatArray]:
    """dD/dx (3,) and d2D/dx2 (3, 3) in the order x, y, sigma, by differences of neighbors."""

    def d(x: int = 0, y: int = 0, s: int = 0) -> float:
        return float(D[i + s][row + y, column + x])

    gradient = np.array([d(x=1) - d(x=-1), d(y=1) - d(y=-1), d(s=1) - d(s=-1)]) / 2
    Dxx = d(x=-1) + d(x=1) - 2 * d()  # B.8
    Dyy = d(y=-1) + d(y=1) - 2 * d()
    Dss = d(s=-1) + d(s=1) - 2 * d()
    Dxy = (d(x=-1, y=-1) + d(x=1, y=1) - d(x=-1, y=1) - d(x=1, y=-1)) / 4  # B.9
    Dxs = (d(x=-1, s=-1) + d(x=1, s=1) - d(x=-1, s=1) - d(x=1, s=-1)) / 4
    Dys = (d(y=-1, s=-1) + d(y=1, s=1) - d(y=-1, s=1) - d(y=1, s=-1)) / 4
    return gradient, np.array([[Dxx, Dxy, Dxs], [Dxy, Dyy, Dys], [Dxs, Dys, Dss]])


def taylor(D: float, gradient: FloatArray, hessian: FloatArray, x: FloatArray) -> float:
    """D at x = (x, y, sigma) from the sample, to the quadratic term."""
    return float(D + gradient @ x + x @ hessian @ x / 2)  # B.4


def refine(gradient: FloatArray, hessian: FloatArray) -> FloatArray:
    """The (3,) xhat where B.4 is level; NaN if the Hessian is singular."""
    try:
        xhat: FloatArray = -np.linalg.inv(hessian) @ gradient  # B.5
    except np.linalg.LinAlgError:
        return np.full(3, np.nan)
    return xhat


def value_at(D: float, gradient: FloatArray, xhat: FloatArray) -> float:
    """D(xhat), the contrast of the point: B.4 at B.5.

    >>> gradient, hessian = np.array([0.1, 0, 0]), -np.eye(3)
    >>> xhat = refine(gradient, hessian)
    >>> round(value_at(1, gradient, xhat), 6), round(taylor(1, gradient, hessian, xhat), 6)
    (1.005, 1.005)
    """
    return float(D + gradient @ xhat / 2)  # B.6


def curvature_ratio(hessian: FloatArray) -> float:
    """Tr(H)^2 / Det(H), the left side of B.10; infinite at a saddle, where Det(H) <= 0."""
    (Dxx, Dxy), (_, Dyy) = hessian[:2, :2]  # B.7
    det = Dxx * Dyy - Dxy**2
    return float((Dxx + Dyy) ** 2 / det) if det > 0 else np.inf


def gradients(L: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The m and theta at every sample of L, each (H, W)."""
    columns, rows = (np.arange(n, dtype=np.float64) for n in L.shape[::-1])
    return gradient_at(L, *np.meshgrid(columns, rows))


def gradient_at(L: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The m and theta at points (x, y) that need not be whole: L is bilinear between samples."""

    def at(x: FloatArray, y: FloatArray) -> FloatArray:
        return map_coordinates(L, (y, x), order=1)

    dx = at(x + 1, y) - at(x - 1, y)
    dy = at(x, y + 1) - at(x, y - 1)
    inside = (x >= 1) & (x <= L.shape[1] - 2) & (y >= 1) & (y <= L.shape[0] - 2)
    m = np.where(inside, np.sqrt(dx**2 + dy**2), OUTSIDE)  # B.11
    theta = np.arctan2(dy, dx)  # B.12
    return m, theta


def orientation_histogram(
    m: FloatArray, theta: FloatArray, x: float, y: float, sigma: float
) -> FloatArray:
    """(36,) orientations around a point: m times a Gaussian of 1.5 sigma, a vote for one bin."""
    reach = ORIENTATION_REACH * 1.5 * sigma
    rows, columns = np.arange(m.shape[0]), np.arange(m.shape[1])
    near = np.ix_(rows[abs(rows - y) <= reach], columns[abs(columns - x) <= reach])
    squared_distance = (near[1] - x) ** 2 + (near[0] - y) ** 2
    weighted = m[near] * np.exp(-squared_distance / (2 * (1.5 * sigma) ** 2))
    bins = np.floor(theta[near] / (2 * np.pi / 36) + 0.5 - ORIENTATION_BIN_CENTER).astype(int) % 36
    return np.bincount(bins.ravel(), weighted.ravel(), 36).astype(np.float64)


def dominant_orientations(histogram: FloatArray) -> list[float]:
    """Angles of the highest bin and of every bin over 80 % of it; none where all are empty."""
    angles = []
    for b in np.flatnonzero(histogram > 0.8 * histogram.max()):
        left, middle, right = histogram[[b - 1, b, (b + 1) % 36]]
        bend = left - 2 * middle + right
        top = (left - right) / (2 * bend) if bend < 0 else np.sign(right - left)
        top = np.clip(top, -PARABOLA_REACH, PARABOLA_REACH)
        angles.append(float(wrap((b + ORIENTATION_BIN_CENTER + top) * 2 * np.pi / 36)))
    return angles


def sample_grid(x: float, y: float, sigma: float, angle: float) -> FloatArray:
    """(16, 16, 2) sample points (x, y): 4 x 4 subregions of 4 x 4, turned by `angle`."""
    v, u = (np.mgrid[:16, :16] - 7.5) * SAMPLE_SPACING * sigma
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([x + u * cos - v * sin, y + u * sin + v * cos], axis=-1)


def descriptor(L: FloatArray, x: float, y: float, sigma: float, angle: float) -> Description:
    """The neighborhood of a point in 4 x 4 histograms of 8 orientations, relative to `angle`."""
    grid = sample_grid(x, y, sigma, angle)
    m, theta = gradient_at(L, grid[..., 0], grid[..., 1])
    theta = wrap(theta - angle)
    step = np.arange(16) - 7.5  # in samples from the point
    weights = np.exp(-np.add.outer(step**2, step**2) / (2 * (1.5 * 16) ** 2))
    across = np.subtract.outer(step, 4 * np.arange(4) - 6) / 4  # (16, 4), from subregions' centers
    distance = np.hypot(across[:, None, :, None], across[None, :, None, :])  # (16, 16, 4, 4)
    centers = (np.arange(8) + DESCRIPTOR_BIN_CENTER) * np.pi / 4
    turn = np.abs(wrap(theta[..., None] - centers)) / (np.pi / 4)  # (16, 16, 8)
    parts = interpolation_weight(distance), interpolation_weight(turn)
    subregions = np.einsum("rc,rcij,rcb->ijb", m * weights, *parts)
    vector = unit(np.minimum(unit(subregions.ravel()), 0.2))
    return Description(x, y, sigma, angle, grid, m, theta, weights, subregions, vector)


def interpolation_weight(distance: FloatArray) -> FloatArray:
    """Linear interpolation weight of a gradient at a distance from a histogram or bin."""
    return np.maximum(0, 1 - distance / INTERPOLATION_REACH)


def unit(vector: FloatArray) -> FloatArray:
    """The vector at unit length; zero stays zero."""
    length = np.linalg.norm(vector)
    return vector / length if length > 0 else vector


def wrap(angle: FloatArray) -> FloatArray:
    """Angle wrapped to (-pi, pi]."""
    return np.pi - (np.pi - angle) % (2 * np.pi)
