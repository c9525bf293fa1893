"""The report of `saccade drive`."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from saccade.frames import Drive
    from saccade.types import MapSnapshot
    from saccade.viewing.report import Part
    from saccade.viewing.report_map import Chart
    from saccade.visual import VisualResult


def drive_part(
    drive: "Drive",
    snapshots: "Sequence[MapSnapshot]",
    result: "VisualResult",
    numbers: Mapping[str, Any],
) -> "Part":
    """The map of a drive as a part of a report.

    Args:
        drive: what was mapped.
        snapshots: of the map while it grew.
        result: what came of it.
        numbers: its figures, as in run.json.
    """
    from saccade.cli.drive_files import pictures_of
    from saccade.viewing.page import Section
    from saccade.viewing.report_map import (
        MapOverlays,
        ObservedLandmarks,
        map_part,
        uncertainty_charts,
    )

    drives = {"odometry": result.odometry}
    drives |= {} if drive.truth is None else {"truth": drive.truth}
    seen = result.observations
    text = (
        "The ellipses enclose 3 sigma (99.7 %). Scrub through the drive or play it; "
        "click a landmark to see the frames in which it was seen; click a chart to go to that time."
    )
    return map_part(
        Section(f"{drive.name}: the map while it grows", text, facts=_facts(numbers)),
        result.trajectory,
        snapshots,
        ObservedLandmarks(seen.frame, seen.landmark, seen.xy, seen.kind),
        [*_innovations(result), *uncertainty_charts(result.trajectory, drive.truth)],
        MapOverlays(drives),
        pictures_of(drive),
    )


def _innovations(result: "VisualResult") -> "list[Chart]":
    """What the sightings that corrected the map said beyond what was expected."""
    import numpy as np

    from saccade.cli.slam_files import window_of
    from saccade.slam.consistency import chi_square_band
    from saccade.viewing.report_map import innovation_charts

    seen = result.observations
    again = np.isfinite(seen.innovation).all(1)
    v, S = seen.innovation[again], seen.innovation_covariance[again]
    nis = np.einsum("ki,kij,kj->k", v, np.linalg.inv(S), v)
    window = window_of(nis)
    time = result.trajectory.time[seen.frame[again]]
    return innovation_charts(time, v, S, nis, chi_square_band(2, window), window)


def _facts(numbers: Mapping[str, Any]) -> dict[str, str]:
    """The figures as a person reads them."""
    found = {name: str(numbers[name]) for name in ("frames", "landmarks", "sightings")}
    found["recognized again"] = str(numbers["recognized"])
    if numbers["ate_m"] is not None:
        found["error of the drive (ATE)"] = f"{numbers['ate_m']:.3f} m"
        found["of odometry alone"] = f"{numbers['odometry']['ate_m']:.3f} m"
    found["time per frame"] = f"{numbers['ms_per_frame']:.1f} ms"
    return found
