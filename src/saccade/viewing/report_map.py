"""A map that is panned, zoomed and scrubbed through time, as a part of the report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from saccade.types import FloatArray, Image, IntArray, LandmarkMap, MapSnapshot, Trajectory
from saccade.viewing.maps import SIGMAS
from saccade.viewing.page import Section
from saccade.viewing.report import Part, jpeg

MOST_POSES = 6000
"""Of each drive; of a longer one every so-manieth is kept."""
MOST_DOTS = 3000
"""Of each chart."""
MOST_ROWS = 40_000
"""Landmarks in all snapshots together; where there are more, snapshots are left out."""
MOST_SIGHTINGS = 60_000
MOST_PICTURES = 1_600_000
"""Letters for all the pictures of the camera."""
WIDE = 280
"""Pixels, of a picture of the camera."""


@dataclass(frozen=True)
class Sightings:
    """What was seen of which landmark when."""

    step: IntArray
    """(k,) number of the pose, ascending."""
    name: IntArray
    """(k,) of the landmark, as in `MapSnapshot.names`."""
    xy: FloatArray | None = None
    """(k, 2) pixels."""
    kind: IntArray | None = None
    """(k,) 0 taken in, 1 followed, 2 recognized."""


@dataclass(frozen=True)
class Chart:
    """Numbers over time against a band."""

    title: str
    unit: str
    time: FloatArray
    """(k,) seconds."""
    values: FloatArray
    """(k,) NaN where there is none."""
    band: tuple[FloatArray, FloatArray] | None = None
    """(k,) from where to where."""
    band_name: str = ""
    name: str = ""
    mean: FloatArray | None = None
    """(k,) a running mean of the values, drawn over them."""
    mean_name: str = ""
    dots: bool = False
    """Whether the values are drawn one by one."""
    logarithmic: bool = False


@dataclass(frozen=True)
class Ground:
    """What a map shows besides the estimate."""

    drives: Mapping[str, Trajectory] = field(default_factory=dict)
    """By "odometry", "truth" or "smoothed"."""
    landmark_truth: LandmarkMap | None = None


def map_part(
    section: Section,
    estimate: Trajectory,
    snapshots: Sequence[MapSnapshot],
    sightings: Sightings,
    charts: Sequence[Chart],
    ground: Ground = Ground(),
    picture: Callable[[int], Image | None] | None = None,
) -> Part:
    """A drive and its map.

    Args:
        section: heading, text, facts and links.
        estimate: the drive.
        snapshots: of the map while it grew, at least one.
        sightings: of the landmarks.
        charts: what is drawn over time below the map.
        ground: what else is drawn.
        picture: gives what the camera saw at a pose, or None.
    """
    start = float(estimate.time[0])
    rows = sum(len(each.landmarks) for each in snapshots)
    kept = _thinned(snapshots, -(-rows // MOST_ROWS) or 1)
    shown = [] if picture is None else _pictures([each.step for each in kept], picture)
    drives = {"estimate": estimate, **ground.drives}
    data = {
        "sigmas": SIGMAS,
        "drives": [_drive(name, drive, start) for name, drive in drives.items()],
        "snapshots": _snapshots(kept, estimate.time - start),
        "sightings": _sightings(sightings, estimate.time - start, [at for at, _ in shown]),
        "pictures": [{"step": at, "source": source} for at, source in shown],
        "charts": [_chart(chart, start) for chart in charts],
    }
    if ground.landmark_truth is not None:
        data["truth"] = ground.landmark_truth.xy.ravel()
    return Part(section, "map", data)


def doubt_charts(estimate: Trajectory, truth: Trajectory | None) -> list[Chart]:
    """How sure the estimate is of itself over time; its errors against that where they are known.

    Args:
        estimate: with covariance, else there is nothing to draw.
        truth: with headings, in the same frame.
    """
    if estimate.covariance is None:
        return []
    sigma = np.sqrt(np.diagonal(estimate.covariance, axis1=1, axis2=2).clip(0))  # (t, 3)
    sigma = SIGMAS * sigma * [1, 1, 180 / np.pi]
    zero, time = np.zeros(len(sigma)), estimate.time
    name = f"{SIGMAS:.0f} sigma"
    if truth is None:
        place = SIGMAS * np.sqrt(np.linalg.eigvalsh(estimate.covariance[:, :2, :2])[:, -1].clip(0))
        return [
            Chart("How sure of the place", "m", time, place, (zero, place), name, name),
            Chart(
                "How sure of the heading", "°", time, sigma[:, 2], (zero, sigma[:, 2]), name, name
            ),
        ]
    error = estimate.pose - truth.at(time)
    error[:, 2] = np.degrees(np.angle(np.exp(1j * error[:, 2])))
    return [
        Chart(
            f"Error in {word}", unit, time, error[:, i], (-sigma[:, i], sigma[:, i]), name, "error"
        )
        for i, (word, unit) in enumerate((("x", "m"), ("y", "m"), ("heading", "°")))
    ]


def innovation_charts(
    time: FloatArray,
    innovation: FloatArray,
    covariance: FloatArray,
    nis: FloatArray,
    band: tuple[float, float],
    window: int,
) -> list[Chart]:
    """Innovations against what the filter expected of them.

    Args:
        time: (k,) of each observation, ascending.
        innovation: (k, 2), NaN where an observation corrected nothing.
        covariance: (k, 2, 2) of them.
        nis: (k,) normalized innovation squared.
        band: where 95 % of the running means of a consistent filter lie.
        window: observations in the running mean.
    """
    used = np.isfinite(nis)
    if not used.any():
        return []
    time, nis = time[used], nis[used]
    mean = np.full(len(nis), np.nan)
    if len(nis) >= window:
        mean[window - 1 :] = np.convolve(nis, np.full(window, 1 / window), "valid")
    ones = np.ones(len(nis))
    charts = [
        Chart(
            "Normalized innovation squared",
            "",
            time,
            nis.clip(1e-3),
            (band[0] * ones, band[1] * ones),
            "95 % of the means of a consistent filter",
            "each observation",
            mean,
            f"mean of {window}",
            dots=True,
            logarithmic=True,
        )
    ]
    sigma = np.sqrt(np.diagonal(covariance[used], axis1=1, axis2=2))
    for i, which in enumerate(("First", "Second")):
        share = innovation[used, i] / np.maximum(sigma[:, i], 1e-300)
        title, limit = f"{which} component of the innovation", SIGMAS * ones
        charts.append(
            Chart(
                title,
                "sigma",
                time,
                share,
                (-limit, limit),
                "3 sigma",
                "each observation",
                dots=True,
            )
        )
    return charts


def _thinned(items: Sequence[Any], stride: int) -> list[Any]:
    """Every so-manieth of them, the last one among them."""
    return list(items[::-1][::stride][::-1])


def _drive(name: str, drive: Trajectory, start: float) -> dict[str, Any]:
    at = np.array(_thinned(range(len(drive)), len(drive) // MOST_POSES + 1), np.int64)
    return {"name": name, "time": drive.time[at] - start, "xy": drive.pose[at, :2].ravel()}


def _snapshots(snapshots: Sequence[MapSnapshot], time: FloatArray) -> dict[str, Any]:
    """All of them in a row; of each its rows in the tables are known by how many they are."""
    spread = np.concatenate([each.landmark_covariance.reshape(-1, 4) for each in snapshots])
    places = np.concatenate([each.landmarks for each in snapshots])
    step = np.array([each.step for each in snapshots])
    pose = np.array([each.path[-1] for each in snapshots])
    own = np.array([each.covariance[[0, 0, 1], [0, 1, 1]] for each in snapshots])
    return {
        "step": step,
        "time": time[step],
        "pose": np.hstack([pose, own]).ravel(),
        "count": np.array([len(each.landmarks) for each in snapshots]),
        "name": np.concatenate([each.names for each in snapshots]),
        "landmark": np.hstack([places, spread[:, [0, 1, 3]]]).ravel(),
        "seen_count": np.array([len(each.seen) for each in snapshots]),
        "seen": np.concatenate([each.seen for each in snapshots]),
    }


def _sightings(sightings: Sightings, time: FloatArray, pictured: Sequence[int]) -> dict[str, Any]:
    """Steps and names of all of them; pixels of those in the pictures."""
    at = np.arange(0, len(sightings.step), len(sightings.step) // MOST_SIGHTINGS + 1)
    step = sightings.step[at]
    data: dict[str, Any] = {"step": step, "time": time[step], "name": sightings.name[at]}
    if sightings.xy is not None and sightings.kind is not None:
        there = np.flatnonzero(np.isin(sightings.step, pictured))
        data["pixels"] = {
            "step": sightings.step[there],
            "name": sightings.name[there],
            "kind": sightings.kind[there].astype(np.uint8),
            "xy": sightings.xy[there].ravel(),
        }
    return data


def _chart(chart: Chart, start: float) -> dict[str, Any]:
    stride = len(chart.time) // MOST_DOTS + 1
    every = slice(None, None, stride)
    data: dict[str, Any] = {
        "title": chart.title,
        "unit": chart.unit,
        "time": chart.time[every] - start,
        "values": chart.values[every],
        "name": chart.name,
        "dots": chart.dots,
        "logarithmic": chart.logarithmic,
        "band_name": chart.band_name,
        "mean_name": chart.mean_name,
    }
    if chart.band is not None:
        data["band"] = [each[every] for each in chart.band]
    if chart.mean is not None:
        data["mean"] = chart.mean[every]
    return data


def _pictures(
    steps: Sequence[int], picture: Callable[[int], Image | None]
) -> list[tuple[int, dict[str, Any]]]:
    """Small pictures of some poses, as many as there is room for."""
    made: list[tuple[int, dict[str, Any]]] = []
    stride = max(1, -(-len(steps) // 160))
    for step in _thinned(steps, stride):
        image = picture(step)
        if image is not None:
            made.append((step, _small(image)))
    while sum(len(each["address"]) for _, each in made) > MOST_PICTURES:
        made = _thinned(made, 2)
    return made


def _small(image: Image) -> dict[str, Any]:
    height, width = image.shape[:2]
    scale = min(1.0, WIDE / width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    levels = image if image.dtype == np.uint8 else _levels(image)
    shown = levels if levels.ndim == 2 else np.ascontiguousarray(levels[:, :, :3])
    small = cv2.resize(shown, size, interpolation=cv2.INTER_AREA)
    return {"address": jpeg(np.asarray(small, np.uint8), 65), "width": width, "height": height}


def _levels(image: Image) -> Image:
    """An image of any kind as uint8."""
    largest = np.iinfo(image.dtype).max if image.dtype.kind == "u" else 1
    return np.asarray((image * (255 / largest)).clip(0, 255), np.uint8)
