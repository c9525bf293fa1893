"""Mapping a camera drive, and its results: tables, files, figure, film and report."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from saccade import visual
from saccade.attention import attention_saliency
from saccade.cli.drive import DriveOptions
from saccade.cli.mapping import (
    pose_table,
    run_facts,
    time_charts,
    write_files,
    write_film,
    write_run,
)
from saccade.cli.output import (
    Progress,
    Table,
    print_message,
    stop_on_interrupt,
)
from saccade.cli.run_output import SNAPSHOTS, RunOutput
from saccade.datasets import load_drive, write_landmarks, write_table, write_tum
from saccade.datasets.drives.writing import LiveDrive
from saccade.diagnostics import drop_repeated, mapping_findings
from saccade.errors import ImageError
from saccade.evaluation.runs import summarize_drive
from saccade.evaluation.trajectory import coverage_remarks
from saccade.frames import Drive, Frame
from saccade.io.video import LiveVideo
from saccade.tags import TagConfig
from saccade.types import Float32Array, Image, MapSnapshot
from saccade.viewing import drive_frames, map_figure
from saccade.viewing.film import Eye
from saccade.viewing.page import Section
from saccade.viewing.report import Part, ReportBuilder
from saccade.viewing.report_map import ObservedLandmarks, map_part
from saccade.visual import VisualConfig, VisualResult


def drive_tables(row: dict[str, Any], title: str) -> list[Table]:
    """Tables of the errors and figures of a drive."""
    tables = [] if row["poses_compared"] is None else [_error_table(row, title)]
    figures = run_facts({name: each for name, each in row.items() if name not in ERRORS})
    if row["self_calibration"] is not None:
        figures |= _calibration_facts(row["self_calibration"])
    return [*tables, Table("" if tables else title, ["", ""], [*figures.items()])]


def _calibration_facts(report: dict[str, Any]) -> dict[str, str]:
    """Corrections of the calibration, and the effect of a disparity offset."""
    units = {"distortion": "", "disparity_slope": " px", "disparity_offset": " px"}
    facts = {
        name.replace("_", " "): f"{report[name]:.3f}{unit} (sigma {sigma:.3f})"
        for (name, unit), sigma in zip(units.items(), report["sigma"], strict=True)
    }
    by_tenth = f"{10 * report['scale_by_offset']:.1f} %"
    return facts | {"scale, by .1 px of disparity offset": by_tenth}


ERRORS = {
    "poses_compared": "poses compared",
    "ate_m": "ATE (m)",
    "ate_unaligned_m": "unaligned (m)",
    "rpe_m": "RPE (m)",
    "end_m": "at the end (m)",
    "inside_3sigma": "in 99.7 % ellipse",
    "alignment_scale": "scale",
}
"""Errors of a trajectory in run.json, and their column titles."""


def _error_table(row: dict[str, Any], title: str) -> Table:
    """Errors of the trajectories."""
    others = {
        "filtered": row["filtered"],
        "odometry": row["odometry"],
        "egomotion": row["visual_odometry"],
    }
    trajectories = {row["estimate"]: row} | others
    cells = [
        [
            name,
            f"{errors['poses_compared']} of {row['frames']}",
            *("" if (v := errors[c]) is None else f"{v:.3f}" for c in [*ERRORS][1:]),
        ]
        for name, errors in trajectories.items()
        if errors["poses_compared"] is not None
    ]
    return Table(title, ["", *ERRORS.values()], cells)


LEAD = "The trajectory of a robot and the map of its landmarks, from camera frames and odometry."


Mapped: TypeAlias = tuple[Drive, VisualResult, list[MapSnapshot]]


def load_recorded(sequence: Path, options: DriveOptions) -> Drive:
    """The recorded drive, read from its files."""
    recorded = options.load_drive(sequence)
    if options.frames is not None:
        recorded = recorded.until(options.frames)
    return recorded if options.keep_repeated else drop_repeated(recorded)


def map_recorded(
    drive: Drive,
    settings: VisualConfig,
    output: RunOutput,
    progress: Progress,
    tags: TagConfig | None = None,
) -> Mapped:
    """Map a recorded drive, with tags of a family and size, if any."""
    show = output.recorder(drive.name, drive.time, image_at=partial(image_of, drive))
    with show as recorder, visual.dedicated_process():
        report = partial(progress, stage="map")
        result = visual.run(drive, settings, report, recorder=recorder, tags=tags)
    return drive, result, recorder.snapshots


MAX_CAMERA_FRAMES = 36_000
"""Default maximum number of camera frames: 20 minutes at 30 frames per second."""


def map_camera(
    sequence: Path, settings: VisualConfig, options: DriveOptions, progress: Progress
) -> Mapped:
    """Map while the camera records into a folder."""
    frames = options.frames or MAX_CAMERA_FRAMES
    with (
        stop_on_interrupt("stopping after this frame") as stopped,
        LiveVideo(str(options.device), stopped) as video,
        closing(LiveDrive(video, sequence, options.calibration(), frames)) as recording,
        options.recorder(
            video.name, recording.drive.time, snapshots=max(SNAPSHOTS, frames // 4)
        ) as recorder,
        visual.dedicated_process(),
    ):
        report = partial(progress, stage="map")
        tags = options.tag_config
        result = visual.run(recording.drive, settings, report, recorder=recorder, tags=tags)
    if video.dropped:
        print_message(f"{video.name}: {video.dropped} frames dropped while others were processed")
    return load_drive("folder", sequence), result, recorder.snapshots


def write_results(
    drive: Drive,
    settings: VisualConfig,
    output: RunOutput,
    progress: Progress,
    result: VisualResult,
    snapshots: list[MapSnapshot],
    report: ReportBuilder | None = None,
) -> dict[str, Any]:
    """Write the results of a mapped drive, and return the content of run.json.

    The run is added to `report`; None writes a report for this run alone.
    """
    out = output.out
    tables: dict[str, tuple[Callable[..., Any], Any]] = {
        "trajectory.tum": (write_tum, result.trajectory),
        "poses.csv": (write_table, pose_table(result.trajectory)),
        "visual_odometry.csv": (write_table, pose_table(result.visual_odometry)),
        "landmarks.csv": (write_landmarks, result.map),
    }
    if result.estimate == "smoothed":
        tables["filtered.tum"] = write_tum, result.filtered
    files = write_files(out, tables) | write_figure(output, drive, result)
    if output.film:
        frames = film_frames(drive, snapshots, result)
        files |= write_film(out / "drive.mp4", frames, len(snapshots), progress)
    summary = summarize_drive(drive, result)
    findings = mapping_findings(drive, result, summary["inside_3sigma"])
    return write_run(
        out,
        f"saccade drive: {drive.name}",
        LEAD,
        lambda: drive_part(drive, snapshots, result, summary),
        files,
        {
            **summary,
            "scale": drive.scale,
            "remarks": [
                *drive.remarks,
                *drive.assumptions,
                *result.remarks,
                *coverage_remarks(summary["poses_compared"], summary["frames"]),
                *map(str, findings),
            ],
            "findings": [asdict(each) for each in findings],
            "seed": settings.seed,
            "settings": asdict(settings),
        },
        report,
    )


def write_figure(output: RunOutput, drive: Drive, result: VisualResult) -> dict[str, Path]:
    """Write a figure of the map; return the file in the first format."""
    odometry = result.odometry if drive.has_odometry else None
    figure = map_figure(
        result.trajectory,
        result.map,
        odometry,
        truth=drive.aligned_truth,
        filtered=result.filtered if result.estimate == "smoothed" else None,
        lost=result.lost,
    )
    if drive.scale != "metric":
        axes = figure.axes[0]
        axes.set_xlabel("x in units (the scale is unknown)")
        axes.set_ylabel("y in units")
    return {"picture": output.save_figure(figure, "map")}


def film_frames(
    drive: Drive,
    snapshots: list[MapSnapshot],
    result: VisualResult,
) -> Iterator[Image]:
    """Frames of a film: the camera image with landmarks and saliency, and the growing map."""
    drive = replace(drive, load=lru_cache(1)(drive.load))  # for its image and its gaze

    def saliency(image: Image) -> Float32Array:
        return attention_saliency(image).saliency

    def eye(number: int) -> Eye | None:
        frame = read_frame(drive, number)
        if frame is None or frame.turn is None:
            return None
        field_of_view = 2 * float(np.arctan(drive.camera.width / 2 / drive.camera.fx))
        return Eye(frame.gaze.pan, field_of_view, frame.gaze.reason)

    odometry = result.odometry if drive.has_odometry else None
    return drive_frames(
        *(snapshots, drive.time, odometry, partial(image_of, drive), saliency),
        observed_landmarks(result),
        eye_at=eye if eye(0) is not None else None,
    )


DRIVE_TEXT = (
    "The ellipses enclose 3 sigma (99.7 %). Scrub through the drive or play it; click a "
    "landmark to see the frames in which it was observed; click a chart to go to that time."
)
UNSCALED = " The scale is unknown, since one camera measures no lengths: m is an arbitrary unit."


def drive_part(
    drive: Drive,
    snapshots: Sequence[MapSnapshot],
    result: VisualResult,
    summary: Mapping[str, Any],
) -> Part:
    """The map of a drive as a part of a report; `summary` is the content of run.json."""
    trajectories = {"estimate": result.filtered}
    trajectories |= {"smoothed": result.trajectory} if result.estimate == "smoothed" else {}
    trajectories |= {"odometry": result.odometry} if drive.has_odometry else {}
    trajectories |= {} if (truth := drive.aligned_truth) is None else {"truth": truth}
    observed = result.observations
    text = DRIVE_TEXT + UNSCALED * (drive.scale != "metric")
    return map_part(
        Section(f"{drive.name}: the growing map", text, facts=run_facts(summary)),
        trajectories,
        snapshots,
        observed_landmarks(result),
        time_charts(
            result.trajectory,
            drive.aligned_truth,
            observed.frame,
            observed.innovation,
            observed.innovation_covariance,
        ),
        image_at=partial(image_of, drive),
        lost=summary["lost"],
        names=result.tags or None,
    )


def observed_landmarks(result: VisualResult) -> ObservedLandmarks:
    """Landmarks observed in each frame, for drawing."""
    observed = result.observations
    return ObservedLandmarks(observed.frame, observed.landmark, observed.xy, observed.kind)


def read_frame(drive: Drive, number: int) -> Frame | None:
    """A frame; None if it cannot be read."""
    try:
        return drive.load(number)
    except ImageError:
        return None


def image_of(drive: Drive, number: int) -> Image | None:
    """The image of a frame; None if the frame has no image."""
    frame = read_frame(drive, number)
    return None if frame is None else frame.image
