"""Part of a report: a map that is panned, zoomed and scrubbed through time."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

import numpy as np

from saccade.types import FloatArray, Image, IntArray, LandmarkMap, MapSnapshot, Trajectory
from saccade.viewing.embedding import camera_image
from saccade.viewing.innovations import running_mean
from saccade.viewing.maps import ELLIPSE_LABEL, ELLIPSE_SCALE
from saccade.viewing.page import Section
from saccade.viewing.report import MAX_PART_LENGTH, Part, with_notes
from saccade.viewing.style import SIGMAS

MAX_POSES = 6000
"""Poses of each trajectory."""
MAX_DOTS = 3000
"""Values of each chart."""
MAX_ROWS = 40_000
"""Landmarks in all snapshots together; where there are more, snapshots are left out."""
MAX_INTERVALS = 60_000
"""Intervals in which a landmark was observed without a gap."""
MAX_IMAGE_POINTS = 50_000
"""Landmarks in the camera images."""
MAX_GAP = 2
"""Poses between two observations of one interval."""
MAX_IMAGES = 160
"""Camera images."""
MAX_IMAGE_LENGTH = 1_600_000
"""Characters of all camera images."""
IMAGE_WIDTH = 280
"""Pixels of a camera image, at most."""
BUDGETS = (1.0, 0.7, 0.4, 0.2)
"""Fractions of these numbers that are tried until the part is small enough."""
T = TypeVar("T")


@dataclass(frozen=True)
class ObservedLandmarks:
    """Which landmarks were observed when."""

    step: IntArray
    """(k,) index of the pose, ascending."""
    id: IntArray
    """(k,) of the landmark, as in `MapSnapshot.ids`."""
    xy: FloatArray | None = None
    """(k, 2) pixels."""
    kind: IntArray | None = None
    """(k,) 0 new, 1 tracked, 2 re-identified."""


@dataclass(frozen=True)
class Chart:
    """Values over time with a band."""

    title: str
    unit: str
    time: FloatArray
    """(k,) seconds."""
    values: FloatArray
    """(k,) NaN where there is none."""
    band: tuple[FloatArray, FloatArray] | None = None
    """(k,) lower and upper limit."""
    band_name: str = ""
    name: str = ""
    mean: FloatArray | None = None
    """(k,) running mean of the values, drawn over them."""
    mean_name: str = ""
    dots: bool = False
    """Whether each value is a dot."""
    logarithmic: bool = False


@dataclass(frozen=True)
class MapOverlays:
    """What a map shows besides the estimate."""

    trajectories: Mapping[str, Trajectory] = field(default_factory=dict)
    """By "odometry", "truth" or "smoothed"."""
    landmark_truth: LandmarkMap | None = None


def map_part(
    section: Section,
    estimate: Trajectory,
    snapshots: Sequence[MapSnapshot],
    observed: ObservedLandmarks,
    charts: Sequence[Chart],
    overlays: MapOverlays = MapOverlays(),
    image_at: Callable[[int], Image | None] | None = None,
) -> Part:
    """A trajectory and its map.

    Args:
        section: heading, text, facts and links.
        estimate: the trajectory.
        snapshots: of the map over time, at least one.
        observed: when each landmark was observed.
        charts: drawn over time below the map.
        overlays: what the map shows besides.
        image_at: gives the camera image at a pose, or None.
    """
    time = estimate.time - float(estimate.time[0])
    trajectories = {"estimate": estimate, **overlays.trajectories}
    truth = overlays.landmark_truth
    data: dict[str, Any] = {
        "ellipse_scale": ELLIPSE_SCALE,
        "ellipse_label": ELLIPSE_LABEL,
        "trajectories": [_trajectory(*each, estimate.time[0]) for each in trajectories.items()],
        "charts": [_chart(chart, estimate.time[0]) for chart in charts],
        **({} if truth is None else {"truth": truth.xy.ravel()}),
    }
    dots = max((len(chart.time) for chart in charts if chart.dots), default=0)
    intervals = _intervals(observed, time)
    images = [] if image_at is None else _images([each.step for each in snapshots], image_at)
    rows = sum(len(each.landmarks) for each in snapshots)
    image_length = sum(len(each["source"]["address"]) for each in images)
    for budget in BUDGETS:
        every = _stride(rows, MAX_ROWS * budget)
        interval_stride = _stride(len(intervals["id"]), MAX_INTERVALS * budget)
        shown = _thinned(images, _stride(image_length, MAX_IMAGE_LENGTH * budget))
        data |= {
            "snapshots": _snapshots(_thinned(snapshots, every), time),
            "intervals": {name: each[::interval_stride] for name, each in intervals.items()},
            "image_points": _image_points(observed, shown, MAX_IMAGE_POINTS * budget),
            "images": shown,
        }
        notes = {
            "states of the map": (len(snapshots), every),
            "intervals in which a landmark was observed": (len(intervals["id"]), interval_stride),
            "innovations": (dots, _stride(dots, MAX_DOTS)),
        }
        part = Part(with_notes(section, notes), "map", dict(data))
        if len(part.html) <= MAX_PART_LENGTH:
            break
    return part


def uncertainty_charts(estimate: Trajectory, truth: Trajectory | None) -> list[Chart]:
    """The uncertainty of the estimate over time, with its errors where the truth is known.

    Args:
        estimate: without covariance there are no charts.
        truth: with headings, in the same frame.
    """
    if estimate.covariance is None:
        return []
    sigma = np.sqrt(np.diagonal(estimate.covariance, axis1=1, axis2=2).clip(0))  # (t, 3)
    limit = SIGMAS * sigma * [1, 1, 180 / np.pi]
    time, name = estimate.time, f"{SIGMAS:.0f} sigma"
    if truth is None:
        position = np.sqrt(np.linalg.eigvalsh(estimate.covariance[:, :2, :2])[:, -1].clip(0))
        return [
            Chart(title, unit, time, values, (np.zeros(len(values)), values), name, name)
            for title, unit, values in (
                ("Uncertainty of the position", "m", SIGMAS * position),
                ("Uncertainty of the heading", "°", limit[:, 2]),
            )
        ]
    error = estimate.pose - truth.at(time)
    error[:, 2] = np.degrees(np.angle(np.exp(1j * error[:, 2])))
    return [
        Chart(f"Error in {axis}", unit, time, values, (-band, band), name, "error")
        for axis, unit, values, band in zip(
            ("x", "y", "heading"), ("m", "m", "°"), error.T, limit.T, strict=True
        )
    ]


def innovation_charts(
    time: FloatArray,
    innovation: FloatArray,
    covariance: FloatArray,
    nis: FloatArray,
    band: tuple[float, float],
    window: int,
) -> list[Chart]:
    """Innovations in range and bearing against their covariance.

    Args:
        time: (k,) of each observation, ascending.
        innovation: (k, 2), NaN for an observation without update.
        covariance: (k, 2, 2) of them.
        nis: (k,) normalized innovation squared.
        band: 95 % interval of the running mean of a consistent filter.
        window: observations in the running mean.
    """
    used = np.isfinite(nis)
    if not used.any():
        return []
    time, nis = time[used], nis[used]
    mean = np.full(len(nis), np.nan)
    mean[window - 1 :] = running_mean(nis, window)
    ones = np.ones(len(nis))
    nis_chart = Chart(
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
    sigma = np.sqrt(np.diagonal(covariance[used], axis1=1, axis2=2))
    ratios = innovation[used] / np.maximum(sigma, 1e-300)
    limits, name = (-SIGMAS * ones, SIGMAS * ones), f"{SIGMAS:.0f} sigma"
    return [nis_chart] + [
        Chart(
            f"Innovation of the {component}",
            "sigma",
            time,
            values,
            limits,
            name,
            "each observation",
            dots=True,
        )
        for component, values in zip(("range", "bearing"), ratios.T, strict=True)
    ]


def _stride(count: int, limit: float) -> int:
    """The stride at which at most `limit` of `count` items are taken."""
    return max(1, -(-count // max(1, int(limit))))


def _thinned(items: Sequence[T], stride: int) -> list[T]:
    """Every item at a stride, the last one among them."""
    return list(items[::-1][::stride][::-1])


def _trajectory(name: str, trajectory: Trajectory, start: float) -> dict[str, Any]:
    rows = _thinned(range(len(trajectory)), len(trajectory) // MAX_POSES + 1)
    index = np.array(rows, np.int64)
    xy = trajectory.pose[index, :2].ravel()
    return {"name": name, "time": trajectory.time[index] - start, "xy": xy}


def _snapshots(snapshots: Sequence[MapSnapshot], time: FloatArray) -> dict[str, Any]:
    """The snapshots as tables; `count` and `observed_count` are the rows of each snapshot."""
    step = np.array([each.step for each in snapshots])
    pose = np.array([each.path[-1] for each in snapshots])
    covariance = np.array([each.covariance[[0, 0, 1], [0, 1, 1]] for each in snapshots])
    xy = np.concatenate([each.landmarks for each in snapshots])
    landmark_covariance = np.concatenate([each.landmark_covariance for each in snapshots])
    return {
        "step": step,
        "time": time[step],
        "pose": np.hstack([pose, covariance]).ravel(),
        "count": np.array([len(each.landmarks) for each in snapshots]),
        "id": np.concatenate([each.ids for each in snapshots]),
        "landmark": np.hstack([xy, landmark_covariance.reshape(-1, 4)[:, [0, 1, 3]]]).ravel(),
        "observed_count": np.array([len(each.observed) for each in snapshots]),
        "observed": np.concatenate([each.observed for each in snapshots]),
    }


def _intervals(observed: ObservedLandmarks, time: FloatArray) -> dict[str, FloatArray | IntArray]:
    """Intervals in which each landmark was observed: first and last pose, and how often."""
    id_step = np.unique(np.stack([observed.id, observed.step], 1), axis=0).reshape(-1, 2)
    id_of, step = id_step.T
    begins = np.ones(len(id_of), np.bool_)
    begins[1:] = (np.diff(id_of) != 0) | (np.diff(step) > MAX_GAP)
    first = np.flatnonzero(begins)
    count = np.diff(np.append(first, len(id_of)))
    return {
        "id": id_of[first],
        "first": step[first],
        "last": step[first + count - 1],
        "count": count,
        "time": time[step[first]],
    }


def _images(steps: Sequence[int], image_at: Callable[[int], Image | None]) -> list[dict[str, Any]]:
    """Small camera images at some of the poses."""
    return [
        {"step": step, "source": camera_image(image, IMAGE_WIDTH)}
        for step in _thinned(steps, _stride(len(steps), MAX_IMAGES))
        if (image := image_at(step)) is not None
    ]


def _image_points(
    observed: ObservedLandmarks, images: Sequence[Mapping[str, Any]], limit: float
) -> dict[str, Any] | None:
    """The landmarks in the camera images."""
    if observed.xy is None or observed.kind is None:
        return None
    rows = np.flatnonzero(np.isin(observed.step, [each["step"] for each in images]))
    rows = rows[:: _stride(len(rows), limit)]
    return {
        "step": observed.step[rows],
        "id": observed.id[rows],
        "kind": observed.kind[rows].astype(np.uint8),
        "xy": observed.xy[rows].ravel(),
    }


def _chart(chart: Chart, start: float) -> dict[str, Any]:
    """A chart as its script reads it, with at most `MAX_DOTS` values."""
    every = slice(None, None, _stride(len(chart.time), MAX_DOTS))

    def thinned(value: Any) -> Any:
        if isinstance(value, tuple):
            return [each[every] for each in value]
        return value[every] if isinstance(value, np.ndarray) else value

    data = {each.name: thinned(getattr(chart, each.name)) for each in fields(chart)}
    return data | {"time": data["time"] - start}
