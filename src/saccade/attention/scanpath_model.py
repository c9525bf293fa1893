"""Stochastic scanpaths: the probability of the next fixation, and samples of it.

The next fixation is drawn from the cells of a saliency map with the probability

    p(x | x_1 ... x_n)  ~  (S(x) + floor)^exponent  C(x)  K(x - x_n)  prod_k (1 - I_k(x))

where C is a Gaussian about the center of the image, K the kernel of the saccade and I_k the
decaying inhibition of return by the k-th fixation:

    K(d, theta, phi)  ~  (1 + d^2 / s^2)^-nu  (1 + h cos 2 theta)  (1 + p cos phi)
    I_k(x)  =  a r^(n - k) exp(-|x - x_k|^2 / (2 sigma^2))

with the amplitude d of the saccade, its direction theta from the horizontal, and the turning angle
phi relative to the previous saccade. The kernel is a constrained Levy flight: heavy tails of the
amplitude as in Boccignone & Ferraro (2004), *Modelling gaze shift as a constrained random walk*;
the product of saliency, a window around the gaze and inhibition by past fixations follows SceneWalk
(Engbert, Trukenbrod, Barthelme & Wichmann 2015, *Spatial statistics and attentional dynamics in
scene viewing*). Fixation durations are gamma distributed.
"""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention._scanpath_model_kernels import (
    Dynamics,
    Grid,
    draw_paths,
    fill_density,
)
from saccade.attention.maps import SaliencyMaps
from saccade.attention.normalize import position_prior
from saccade.attention.scanpath import checked_map
from saccade.errors import ImageError, Settings, require, setting
from saccade.scale.pyramid import cell_centers, resize
from saccade.types import FloatArray, IntArray, Scanpath, ScanpathSamples

BEAM_CELLS = 25
"""Maximum cells per side of the map in the beam search."""
MAX_REJECTIONS = 400
"""Maximum number of rejections before a fixation is drawn from the full density, which is
slower."""


@dataclass(frozen=True)
class ScanpathModelConfig(Settings):
    """Parameters of the scanpath model; lengths are fractions of the longer side of the image.

    The default was fitted by maximum likelihood to free-viewing fixations on photographs, with the
    maps of `attention_saliency`; docs/scanpaths.md has the data and the scores.
    """

    exponent: float = setting(0.99, 0, 20)
    """Exponent of the saliency, after scaling to a maximum of 1."""
    floor: float = setting(0.0022, 1e-9, 1e9)
    """Saliency added everywhere, since regions without saliency are fixated too."""
    smoothing: float = setting(0.0, 0, 1)
    """Standard deviation of the Gaussian that smooths the saliency first."""
    center_sigma: float | None = setting(0.37, 0.01, 100)
    """Standard deviation of the center bias as a fraction of each side; None for no bias."""
    center_height: float = setting(0.0, -0.5, 0.5)
    """Height of the center bias above the middle of the image, as a fraction of its height."""
    border_distance: float | None = setting(None, 0.01, 100)
    """Width of the border prior, as a fraction of each side; see
    `saccade.attention.normalize.position_prior`. None for no border prior."""
    amplitude_scale: float = setting(0.009, 1e-3, 1e3)
    """Scale of the saccade amplitude; beyond it the kernel follows a power law."""
    amplitude_exponent: float = setting(0.57, 0, 20)
    """Exponent nu of the amplitude kernel, which falls with the power -2 nu; 1.5 is a Cauchy
    distribution."""
    horizontal: float = setting(0.2, -0.99, 0.99)
    """Preference for horizontal (1) over vertical (-1) saccades."""
    persistence: float = setting(0.32, -0.99, 0.99)
    """Preference for continuing in the direction of the last saccade (1) over reversing it (-1)."""
    inhibition: float = setting(0.26, 0, 0.999)
    """Fraction by which the current fixation inhibits its own position."""
    inhibition_sigma: float = setting(0.17, 1e-3, 10)
    """Standard deviation of the Gaussian disc of inhibition."""
    inhibition_decay: float = setting(0.8, 0, 1)
    """Fraction of the inhibition that remains after another fixation."""
    duration_mean: float = setting(0.217, 1e-3, 1e3)
    """Mean duration of a fixation, in seconds."""
    duration_shape: float = setting(3.56, 1e-2, 1e4)
    """Shape parameter of the gamma distribution of durations: squared mean over variance."""

    @classmethod
    def similar(cls) -> Self:
        """Paths closer to human scanpaths by ScanMatch, but less varied than human scanpaths.

        The paths stay near the most salient regions and the center; the parameters maximize the
        similarity at the human mean amplitude. As a density of human fixations they are worse than
        the default.
        """
        return cls(
            exponent=2.25,
            floor=0.0015,
            center_sigma=0.186,
            amplitude_scale=0.012,
            amplitude_exponent=0.386,
            horizontal=0.31,
            persistence=0.36,
            inhibition=0.58,
            inhibition_sigma=0.153,
            inhibition_decay=0.97,
        )

    @classmethod
    def typical(cls) -> Self:
        """Parameters of `most_probable_scanpath`: the path most similar to human scanpaths.

        Chosen by ScanMatch at the human mean amplitude. A density with these parameters predicts
        single fixations worse than the default; docs/scanpaths.md has the scores.
        """
        return cls(
            exponent=2.73,
            floor=0.21,
            smoothing=0.06,
            center_sigma=0.25,
            center_height=0.077,
            border_distance=0.04,
            amplitude_scale=0.038,
            amplitude_exponent=0.58,
            horizontal=0.27,
            persistence=0.14,
            inhibition=0.965,
            inhibition_sigma=0.15,
            inhibition_decay=0.84,
        )

    @property
    def dynamics(self) -> Dynamics:
        """Parameters in the form required by the kernels."""
        return Dynamics(*(getattr(self, name) for name in Dynamics._fields))


