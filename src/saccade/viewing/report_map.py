"""A map that is panned, zoomed and scrubbed through time, as a part of the report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from saccade.types import FloatArray, Image, IntArray, LandmarkMap, MapSnapshot, Trajectory
from saccade.viewing.maps import SIGMAS
from saccade.viewing.page import Section
from saccade.viewing.report import MAX_LENGTH, Part, jpeg, with_notes

MAX_POSES = 6000
"""Of each drive; of a longer one every so-manieth is kept."""
MAX_DOTS = 3000
"""Of each chart."""
MAX_ROWS = 40_000
"""Landmarks in all snapshots together; where there are more, snapshots are left out."""
MAX_RUNS = 60_000
"""Stretches in which a landmark was seen without a gap."""
MAX_PIXELS = 50_000
"""Places of landmarks in the pictures of the camera."""
GAP = 2
"""Poses between two sightings of one stretch, at most."""
MAX_SHOWN = 160
"""Pictures of the camera."""
MAX_PICTURES = 1_600_000
"""Letters for all the pictures of the camera."""
WIDE = 280
"""Pixels, of a picture of the camera."""
BUDGET_FRACTIONS = (1.0, 0.7, 0.4, 0.2)
"""Shares of these numbers that are tried until the part is small enough."""


@dataclass(frozen=True)
class ObservedLandmarks:
    """What was seen of which landmark when."""

    step: IntArray
    """(k,) number of the pose, ascending."""
    name: IntArray
    """(k,) of the landmark, as in `MapSnapshot.ids`."""
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
    sightings: ObservedLandmarks,
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
    drawn = [] if picture is None else _pictures([each.step for each in snapshots], picture)
    runs = _runs(sightings, estimate.time - estimate.time[0])
    for budget in BUDGET_FRACTIONS:
        part = _map_part(
            section, estimate, snapshots, sightings, charts, ground, drawn, runs, budget
        )
        if part.letters <= MAX_LENGTH:
            break
    return part


def _map_part(
    section: Section,
    estimate: Trajectory,
    snapshots: Sequence[MapSnapshot],
    sightings: ObservedLandmarks,
    charts: Sequence[Chart],
    ground: Ground,
    drawn: Sequence[tuple[int, dict[str, Any]]],
    runs: Mapping[str, FloatArray | IntArray],
    budget: float,
) -> Part:
    """The part with a share `budget` of what it may hold at most."""
    start = float(estimate.time[0])
    rows = sum(len(each.landmarks) for each in snapshots)
    every = _stride(rows, MAX_ROWS * budget)
    kept = _thinned(snapshots, every)
    letters = [len(source["address"]) for _, source in drawn]
    shown = _thinned(drawn, _stride(sum(letters), MAX_PICTURES * budget))
    stretches = _stride(len(runs["name"]), MAX_RUNS * budget)
    dots = max((len(chart.time) for chart in charts if chart.dots), default=0)
    notes = {
        "states of the map": (len(snapshots), every),
        "stretches in which a landmark was seen": (len(runs["name"]), stretches),
        "innovations": (dots, _stride(dots, MAX_DOTS)),
    }
    drives = {"estimate": estimate, **ground.drives}
    data = {
        "sigmas": SIGMAS,
        "drives": [_drive(name, drive, start) for name, drive in drives.items()],
        "snapshots": _snapshots(kept, estimate.time - start),
        "runs": {name: values[::stretches] for name, values in runs.items()},
        "pixels": _pixels(sightings, [at for at, _ in shown], MAX_PIXELS * budget),
        "pictures": [{"step": at, "source": source} for at, source in shown],
        "charts": [_chart(chart, start) for chart in charts],
    }
    if ground.landmark_truth is not None:
        data["truth"] = ground.landmark_truth.xy.ravel()
    return Part(with_notes(section, notes), "map", data)


def uncertainty_charts(estimate: Trajectory, truth: Trajectory | None) -> list[Chart]:
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
    components: tuple[str, str] = ("range", "bearing"),
) -> list[Chart]:
    """Innovations against what the filter expected of them.

    Args:
        time: (k,) of each observation, ascending.
        innovation: (k, 2), NaN where an observation corrected nothing.
        covariance: (k, 2, 2) of them.
        nis: (k,) normalized innovation squared.
        band: where 95 % of the running means of a consistent filter lie.
        window: observations in the running mean.
        components: what the two of an innovation are of.
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
    for i, which in enumerate(components):
        fraction = innovation[used, i] / np.maximum(sigma[:, i], 1e-300)
        title, limit = f"Innovation of the {which}", SIGMAS * ones
        charts.append(
            Chart(
                title,
                "sigma",
                time,
                fraction,
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


def _stride(count: int, most: float) -> int:
    """Of how many one is kept, so that at most so many are."""
    return max(1, -(-count // max(1, int(most))))


def _drive(name: str, drive: Trajectory, start: float) -> dict[str, Any]:
    at = np.array(_thinned(range(len(drive)), len(drive) // MAX_POSES + 1), np.int64)
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
        "name": np.concatenate([each.ids for each in snapshots]),
        "landmark": np.hstack([places, spread[:, [0, 1, 3]]]).ravel(),
        "seen_count": np.array([len(each.observed) for each in snapshots]),
        "seen": np.concatenate([each.observed for each in snapshots]),
    }


def _runs(sightings: ObservedLandmarks, time: FloatArray) -> dict[str, FloatArray | IntArray]:
    """The stretches in which each landmark was seen: first and last pose, and how often."""
    order = np.lexsort((sightings.step, sightings.name))
    name, step = sightings.name[order], sightings.step[order]
    once = np.ones(len(name), np.bool_)
    once[1:] = (np.diff(name) != 0) | (np.diff(step) != 0)
    name, step = name[once], step[once]
    begins = np.ones(len(name), np.bool_)
    begins[1:] = (np.diff(name) != 0) | (np.diff(step) > GAP)
    first = np.flatnonzero(begins)
    count = np.diff(np.append(first, len(name)))
    return {
        "name": name[first],
        "first": step[first],
        "last": step[first + count - 1],
        "count": count,
        "time": time[step[first]],
    }


def _pixels(
    sightings: ObservedLandmarks, pictured: Sequence[int], most: float
) -> dict[str, Any] | None:
    """Where landmarks are in the pictures."""
    if sightings.xy is None or sightings.kind is None:
        return None
    there = np.flatnonzero(np.isin(sightings.step, pictured))
    there = there[:: _stride(len(there), most)]
    return {
        "step": sightings.step[there],
        "name": sightings.name[there],
        "kind": sightings.kind[there].astype(np.uint8),
        "xy": sightings.xy[there].ravel(),
    }


def _chart(chart: Chart, start: float) -> dict[str, Any]:
    every = slice(None, None, _stride(len(chart.time), MAX_DOTS))
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
    for step in _thinned(steps, _stride(len(steps), MAX_SHOWN)):
        image = picture(step)
        if image is not None:
            made.append((step, _small(image)))
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
