"""The report of `saccade drive`."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from saccade.cli.slam_report import averaging_window, lost_text
from saccade.errors import ImageError
from saccade.frames import Drive
from saccade.slam.consistency import chi_square_band, normalized_squared
from saccade.types import Image, MapSnapshot
from saccade.viewing.film import Eye
from saccade.viewing.page import Section
from saccade.viewing.report import Part
from saccade.viewing.report_map import (
    Chart,
    ObservedLandmarks,
    innovation_charts,
    map_part,
    uncertainty_charts,
)
from saccade.visual import VisualResult

TEXT = (
    "The ellipses enclose 3 sigma (99.7 %). Scrub through the drive or play it; click a "
    "landmark to see the frames in which it was observed; click a chart to go to that time."
)


def drive_part(
    drive: Drive,
    snapshots: Sequence[MapSnapshot],
    result: VisualResult,
    summary: Mapping[str, Any],
) -> Part:
    """The map of a drive as a part of a report; `summary` has the figures of run.json."""
    trajectories = {"estimate": result.trajectory, "odometry": result.odometry}
    trajectories |= {} if drive.truth is None else {"truth": drive.truth}
    observed = result.observations
    return map_part(
        Section(f"{drive.name}: the growing map", TEXT, facts=_facts(summary)),
        trajectories,
        snapshots,
        ObservedLandmarks(observed.frame, observed.landmark, observed.xy, observed.kind),
        [*_innovations(result), *uncertainty_charts(result.trajectory, drive.truth)],
        image_at=image_loader(drive),
        lost=summary["lost"],
    )


def _innovations(result: VisualResult) -> list[Chart]:
    """Charts of the innovations of the observations that updated the map."""
    observed = result.observations
    used = np.isfinite(observed.innovation).all(1)
    v, S = observed.innovation[used], observed.innovation_covariance[used]
    nis = normalized_squared(v, S)
    window = averaging_window(nis)
    time = result.trajectory.time[observed.frame[used]]
    return innovation_charts(time, v, S, nis, chi_square_band(2, window), window)


def _facts(summary: Mapping[str, Any]) -> dict[str, str]:
    """The figures of a drive, formatted, with their labels."""
    shown = {name: str(summary[name]) for name in ("frames", "landmarks", "observations")}
    shown["re-identifications"] = str(summary["reidentified"])
    if summary["lost"]:
        shown["lost"] = lost_text(summary["lost"])
    if summary["ate_m"] is not None:
        shown["ATE"] = f"{summary['ate_m']:.3f} m"
        shown["ATE of odometry"] = f"{summary['odometry']['ate_m']:.3f} m"
    shown["time per frame"] = f"{summary['ms_per_frame']:.1f} ms"
    return shown


def image_loader(drive: Drive) -> Callable[[int], Image | None]:
    """A function from the number of a frame to its image, or None where that cannot be read."""

    def load(number: int) -> Image | None:
        try:
            return drive.load(number).image
        except ImageError:
            return None

    return load


def eye_loader(drive: Drive) -> Callable[[int], Eye | None] | None:
    """A function from the number of a frame to where its camera looks; None for a fixed one."""

    def load(number: int) -> Eye | None:
        try:
            frame = drive.load(number)
        except ImageError:
            return None
        if frame.turn is None:
            return None
        field_of_view = 2 * float(np.arctan(drive.camera.width / 2 / drive.camera.fx))
        return Eye(frame.gaze.pan, field_of_view, frame.gaze.reason)

    return load if load(0) is not None else None