def sample_scanpaths(
    maps: SaliencyMaps,
    config: ScanpathModelConfig | None = None,
    *,
    count: int = 100,
    fixations: int = 10,
    seed: int = 0,
    start: tuple[float, float] | None = None,
) -> ScanpathSamples:
    """Draws scanpaths from the model.

    Equal arguments give equal paths for any number of threads, and the first paths do not depend on
    `count`.

    Args:
        maps: result of a model, or `SaliencyMaps(saliency, image.shape)` for any other map; the
            saliency without center bias is used, since the scanpath model has its own center bias.
        config: the model.
        count: number of paths.
        fixations: number of fixations of each path.
        seed: seed of the random numbers.
        start: x and y of the initial fixation in image pixels, which is not part of the paths; None
            for the center of the image.

    Returns:
        Paths with fixations uniformly distributed within the drawn cells; time starts when the
        fixation at `start` ends.

    Raises:
        ImageError: as `saccade.scanpath`; or `start` lies outside the image.
        ConfigError: `count` or `fixations` is negative.

    Examples:
        >>> import numpy as np
        >>> maps = saccade.SaliencyMaps(np.ones((30, 40)), (600, 800))
        >>> saccade.sample_scanpaths(maps, count=3, fixations=10).xy.shape
        (3, 10, 2)
    """
    config = config or ScanpathModelConfig()
    saliency, shape = checked_map(maps.without_center_bias, maps.image_shape), maps.image_shape
    require(count >= 0, "count", "0 or more", count)
    require(fixations >= 0, "fixations", "0 or more", fixations)
    grid = _grid(saliency, shape, config)
    paths = np.empty((count, fixations + 1, 2))
    paths[:, 0] = _positions(_start(start, shape), shape)
    cells = np.zeros((count, fixations + 1), np.int64)
    rng_xy, rng_duration = (np.random.default_rng(each) for each in (seed, (seed, 1)))
    sums = np.append(grid.mass.cumsum()[:-1], 1)
    draw_paths(config.dynamics, grid, sums, rng_xy, MAX_REJECTIONS, paths, cells)
    scale = config.duration_mean / config.duration_shape
    duration = rng_duration.gamma(config.duration_shape, scale, (count, fixations + 1))
    return ScanpathSamples(
        xy=paths[:, 1:] * max(shape) - 0.5,
        time=np.cumsum(duration, axis=1)[:, :-1],
        duration=duration[:, 1:],
        saliency=saliency.ravel()[cells[:, 1:]],
    )


