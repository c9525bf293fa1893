"""What `saccade slam` and `saccade drive` write alike: films, reports and run.json."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
from matplotlib.figure import Figure

import saccade
from saccade.cli.group import option
from saccade.cli.options import FigureFormat, JsonOption, figure_formats, output_folder
from saccade.cli.output import Progress, write_text
from saccade.errors import ImageError
from saccade.evaluation.runs import has_headings, lost_times
from saccade.frames import Drive
from saccade.io.files import FORMATS, atomic_write
from saccade.io.video import video_writer
from saccade.slam import SlamResult, SmoothResult
from saccade.slam.consistency import chi_square_band, normalized_squared
from saccade.types import FloatArray, Image, IntArray, LandmarkLog, LandmarkMap, MapSnapshot
from saccade.viewing import save_figures
from saccade.viewing.film import Eye
from saccade.viewing.page import Section
from saccade.viewing.report import Part, ReportBuilder
from saccade.viewing.report_map import (
    Chart,
    ObservedLandmarks,
    innovation_charts,
    map_part,
    uncertainty_charts,
)
from saccade.visual import VisualResult

FRAME_RATE = 24
"""Frames per second of a film."""


SNAPSHOTS = 240
"""Maximum number of snapshots of the map, for the film and the report."""


@dataclass(frozen=True, kw_only=True)
class RunOutput(JsonOption):
    """Where a mapping run writes, and what besides its tables and figures."""

    out: Path = output_folder("saccade-run")
    figures: list[FigureFormat] | None = option(None, "--figure-format")
    """Format of the figures, png by default; several with commas."""
    film: bool = option(False, "--film/--no-film")
    """Also write a film of the growing map."""
    checkpoint: float = option(10.0, min=0.0, metavar="SECONDS")
    """Time between checkpoints, from which an interrupted run resumes."""

    def save_figure(self, figure: Figure, name: str) -> Path:
        """Write a figure in each format; returns the file of the first."""
        return save_figures(figure, self.out / name, figure_formats(self.figures))


def write_film(
    path: Path,
    frames: Iterable[Image],
    count: int,
    progress: Progress,
    still: int | None = None,
) -> dict[str, Path]:
    """Write a film as MP4, and frame `still` of it as PNG too; returns the files."""
    files = {"film": path}
    with video_writer(path, FRAME_RATE) as write:
        for number, frame in enumerate(frames):
            write(frame)
            if number == still:
                files["still"] = path.with_suffix(".png")
                with atomic_write(files["still"]) as temporary:
                    PIL.Image.fromarray(frame).save(temporary, format="PNG")
            progress(min(number + 1, count), count, "film")
    return files


def write_run(
    out: Path,
    title: str,
    lead: str,
    part: Callable[[], Part],
    files: Mapping[str, Path],
    row: dict[str, Any],
    report: ReportBuilder | None,
) -> dict[str, Any]:
    """Write the report and run.json; returns the content of that.

    `report` is the one to which the run is added; None for one of its own.
    """
    builder = report or ReportBuilder(title, lead)
    builder.add(part)
    if report is None:
        files = {**files, "report": builder.write(out / "report.html")}
    row |= {
        "format": FORMATS["run"],
        "version": saccade.__version__,
        "files": {name: str(path) for name, path in files.items()},
    }
    write_text(out / "run.json", json.dumps(row, indent=2) + "\n")
    return row


SLAM_TEXT = (
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
        Section(f"{log.name}: the growing map", SLAM_TEXT + LOADED * (loaded > 0), facts=facts),
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


DRIVE_TEXT = (
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
    trajectories = {"estimate": result.trajectory}
    trajectories |= {"odometry": result.odometry} if drive.has_odometry else {}
    trajectories |= {} if drive.truth is None else {"truth": drive.truth}
    observed = result.observations
    return map_part(
        Section(f"{drive.name}: the growing map", DRIVE_TEXT, facts=_facts(summary)),
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
        if summary["odometry"]["ate_m"] is not None:
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
