"""Figures of the documentation, drawn by the code that each page describes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import saccade
from saccade import datasets, slam, viewing
from saccade.attention.normalize import normalize
from saccade.frames import Frame
from saccade.scale.pyramid import halve
from saccade.simulation import DriveConfig, LightConfig, simulate_drive, tag_layout
from saccade.tags import TagConfig, Tags, observe_tags
from saccade.viewing.attention import draw_scanpath
from saccade.viewing.charts import Chart, innovation_charts, uncertainty_charts
from saccade.viewing.keypoints import draw_keypoints
from saccade.viewing.style import (
    BLUE,
    GRAY,
    GREEN,
    HEAT,
    ORANGE,
    figure_for,
    grid_axes,
    picture_axes,
)

DATA = Path(str(files("saccade") / "data"))


def photo(name: str) -> np.ndarray:
    """One of the photographs in the package."""
    return saccade.read_image(DATA / f"{name}.jpg")


def _draw_park(axes: Axes) -> None:
    _, run = _park()
    outlines = viewing.slam.ellipse_outlines(run.map.xy, run.map.covariance)
    axes.plot(*run.trajectory.pose[:, :2].T, color=BLUE, linewidth=0.9)
    axes.add_collection(PolyCollection([*outlines], **viewing.slam.ELLIPSE))
    axes.plot(*run.map.xy.T, ".", color="black", markersize=2.5)
    axes.set_aspect("equal")


def pyramid() -> Figure:
    """Levels of a pyramid in their true proportions."""
    image = photo("rocket")
    height, width = image.shape[:2]
    sheet = np.ones((height, width + width // 2 + 8, 3), np.float32)
    sheet[:, :width] = image
    level, top = image, 0
    for _ in range(5):
        level = halve(level)
        h, w = level.shape[:2]
        sheet[top : top + h, width + 8 : width + 8 + w] = level
        top += h + 1
    figure = figure_for(sheet.shape[1], height, columns=1, rows=1, panel=8)
    axes = figure.subplots()
    axes.imshow(sheet)
    picture_axes(axes, "pyramid levels 0 to 5")
    return figure


def attention_steps() -> Figure:
    """Conspicuity maps, saliency and scanpath of a photograph (A.11-A.14)."""
    image = photo("rocket")
    maps = saccade.contrast_saliency(image)
    path = saccade.scanpath(maps, fixations=6)
    shown = {
        "intensity (A.11)": maps.intensity,
        "color (A.12)": maps.color,
        "orientation (A.13)": maps.orientation,
        "saliency (A.14)": maps.saliency,
    }
    height, width = image.shape[:2]
    figure = figure_for(width, height, columns=3, rows=2, panel=4)
    panels = figure.subplots(2, 3).ravel()
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    panels[0].imshow(image)
    picture_axes(panels[0], "image")
    for axes, (title, values) in zip(panels[1:5], shown.items(), strict=True):
        axes.imshow(values, cmap=HEAT, vmin=0, extent=extent, interpolation="bilinear")
        picture_axes(axes, title)
    panels[5].imshow(image)
    draw_scanpath(panels[5], path)
    picture_axes(panels[5], "scanpath")
    return figure


def promotion() -> Figure:
    """Normalization N of a map with one peak and of a map with many."""
    rows, columns = np.mgrid[0:60, 0:90]

    def bump(x: float, y: float, height: float) -> np.ndarray:
        return height * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 3.0**2))

    even = sum(bump(10 + 14 * i, 10 + 13 * j, 0.8) for i in range(6) for j in range(4))
    odd = sum(bump(10 + 14 * i, 10 + 13 * j, 0.25) for i in range(6) for j in range(4))
    odd = odd + bump(52, 36, 0.75)
    figure = Figure(figsize=(11, 2.15), layout="compressed", dpi=110)
    panels = figure.subplots(1, 4)
    for pair, (name, values) in enumerate({"one strong peak": odd, "many peaks": even}.items()):
        promoted = normalize(values.astype(np.float32), "local-maxima")
        for axes, shown, title in (
            (panels[2 * pair], values, name),
            (panels[2 * pair + 1], promoted, f"after N: maximum {promoted.max():.2f}"),
        ):
            axes.imshow(shown, cmap=HEAT, vmin=0, vmax=1)
            picture_axes(axes, title)
    return figure


def presets() -> Figure:
    """Saliency of one photograph by the default and the presets of the contrast model."""
    image = photo("coffee")
    height, width = image.shape[:2]
    figure = figure_for(width, height, columns=3, rows=2, panel=3.8)
    panels = figure.subplots(2, 3).ravel()
    panels[0].imshow(image)
    picture_axes(panels[0], "image")
    config = saccade.ContrastConfig
    for axes, (name, each) in zip(
        panels[1:],
        {
            "default": config(),
            "kootstra2010": config.kootstra2010(),
            "itti1998": config.itti1998(),
            "saliencytoolbox2": config.saliencytoolbox2(),
        }.items(),
        strict=False,
    ):
        values = saccade.contrast_saliency(image, each).saliency
        axes.imshow(values, cmap=HEAT, vmin=0, extent=(0, width, height, 0))
        picture_axes(axes, name)
    panels[5].set_axis_off()
    return figure


def eye() -> Figure:
    """Symmetric pairs of a pixel in the pupil."""
    image = photo("chelsea")[60:170, 110:250]
    around = saccade.symmetric_pairs(image, (62, 51), radius=6)[:60]
    return viewing.pair_figure(image, [around])


def contrast_and_symmetry() -> Figure:
    """Fixations and maps of both models on the same face."""
    image = photo("chelsea")
    height, width = image.shape[:2]
    figure = figure_for(width, height, columns=2, rows=2, panel=4.6)
    models = {
        "contrast": saccade.contrast_saliency(image),
        "symmetry": saccade.symmetry_saliency(image),
    }
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    for (left, right), (name, maps) in zip(figure.subplots(2, 2), models.items(), strict=True):
        left.imshow(image)
        draw_scanpath(left, saccade.scanpath(maps, fixations=5))
        picture_axes(left, f"{name}: five fixations")
        right.imshow(maps.saliency, cmap=HEAT, vmin=0, extent=extent, interpolation="bilinear")
        picture_axes(right, f"{name}: saliency")
    return figure


def must() -> Figure:
    """Twenty points of MUST with the symmetric pairs at them."""
    image, find = photo("chelsea"), saccade.Must(saccade.MustConfig(max_keypoints=20))
    points = find(image).xy.tolist()
    pairs = [saccade.symmetric_pairs(image, (x, y), radius=2, max_pairs=4) for x, y in points]
    return viewing.pair_figure(image, pairs)


def symmetric_regions() -> Figure:
    """Twelve regions of SymRoID."""
    image = photo("chelsea")
    find = saccade.SymRoid(saccade.SymRoidConfig(max_keypoints=12))
    return viewing.region_figure(image, find(image))


def differences() -> Figure:
    """Gaussian images of a scale space and their differences (B.1-B.3)."""
    gray = cv2.cvtColor(photo("chelsea"), cv2.COLOR_RGB2GRAY)
    sigmas = [1.6 * 2 ** (i / 3) for i in range(5)]
    planes = [cv2.GaussianBlur(gray, (0, 0), sigma) for sigma in sigmas]
    figure = figure_for(gray.shape[1], gray.shape[0], columns=4, rows=2, panel=3)
    panels = figure.subplots(2, 4)
    for column in range(4):
        panels[0, column].imshow(planes[column], cmap="gray", vmin=0, vmax=1)
        picture_axes(panels[0, column], f"L at sigma = {sigmas[column]:.2f} px")
        difference = planes[column + 1] - planes[column]
        panels[1, column].imshow(difference, cmap="PuOr", vmin=-0.08, vmax=0.08)
        picture_axes(
            panels[1, column], f"D = L({sigmas[column + 1]:.2f}) - L({sigmas[column]:.2f})"
        )
    return figure


def interest_points() -> Figure:
    """Interest points with size and angle, and the descriptor of one."""
    image = photo("coffee")
    points = saccade.Sift(saccade.SiftConfig(max_keypoints=150))(image)
    figure = Figure(figsize=(11.5, 4.6), layout="compressed", dpi=110)
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
    left.imshow(image)
    draw_keypoints(left, points)
    picture_axes(left, f"{len(points)} strongest points with size and angle")
    one = int(np.argmin(abs(points.size - 22)))
    _draw_descriptor(right, image, points[one : one + 1])
    (x, y), side = points.xy[one].tolist(), 6 * float(points.size[one])
    degrees = np.degrees(float(points.angle[one]))
    corner = x - side / 2, y - side / 2
    box = Rectangle(corner, side, side, angle=degrees, rotation_point=(x, y))
    box.set(fill=False, color=BLUE, linewidth=1.5)
    left.add_patch(box)
    return figure


def _draw_descriptor(axes: Axes, image: np.ndarray, point: "saccade.Keypoints") -> None:
    """A descriptor as 4 x 4 stars of eight rays, over its patch rotated to angle 0."""
    side = 320
    scale = 6 * float(point.size[0]) / side  # the side of the descriptor is 12 times the scale
    angle = float(point.angle[0])
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    shift = point.xy[0] - turn @ np.full(2, side / 2)
    patch = cv2.warpAffine(
        image, np.c_[turn, shift], (side, side), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    axes.imshow(viewing.style.faded(patch), cmap="gray", vmin=0, vmax=1)
    rays = descriptor_rays(point.descriptors[0], side)
    axes.add_collection(LineCollection([*rays], colors=ORANGE, linewidths=2, capstyle="round"))
    for line in range(1, 4):
        axes.axhline(line * side / 4, color=BLUE, linewidth=0.8)
        axes.axvline(line * side / 4, color=BLUE, linewidth=0.8)
    picture_axes(axes, "descriptor: 4 x 4 subregions, 8 orientation bins each")


def descriptor_rays(descriptor: np.ndarray, side: float) -> np.ndarray:
    """Rays that draw a descriptor in its patch, rotated so that the keypoint has angle 0.

    Args:
        descriptor: (128,) subregions row by row; bins are ordered from y towards x.
        side: of the patch, in pixels.

    Returns:
        (128, 2, 2) end points (x, y) of each ray: the center of its subregion, then the tip along
        the gradient.
    """
    row, column, turn = np.indices((4, 4, 8)).reshape(3, -1)
    middle = (np.stack([column, row], axis=1) + 0.5) * side / 4
    angle = -turn * np.pi / 4
    length = side / 9 * descriptor / descriptor.max()
    ray = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.stack([middle, middle + ray], axis=1)


def _park() -> "tuple[saccade.LandmarkLog, slam.SlamResult]":
    if not _PARK:
        log = datasets.load("isam", DATA / "victoria_park.txt")
        _PARK.append((log, slam.run(log)))
    return _PARK[0]


_PARK: "list[tuple[saccade.LandmarkLog, slam.SlamResult]]" = []


def park() -> Figure:
    """Map of Victoria Park."""
    _, run = _park()
    return viewing.map_figure(run.trajectory, run.map, run.dead_reckoning)


def chart_figure(charts: Sequence[Chart], start: float = 0.0) -> Figure:
    """Charts side by side.

    Args:
        charts: in their order.
        start: origin of the time axes, in seconds.
    """
    columns = max(1, min(len(charts), 3))
    rows = max(1, -(-len(charts) // columns))
    figure = Figure(figsize=(4.2 * columns, 2.9 * rows), layout="constrained", dpi=110)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(charts) :]:
        axes.set_axis_off()
    for axes, chart in zip(panels, charts, strict=False):
        time = chart.time - start
        style: dict[str, Any] = {"color": BLUE, "linewidth": 1.0}
        dots = {"linestyle": "", "marker": ".", "markersize": 2, "color": GRAY, "alpha": 0.4}
        band = {"color": GREEN, "alpha": 0.25, "linewidth": 0}
        axes.fill_between(time, *chart.band, **band, label=chart.band_name)
        label = chart.name if chart.name != chart.band_name else None
        axes.plot(time, chart.values, **(dots if chart.dots else style), label=label)
        if chart.mean is not None:
            axes.plot(time, chart.mean, **style, label=chart.mean_name)
        if chart.logarithmic:
            axes.set_yscale("log")
            axes.minorticks_off()
        title = f"{chart.title} [{chart.unit}]" if chart.unit else chart.title
        axes.set_title(title, loc="left", fontsize=10, color="0.2")
        axes.set_xlabel("time since the start [s]")
        axes.margins(x=0.01)
        axes.legend(loc="upper right", fontsize=7, markerscale=3, edgecolor="none")
        grid_axes(axes)
    return figure


def innovations() -> Figure:
    """Innovations and uncertainty of Victoria Park."""
    from saccade.slam.consistency import chi_square_band

    log, run = _park()
    time, nis = log.time[log.observation_pose], run.consistency.nis
    S, band = run.innovation_covariance, chi_square_band(2, 50)
    charts = innovation_charts(time, run.innovation, S, nis, band, 50)
    charts += uncertainty_charts(run.trajectory, None)
    return chart_figure(charts, float(log.time[0]))


def simulated_frames() -> Figure:
    """Three frames of the ring, a depth image, mirrored posters, and low illumination."""
    plain = DriveConfig(color=True, depth=True)
    drive = simulate_drive(plain, seed=3)
    dusk = LightConfig(noise_sigma=5, brightness=0.35, vignetting=0.4)
    there = drive.load(140)
    shown = {
        "frame 20": drive.load(20).image,
        "frame 140": there.image,
        "frame 260": drive.load(260).image,
        "depth of frame 140": there.depth,
        "mirror-symmetric posters": _ring(plain, mirrored_posters=True).image,
        "illumination of the preset dark": _ring(plain, light=dusk).image,
    }
    figure = figure_for(320, 240, columns=3, rows=2, panel=3.6)
    for axes, (title, picture) in zip(figure.subplots(2, 3).ravel(), shown.items(), strict=True):
        axes.imshow(picture, cmap=HEAT)
        picture_axes(axes, title)
    return figure


def _ring(config: DriveConfig, **changed: object) -> Frame:
    return simulate_drive(replace(config, **changed), seed=3).load(140)


def tags() -> Figure:
    """An image of a hall with tags, and the map of the tags."""
    config = replace(DriveConfig.hall(), tags=6, image_size=(480, 360), color=True)
    drive, seen = simulate_drive(config, seed=3), TagConfig(size=0.4)
    log = observe_tags(drive, seen).log
    run, layout = slam.run(log), tag_layout(config, 3)
    image = drive.load(60).image
    figure = Figure((9.6, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.imshow(image)
    found = Tags(seen)(image, drive.camera)
    for label, corners, z in zip(found.labels, found.corners, found.z, strict=True):
        left.plot(*np.vstack([corners, corners[:1]]).T, color=ORANGE, linewidth=2)
        text = f"{label.partition(':')[2]}: {z[0]:.2f} m"
        left.annotate(text, corners.min(0) - (0, 14), color="black", va="bottom", fontsize=10)
    picture_axes(left, "tags and their ranges")
    right.plot(*run.dead_reckoning.pose[:, :2].T, color=GRAY, linewidth=0.9, label="odometry")
    right.plot(*run.trajectory.pose[:, :2].T, color=BLUE, linewidth=1.2, label="estimate")
    right.plot(*layout.xy.T, "o", color=GREEN, markersize=10, fillstyle="none", label="true tags")
    right.plot(*run.map.xy.T, ".", color="black", label="tags of the map")
    right.set_aspect("equal")
    right.set_xlabel("x [m]")
    right.set_ylabel("y [m]")
    right.legend(fontsize=8, loc="center")
    return figure


PAGES: "dict[str, Callable[[], Figure]]" = {
    "pyramid": pyramid,
    "attention-steps": attention_steps,
    "promotion": promotion,
    "presets": presets,
    "eye": eye,
    "contrast-and-symmetry": contrast_and_symmetry,
    "must": must,
    "symmetric-regions": symmetric_regions,
    "differences": differences,
    "interest-points": interest_points,
    "park": park,
    "innovations": innovations,
    "simulated-frames": simulated_frames,
    "tags": tags,
}
"""Figures by file name."""