def most_probable_scanpath(
    maps: SaliencyMaps,
    config: ScanpathModelConfig | None = None,
    *,
    fixations: int = 10,
    beam: int = 20,
    start: tuple[float, float] | None = None,
) -> Scanpath:
    """The most probable path of the scanpath model, by beam search.

    The probability of a path is the product of its values of `next_fixation_density`, on a map of
    at most 25 cells per side. Each fixation is then moved to the most salient cell of `saliency`
    within the coarse cell.

    Args:
        maps: as for `sample_scanpaths`.
        config: the model; by default `ScanpathModelConfig.typical()`.
        fixations: number of fixations of the path.
        beam: number of paths kept after each fixation.
        start: x and y of the initial fixation in image pixels; None for the center.

    Returns:
        Fixations, with times that assume the mean duration.

    Raises:
        ImageError: as `saccade.scanpath`; or `start` lies outside the image.
        ConfigError: `fixations` is negative, or `beam` below 1.
    """
    config = config or ScanpathModelConfig.typical()
    saliency, shape = checked_map(maps.without_center_bias, maps.image_shape), maps.image_shape
    require(fixations >= 0, "fixations", "0 or more", fixations)
    require(beam >= 1, "beam", "at least 1", beam)
    reduction = -(-max(saliency.shape) // BEAM_CELLS)
    coarse = resize(
        saliency, (-(-saliency.shape[0] // reduction), -(-saliency.shape[1] // reduction))
    )
    grid = _grid(coarse, shape, config)
    centers = np.column_stack([grid.x, grid.y])
    paths = _positions(_start(start, shape), shape)[None]  # (b, k, 2)
    cells, logs = np.empty((1, 0), np.int64), np.zeros(1)
    density = np.empty(coarse.size)
    for _ in range(fixations):
        options = np.empty((len(paths), coarse.size))
        for path, row in zip(paths, options, strict=True):
            fill_density(config.dynamics, grid, path, density)
            with np.errstate(divide="ignore"):  # the density is 0 far from a narrow center bias
                np.log(density, out=row)
        options += logs[:, None]
        best = np.argsort(-options, axis=None, kind="stable")[:beam]
        former, cell = np.divmod(best, coarse.size)
        paths = np.concatenate([paths[former], centers[cell][:, None]], axis=1)
        cells, logs = np.column_stack([cells[former], cell]), options.ravel()[best]
    rows, columns = _most_salient(saliency, coarse.shape, cells[0])
    return Scanpath(
        xy=cell_centers(rows, columns, saliency.shape, shape),
        time=config.duration_mean * np.arange(1.0, fixations + 1),
        saliency=saliency[rows, columns],
    )


def next_fixation_density(
    maps: SaliencyMaps,
    xy: npt.ArrayLike,
    config: ScanpathModelConfig | None = None,
) -> FloatArray:
    """Probability that the next fixation falls in each cell of the map.

    Args:
        maps: as for `sample_scanpaths`.
        xy: (n, 2) fixations so far in image pixels, at least one; the last is the current one.
        config: the model.

    Returns:
        (h, w), with a sum of 1.

    Raises:
        ImageError: as `saccade.scanpath`; or there is no fixation, or one outside the image.
    """
    config = config or ScanpathModelConfig()
    saliency, shape = checked_map(maps.without_center_bias, maps.image_shape), maps.image_shape
    density = np.empty(saliency.size)
    fill_density(config.dynamics, _grid(saliency, shape, config), _positions(xy, shape), density)
    return density.reshape(saliency.shape)


def scanpath_log_likelihood(
    maps: SaliencyMaps,
    xy: npt.ArrayLike,
    config: ScanpathModelConfig | None = None,
    *,
    start: tuple[float, float] | None = None,
) -> FloatArray:
    """Log-likelihood of each fixation given the earlier fixations.

    Args:
        maps: as for `sample_scanpaths`.
        xy: (n, 2) fixations in image pixels.
        config: the model.
        start: x and y of the initial fixation; None for the center of the image.

    Returns:
        (n,) natural logarithms of densities per square pixel; their sum is the log-likelihood of
        the path.

    Raises:
        ImageError: as `saccade.scanpath`; or a fixation lies outside the image.
    """
    config = config or ScanpathModelConfig()
    saliency, shape = checked_map(maps.without_center_bias, maps.image_shape), maps.image_shape
    fixations = np.asarray(xy, np.float64).reshape(-1, 2)
    path = _positions(np.vstack([_start(start, shape), fixations]), shape)
    grid, density, logs = _grid(saliency, shape, config), np.empty(saliency.size), []
    for k, cell in enumerate(_cells(fixations, saliency.shape, shape), start=1):
        fill_density(config.dynamics, grid, path[:k], density)
        logs.append(np.log(density[cell]))
    pixels_per_cell = shape[0] * shape[1] / saliency.size
    return np.asarray(np.array(logs, np.float64) - np.log(pixels_per_cell))


def _grid(saliency: FloatArray, shape: tuple[int, int], config: ScanpathModelConfig) -> Grid:
    """The cells of a map with their mass: powered saliency times the center bias."""
    (h, w), side = saliency.shape, max(shape)
    u, v = (np.arange(w) + 0.5) / w, (np.arange(h) + 0.5) / h
    if config.smoothing > 0:
        cells = config.smoothing * max(h, w)
        blurred = cv2.GaussianBlur(saliency, (0, 0), cells, borderType=cv2.BORDER_REFLECT)
        saliency = np.asarray(blurred, np.float64)
    mass = (saliency / (saliency.max() or 1.0) + config.floor) ** config.exponent
    mass *= position_prior(
        (h, w), config.center_sigma, config.center_height, config.border_distance
    )
    x, y = np.meshgrid(u * shape[1] / side, v * shape[0] / side)
    return Grid(
        x=x.ravel(),
        y=y.ravel(),
        mass=(mass / mass.sum()).ravel(),
        width=shape[1] / side / w,
        height=shape[0] / side / h,
    )


def _most_salient(
    saliency: FloatArray, coarse: tuple[int, ...], cells: IntArray
) -> tuple[IntArray, IntArray]:
    """(n,) rows and columns of the most salient cell within each of (n,) cells of a coarser map."""
    (h, w), found = saliency.shape, []
    for row, column in zip(*np.divmod(cells, coarse[1]), strict=True):
        top, left = row * h // coarse[0], column * w // coarse[1]
        bottom = max((row + 1) * h // coarse[0], top + 1)
        right = max((column + 1) * w // coarse[1], left + 1)
        part = saliency[top:bottom, left:right]
        inner = np.unravel_index(int(part.argmax()), part.shape)
        found.append((top + inner[0], left + inner[1]))
    rows, columns = np.array(found, np.int64).reshape(-1, 2).T
    return rows, columns


def _start(start: tuple[float, float] | None, shape: tuple[int, int]) -> FloatArray:
    """(1, 2) initial fixation, by default the center of an image of (H, W)."""
    xy = ((shape[1] - 1) / 2, (shape[0] - 1) / 2) if start is None else start
    return np.array([xy], np.float64)


def _positions(xy: npt.ArrayLike, shape: tuple[int, int]) -> FloatArray:
    """(n, 2) pixel positions as fractions of the longer side of an image of (H, W)."""
    pixels = np.asarray(xy, np.float64)
    if pixels.ndim != 2 or pixels.shape[1] != 2 or len(pixels) == 0:
        raise ImageError(f"xy: expected fixations of shape (n, 2), found {pixels.shape}")
    if not ((pixels >= -0.5) & (pixels <= (shape[1] - 0.5, shape[0] - 0.5))).all():
        raise ImageError(f"xy: expected fixations inside {shape[1]} x {shape[0]}; some lie outside")
    return np.asarray((pixels + 0.5) / max(shape))


def _cells(xy: FloatArray, map_shape: tuple[int, ...], shape: tuple[int, int]) -> IntArray:
    """(n,) row-major index of the cell that contains each fixation (n, 2)."""
    h, w = map_shape
    columns, rows = np.floor((xy + 0.5) / shape[::-1] * (w, h)).astype(np.int64).T
    return np.asarray(rows.clip(0, h - 1) * w + columns.clip(0, w - 1), np.int64)
