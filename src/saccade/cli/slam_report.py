"""The report of `saccade slam`."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from saccade.slam import SlamResult, SmoothResult
    from saccade.types import IntArray, LandmarkLog, LandmarkMap, MapSnapshot
    from saccade.viewing.report import Part

WORDS = {
    "poses": "poses",
    "observations": "observations of landmarks",
    "observations_used": "of these used",
    "landmarks": "landmarks in the map",
    "landmarks_dropped": "landmarks dropped on the way",
    "odometry_end_error_m": "odometry alone ends off the truth by",
    "odometry_end_from_estimate_m": "odometry alone ends off the filter's estimate by",
    "nis_mean": "normalized innovation squared, mean",
    "smoothing_iterations": "iterations of the smoother",
    "odometry_rmse_m": "error of odometry alone (RMSE)",
    "position_rmse_m": "error of the drive (RMSE)",
    "smoothed_position_rmse_m": "error of the smoothed drive (RMSE)",
    "odometry_gps_rmse_m": "odometry alone from GPS (RMSE)",
    "position_gps_rmse_m": "drive from GPS (RMSE)",
    "smoothed_position_gps_rmse_m": "smoothed drive from GPS (RMSE)",
    "landmark_rmse_m": "error of the landmarks (RMSE)",
    "smoothed_landmark_rmse_m": "error of the smoothed landmarks (RMSE)",
}
"""What the figures of a run are called on the page and in the terminal."""


def facts(numbers: Mapping[str, Any]) -> dict[str, str]:
    """The figures of a run as a person reads them, those that there are.

    Args:
        numbers: by their names in run.json.
    """
    found = {words: numbers[name] for name, words in WORDS.items() if numbers.get(name) is not None}
    meters = {words for name, words in WORDS.items() if name.endswith("_m")}
    shown = {
        words: f"{value:.3f}" if isinstance(value, float) else f"{value:,}"
        for words, value in found.items()
    }
    shown |= {words: f"{shown[words]} m" for words in meters & shown.keys()}
    if numbers["nis_mean"] is not None:
        low, high = numbers["nis_band"]
        shown[WORDS["nis_mean"]] += f"; {low:.2f} to {high:.2f} in 95 % of consistent filters"
    return shown


def slam_part(
    log: "LandmarkLog",
    result: "SlamResult",
    smoothed: "SmoothResult | None",
    snapshots: "Sequence[MapSnapshot]",
    facts: Mapping[str, str],
) -> "Part":
    """The map of a log as a part of a report."""
    from saccade.cli.slam_files import is_in_frame, window_of
    from saccade.slam.consistency import chi_square_band
    from saccade.viewing.page import Section
    from saccade.viewing.report_map import (
        MapOverlays,
        ObservedLandmarks,
        innovation_charts,
        map_part,
        uncertainty_charts,
    )

    truth = log.truth if is_in_frame(log.truth) else None
    drives = {"odometry": result.dead_reckoning}
    drives |= {} if truth is None else {"truth": truth}
    drives |= {} if smoothed is None else {"smoothed": smoothed.trajectory}
    used = result.association >= 0
    consistency, window = result.consistency, window_of(result.consistency.nis)
    charts = innovation_charts(
        log.time[log.observation_pose],
        result.innovation,
        result.innovation_covariance,
        consistency.nis,
        chi_square_band(consistency.dof, window),
        window,
    )
    text = (
        "The ellipses enclose 3 sigma (99.7 %). Scrub through the drive or play it; "
        "click a landmark to see from where it was seen; click a chart to go to that time."
    )
    return map_part(
        Section(f"{log.name}: the map while it grows", text, facts=facts),
        result.trajectory,
        snapshots,
        ObservedLandmarks(
            log.observation_pose[used],
            _names_at_the_end(result.map, snapshots[-1])[result.association[used]],
        ),
        [*charts, *uncertainty_charts(result.trajectory, truth)],
        MapOverlays(drives, log.landmark_truth),
    )


def _names_at_the_end(landmarks: "LandmarkMap", last: "MapSnapshot") -> "IntArray":
    """(n,) names of the landmarks of the map: those of the last snapshot that were kept."""
    import numpy as np

    apart = np.square(landmarks.xy[:, None] - last.landmarks).sum(2)  # 0 to what it was there
    return last.ids[apart.argmin(1)] if len(last.ids) else np.zeros(len(landmarks), np.int64)
