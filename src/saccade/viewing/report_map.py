"""Part of a report: a map that is panned, zoomed and scrubbed through time."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from saccade.types import FloatArray, Image, IntArray, LandmarkMap, MapSnapshot, Trajectory
from saccade.viewing.charts import Chart
from saccade.viewing.page import Section, photograph
from saccade.viewing.report import Part, stride, with_notes
from saccade.viewing.slam import ELLIPSE_LABEL, ELLIPSE_SCALE

MAX_POSES = 6000
"""Maximum number of poses of a trajectory."""
MAX_DOTS = 3000
"""Maximum number of values of a chart."""
MAX_ROWS = 24_000
"""Maximum number of landmarks in all snapshots; with more, snapshots are left out."""
MAX_INTERVALS = 30_000
"""Maximum number of intervals of uninterrupted observation."""
MAX_POSE_GAP = 2
"""Maximum difference of pose numbers between two observations of an interval."""
MAX_IMAGES = 160
"""Maximum number of camera images."""
MAX_IMAGE_LENGTH = 1_100_000
"""Maximum number of characters of all camera images."""
IMAGE_SIDE = 280
"""Longer side of a camera image in pixels."""
IMAGE_QUALITY = 65
"""JPEG quality of a camera image."""


@dataclass(frozen=True)
class ObservedLandmarks:
    """Observations of landmarks, by pose."""

    step: IntArray
    """(k,) index of the pose, ascending."""
    id: IntArray
    """(k,) id of the landmark, as in `MapSnapshot.ids`."""
    xy: FloatArray | None = None
    """(k, 2) pixels."""
    kind: IntArray | None = None
    """(k,) 0 new, 1 tracked, 2 re-identified."""


def map_part(
    section: Section,
    trajectories: Mapping[str, Trajectory],
    snapshots: Sequence[MapSnapshot],
    observed: ObservedLandmarks,
    charts: Sequence[Chart],
    landmark_truth: LandmarkMap | None = None,
    image_at: Callable[[int], Image | None] | None = None,
    loaded: int = 0,
    lost: Sequence[Sequence[float | None]] = (),
    names: Mapping[int, str] | None = None,
) -> Part:
    """Trajectories and the map over time.

    Args:
        section: heading, text and facts.
        trajectories: "estimate", and where known "odometry", "truth" and "smoothed".
        snapshots: of the map over time, at least one.
        observed: when each landmark was observed.
        charts: drawn over time below the map.
        landmark_truth: true positions of the landmarks, in the same frame.
        image_at: gives the camera image at a pose, or None.
        loaded: landmarks with smaller ids belong to the loaded map.
        lost: times of kidnapping and relocalization in seconds since the first pose; None for
            never.
        names: of landmarks, by id, if they are text.
    """
    time = trajectories["estimate"].time
    start, duration = float(time[0]), float(time[-1] - time[0])
    time = time - start
    images = [] if image_at is None else _images([each.step for each in snapshots], image_at)
    length = sum(len(each["source"]["address"]) for each in images)
    images = _thinned(images, stride(length, MAX_IMAGE_LENGTH))
    intervals = _intervals(observed, time)
    every = stride(len(intervals["id"]), MAX_INTERVALS)
    step = stride(sum(len(each.landmarks) for each in snapshots), MAX_ROWS)
    dots = max((len(chart.time) for chart in charts if chart.dots), default=0)
    data: dict[str, Any] = {
        "ellipse_scale": ELLIPSE_SCALE,
        "ellipse_label": ELLIPSE_LABEL,
        "loaded": loaded,
        "names": names or {},
        "lost": [[begin, duration if end is None else end] for begin, end in lost],
        "trajectories": [_trajectory(*each, start) for each in trajectories.items()],
        "charts": [_chart(chart, start) for chart in charts],
        "snapshots": _snapshots(_thinned(snapshots, step), time),
        "intervals": {name: each[::every] for name, each in intervals.items()},
        "image_points": _image_points(observed, images),
        "images": images,
    }
    if landmark_truth is not None:
        data["truth"] = landmark_truth.xy.ravel()
    notes = {
        "states of the map": (len(snapshots), step),
        "intervals in which a landmark was observed": (len(intervals["id"]), every),
        "innovations (none for new landmarks)": (dots, stride(dots, MAX_DOTS)),
    }
    return Part(with_notes(section, notes), "map", data)


def _thinned(items: Sequence[Any], step: int) -> list[Any]:
    """Every `step`-th item, counted from the last."""
    return list(items[::-1][::step][::-1])


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
    begins[1:] = (np.diff(id_of) != 0) | (np.diff(step) > MAX_POSE_GAP)
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
        {"step": step, "source": photograph(image, IMAGE_SIDE, IMAGE_QUALITY)}
        for step in _thinned(steps, stride(len(steps), MAX_IMAGES))
        if (image := image_at(step)) is not None
    ]


def _image_points(
    observed: ObservedLandmarks, images: Sequence[Mapping[str, Any]]
) -> dict[str, Any] | None:
    """The landmarks in the camera images."""
    if observed.xy is None or observed.kind is None:
        return None
    rows = np.flatnonzero(np.isin(observed.step, [each["step"] for each in images]))
    return {
        "step": observed.step[rows],
        "id": observed.id[rows],
        "kind": observed.kind[rows].astype(np.uint8),
        "xy": observed.xy[rows].ravel(),
    }


def _chart(chart: Chart, start: float) -> dict[str, Any]:
    """A chart as its script reads it, with at most `MAX_DOTS` values."""
    every = stride(len(chart.time), MAX_DOTS)
    data = {each.name: getattr(chart, each.name) for each in fields(chart)}
    data["time"] = chart.time - start
    thinned = {
        name: value[::every] for name, value in data.items() if isinstance(value, np.ndarray)
    }
    return data | thinned | {"band": [limit[::every] for limit in chart.band]}
