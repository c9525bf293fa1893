"""The steps of the Scale-Invariant Feature Transform as pictures (appendix B)."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from saccade.types import FloatArray, Image, Keypoints
from saccade.viewing.contrast_steps import SIGNED, bare
from saccade.viewing.keypoints import draw_keypoints
from saccade.viewing.style import BLUE, GRAY, GREEN, ORANGE, RED, figure_for, picture_axes
from saccade.viewing.symmetry import faded

FATES = {
    "low contrast": (GRAY, "."),
    "edge": (RED, "x"),
    "unstable": (BLUE, "s"),
    "kept": (GREEN, "o"),
}
"""Color and marker of a candidate by what became of it."""
PATCH = 160
"""Pixels of the turned patch to a side."""


@dataclass(frozen=True)
class DescribedPoint:
    """One keypoint with all that its descriptor was made of, in pixels of `gaussian`."""

    gaussian: FloatArray
    """(h, w) L of the closest scale."""
    octave: int
    """`gaussian` has one sample for 2**octave of the image."""
    x: float
    y: float
    sigma: float
    angle: float
    """Radians from x towards y."""
    histogram: FloatArray
    """(36,)"""
    dominant: Sequence[float]
    """Radians: all orientations of this point."""
    grid: FloatArray
    """(16, 16, 2) the samples (x, y)."""
    gradients: tuple[FloatArray, FloatArray]
    """Two (16, 16): length with weight, and angle in the frame of the point."""
    vector: FloatArray
    """(128,) by row and column of the subregion and by bin."""


def scale_space_figure(
    gaussians: Sequence[Sequence[FloatArray]], differences: Sequence[Sequence[FloatArray]]
) -> Figure:
    """The Gaussian images of each octave, and their differences below them.

    Args:
        gaussians: L, by octave and scale.
        differences: D, likewise; one fewer.
    """
    height, width = gaussians[0][0].shape
    columns = len(gaussians[0])
    figure = figure_for(width, height, columns, 2 * len(gaussians), panel=2.1)
    panels = figure.subplots(2 * len(gaussians), columns, squeeze=False)
    for octave, (smoothed, subtracted) in enumerate(zip(gaussians, differences, strict=True)):
        upper, lower = panels[2 * octave], panels[2 * octave + 1]
        h, w = smoothed[0].shape
        for i, (axes, L) in enumerate(zip(upper, smoothed, strict=True)):
            axes.imshow(L, cmap="gray", vmin=0, vmax=1)
            bare(axes)
            k = ("", "k", "k²", "k³", "k⁴", "k⁵")[i] if i < 6 else f"k^{i} "
            axes.set_title(f"{k}σ₀" if octave == 0 else f"{2**octave}{k}σ₀", fontsize=9)
        upper[0].set_ylabel(f"octave {octave + 1}: L\n{w} × {h}", fontsize=9)
        largest = max(float(np.abs(D).max()) for D in subtracted) or 1.0
        for axes, D in zip(lower, subtracted, strict=False):
            axes.imshow(D, cmap=SIGNED, vmin=-largest, vmax=largest)
            bare(axes)
        lower[0].set_ylabel(f"D, to ±{largest:.2f}", fontsize=9)
        for axes in lower[len(subtracted) :]:
            axes.set_axis_off()
    return figure


def candidate_figure(
    image: Image, xy: FloatArray, fates: Sequence[str], keypoints: Keypoints
) -> Figure:
    """Every candidate, colored by the first test it failed, and the keypoints that remain.

    Args:
        image: (H, W, 3) in [0, 1].
        xy: (n, 2) of the candidates in the image.
        fates: of each; one of `FATES`.
        keypoints: what was kept, with sizes.
    """
    figure = figure_for(image.shape[1], image.shape[0], columns=1, rows=1, panel=11)
    axes = figure.subplots()
    axes.imshow(faded(np.asarray(image, np.float32)), cmap="gray", vmin=0, vmax=1)
    fate = np.array(fates)
    for name, (color, marker) in FATES.items():
        there = xy[fate == name]
        size = 3 if name == "low contrast" else 5
        axes.plot(*there.T, marker, color=color, markersize=size, label=f"{len(there)} {name}")
    draw_keypoints(axes, keypoints)
    axes.set_axis_off()
    axes.set_xlim(-0.5, image.shape[1] - 0.5)
    axes.set_ylim(image.shape[0] - 0.5, -0.5)
    figure.legend(loc="outside lower center", ncols=len(FATES), frameon=False, markerscale=1.6)
    return figure


def orientation_figure(image: Image, point: DescribedPoint) -> Figure:
    """The place of one keypoint, its turned grid of samples, and its histogram of directions.

    Args:
        image: (H, W, 3) in [0, 1].
        point: the keypoint.
    """
    figure = Figure(figsize=(11.5, 3.6), layout="compressed", dpi=110)
    whole, close, bars = figure.subplots(1, 3, width_ratios=(1.35, 1, 1.35))
    outline = _corners(point.grid)
    whole.imshow(image)
    whole.plot(*(outline * 2**point.octave).T, color=ORANGE, linewidth=2)
    picture_axes(whole, "the keypoint and its patch")
    close.imshow(point.gaussian, cmap="gray")
    low, high = outline.min(0) - 1.5 * point.sigma, outline.max(0) + 1.5 * point.sigma
    close.set_xlim(low[0], high[0])
    close.set_ylim(high[1], low[1])
    close.plot(*point.grid.reshape(-1, 2).T, ".", color=BLUE, markersize=3)
    for line in _subregion_lines(point.grid):
        close.plot(*line.T, color=ORANGE, linewidth=1.2)
    length = 6 * point.sigma
    tip = (np.cos(point.angle) * length, np.sin(point.angle) * length)
    close.annotate(
        "",
        (point.x + tip[0], point.y + tip[1]),
        (point.x, point.y),
        arrowprops={"color": RED, "width": 2, "headwidth": 9},
    )
    picture_axes(close, "16 × 16 samples, turned")
    share = point.histogram / (float(point.histogram.max()) or 1.0)
    bars.bar(np.arange(36) * 10 + 5, share, width=9, color=np.where(share > 0.8, BLUE, GRAY))
    bars.axhline(0.8, color="black", linestyle="--", linewidth=1)
    for angle in point.dominant:
        bars.axvline(np.degrees(angle) % 360, color=RED, linewidth=1.5)
    bars.set_title("36 bins; over 80 % of the highest: blue", fontsize=10)
    bars.set_xlabel("direction, from x towards y [degrees]")
    bars.xaxis.set_major_locator(MultipleLocator(90))
    return figure


def descriptor_figure(point: DescribedPoint) -> Figure:
    """The gradients in the turned patch, the histograms of its subregions, and the 128 values.

    Args:
        point: the keypoint.
    """
    figure = Figure(figsize=(11.5, 3.6), layout="compressed", dpi=110)
    left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1, 1.6))
    lengths, angles = point.gradients
    center = np.arange(16) + 0.5
    x, y = np.meshgrid(center, center)
    step = lengths * (1.4 / (float(lengths.max()) or 1.0))
    arrows = {"angles": "xy", "scale_units": "xy", "scale": 1, "color": BLUE, "width": 0.007}
    _show_patch(left, point)
    left.quiver(x, y, step * np.cos(angles), step * np.sin(angles), **arrows)
    picture_axes(left, "gradients, weighted")
    _show_patch(middle, point)
    row, column, bin_ = (each.ravel() for each in np.indices((4, 4, 8)))
    length = point.vector * (2.2 / (float(point.vector.max()) or 1.0))
    dx, dy = length * np.cos(bin_ * np.pi / 4), length * np.sin(bin_ * np.pi / 4)
    arrows["width"] = 0.012
    middle.quiver(4 * column + 2, 4 * row + 2, dx, dy, headwidth=1, headlength=0, **arrows)
    picture_axes(middle, "4 × 4 histograms of 8 directions")
    right.bar(np.arange(128), point.vector, width=1.0, color=BLUE)
    right.set_xlim(-0.5, 127.5)
    right.xaxis.set_major_locator(MultipleLocator(32))
    right.set_xlabel("four subregions of 8 bins between two ticks: a row of the patch")
    right.set_title("128 values of unit length", fontsize=10)
    return figure


def _show_patch(axes: Axes, point: DescribedPoint) -> None:
    """L as the point sees it: turned upright, 16 samples a side, pale, with its subregions."""
    across, down = point.grid[0, 1] - point.grid[0, 0], point.grid[1, 0] - point.grid[0, 0]
    u = (np.arange(PATCH) + 0.5) * (16 / PATCH) - 0.5  # of the first sample: 0
    at = point.grid[0, 0] + u[:, None, None] * down + u[:, None] * across  # (PATCH, PATCH, 2)
    x, y = (np.ascontiguousarray(at[..., i], np.float32) for i in (0, 1))
    gaussian = np.asarray(point.gaussian, np.float32)
    patch = cv2.remap(gaussian, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    low, high = float(patch.min()), float(patch.max())
    axes.imshow(patch, cmap="gray", vmin=low - 1.2 * (high - low), vmax=high, extent=(0, 16, 16, 0))
    axes.set_xlim(0, 16)
    axes.set_ylim(16, 0)
    for line in (4, 8, 12):
        axes.axhline(line, color=ORANGE, linewidth=1.2)
        axes.axvline(line, color=ORANGE, linewidth=1.2)


def _corners(grid: FloatArray) -> FloatArray:
    """(5, 2) the closed outline of the samples, half a spacing beyond the outermost."""
    across, down = grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)])
    middle = grid.reshape(-1, 2).mean(0)
    return np.asarray(middle + 8 * (signs[:, :1] * across + signs[:, 1:] * down))


def _subregion_lines(grid: FloatArray) -> list[FloatArray]:
    """The lines, each (2, 2), between and around the 4 x 4 subregions."""
    a, b, c, d, _ = _corners(grid)
    shares = [share / 4 for share in range(5)]
    across = [np.array([a + (b - a) * t, d + (c - d) * t]) for t in shares]
    return across + [np.array([a + (d - a) * t, b + (c - b) * t]) for t in shares]
