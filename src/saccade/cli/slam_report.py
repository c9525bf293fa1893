"""The report of `saccade slam`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from saccade.evaluation.slam_runs import has_headings, lost_times
from saccade.slam import SlamResult, SmoothResult
from saccade.slam.consistency import chi_square_band
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, MapSnapshot
from saccade.viewing.page import Section
from saccade.viewing.report import Part
from saccade.viewing.report_map import (
    ObservedLandmarks,
    innovation_charts,
    map_part,
    uncertainty_charts,
)

TEXT = (
    "The ellipses enclose 3 sigma (99.7 %). Scrub through the drive or play it; click a "
    "landmark to see the poses from which it was observed; click a chart to go to that time."
)
LOADED = " Blue landmarks are of the map that was loaded, black ones are new."
COUNT, NUMBER, METERS = "{:,}", "{:.3f}", "{:.3f} m"
LABELS = {
    "poses": ("poses", COUNT),
    "observations": ("observations of landmarks", COUNT),
    "observations_used": ("observations used", COUNT),
    "landmarks": ("landmarks in the map", COUNT),
    "map_landmarks": ("landmarks of the map that was loaded", COUNT),
    "map_landmarks_observed": ("of them, observed again", COUNT),
    "map_landmarks_new": ("new landmarks", COUNT),
    "landmarks_culled": ("landmarks culled", COUNT),
    "names_refused": ("names refused", COUNT),
    "odometry_end_error_m": ("error of odometry at the end", METERS),
    "odometry_end_from_estimate_m": ("odometry at the end, from the filter's estimate", METERS),
    "nis_mean": ("mean normalized innovation squared", NUMBER),
    "nonlinearity": ("share of second-order terms, root mean", NUMBER),
    "smoothing_iterations": ("iterations of the smoother", COUNT),
    "odometry_rmse_m": ("odometry, position RMSE", METERS),
    "odometry_unaligned_rmse_m": ("odometry, unaligned", METERS),
    "position_rmse_m": ("filter, position RMSE", METERS),
    "position_unaligned_rmse_m": ("filter, unaligned", METERS),
    "smoothed_position_rmse_m": ("smoother, position RMSE", METERS),
    "smoothed_position_unaligned_rmse_m": ("smoother, unaligned", METERS),
    "odometry_gps_rmse_m": ("odometry, RMSE to GPS", METERS),
    "position_gps_rmse_m": ("filter, RMSE to GPS", METERS),
    "smoothed_position_gps_rmse_m": ("smoother, RMSE to GPS", METERS),
    "landmark_rmse_m": ("landmarks, RMSE", METERS),
    "landmark_unaligned_rmse_m": ("landmarks, unaligned", METERS),
    "smoothed_landmark_rmse_m": ("smoothed landmarks, RMSE", METERS),
    "smoothed_landmark_unaligned_rmse_m": ("smoothed landmarks, unaligned", METERS),
}
"""Names and formats of the figures of run.json on the page and in the terminal."""


def facts(summary: Mapping[str, Any]) -> dict[str, str]:
    """The figures of run.json, formatted, with their labels; those that are None are left out."""
    shown = {"warning": summary["warning"]} if summary.get("warning") else {}
    shown |= {
        label: text.format(summary[name])
        for name, (label, text) in LABELS.items()
        if summary.get(name) is not None
    }
    if summary.get("lost"):
        shown["lost"] = lost_text(summary["lost"])
    if summary["nis_mean"] is not None:
        label, (low, high) = LABELS["nis_mean"][0], summary["nis_band"]
        shown[label] += f"; {low:.2f} to {high:.2f} in 95 % of consistent filters"
    return shown


def lost_text(times: Sequence[tuple[float, float | None]]) -> str:
    """When a robot was lost, in words."""
    return ", ".join(_interval(*each) for each in times)


def _interval(lost: float, found: float | None) -> str:
    """Times in seconds."""
    return f"from {lost:.1f} s on" if found is None else f"{lost:.1f} to {found:.1f} s"


def slam_part(
    log: LandmarkLog,
    result: SlamResult,
    smoothed: SmoothResult | None,
    snapshots: Sequence[MapSnapshot],
    facts: Mapping[str, str],
    loaded: int = 0,
) -> Part:
    """The map of a log as a part of a report; landmarks with an id under `loaded` were loaded."""
    truth = log.truth if log.truth is not None and has_headings(log.truth) else None
    trajectories = {"estimate": result.trajectory, "odometry": result.dead_reckoning}
    trajectories |= {} if truth is None else {"truth": truth}
    trajectories |= {} if smoothed is None else {"smoothed": smoothed.trajectory}
    used, ids = result.association >= 0, _final_ids(result.map, snapshots[-1])
    texts = result.map.text_names and dict(
        zip(ids.tolist(), map(str, result.map.names), strict=True)
    )
    consistency, window = result.consistency, averaging_window(result.consistency.nis)
    charts = innovation_charts(
        log.time[log.observation_pose],
        result.innovation,
        result.innovation_covariance,
        consistency.nis,
        chi_square_band(consistency.dof, window),
        window,
    )
    return map_part(
        Section(f"{log.name}: the growing map", TEXT + LOADED * (loaded > 0), facts=facts),
        trajectories,
        snapshots,
        ObservedLandmarks(
            log.observation_pose[used],
            ids[result.association[used]],
        ),
        [*charts, *uncertainty_charts(result.trajectory, truth)],
        log.landmark_truth,
        loaded=loaded,
        lost=lost_times(result.trajectory, result.lost),
        names=texts or None,
    )


def _final_ids(landmarks: LandmarkMap, last: MapSnapshot) -> IntArray:
    """(n,) identities in the last snapshot of the landmarks of the final map."""
    distance = np.square(landmarks.xy[:, None] - last.landmarks).sum(2)  # 0 to itself
    return last.ids[distance.argmin(1)] if len(last.ids) else np.zeros(len(landmarks), np.int64)


def averaging_window(nis: FloatArray) -> int:
    """Number of observations in the running mean of the NIS (k,), NaN where one was not used."""
    used = int(np.isfinite(nis).sum())
    return int(np.clip(used // 50, 5, 500))
