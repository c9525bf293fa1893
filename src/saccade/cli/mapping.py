"""Output shared by `saccade slam` and `saccade drive`: tables, films, reports and run.json."""

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import saccade
from saccade.cli.output import Progress, facts, write_text
from saccade.datasets import symmetric_columns
from saccade.io.files import FORMATS
from saccade.io.video import video_writer
from saccade.slam.consistency import chi_square_band, normalized_squared
from saccade.types import FloatArray, Image, IntArray, Trajectory
from saccade.viewing.charts import Chart, innovation_charts, uncertainty_charts
from saccade.viewing.report import Part, ReportBuilder

FRAME_RATE = 24
"""Frames per second of a film."""


def write_film(
    path: Path, frames: Iterable[Image], count: int, progress: Progress
) -> dict[str, Path]:
    """Write a film as MP4; return the file."""
    with video_writer(path, FRAME_RATE) as write:
        for number, frame in enumerate(frames, start=1):
            write(frame)
            progress(min(number, count), count, "film")
    return {"film": path}


def write_files(
    out: Path, contents: Mapping[str, tuple[Callable[..., Any], Any]]
) -> dict[str, Path]:
    """Write each file with its function; return the paths by file stem."""
    for name, (write, content) in contents.items():
        write(out / name, content)
    return {Path(name).stem: out / name for name in contents}


def write_run(
    out: Path,
    title: str,
    lead: str,
    part: Callable[[], Part],
    files: Mapping[str, Path],
    row: dict[str, Any],
    report: ReportBuilder | None,
) -> dict[str, Any]:
    """Write the report and run.json; return the content of run.json.

    The run is added to `report`; None writes a report for this run alone.
    """
    builder = ReportBuilder(title, lead) if report is None else report
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


NOT_SHOWN = ("log", "sequence", "seed", "remark", "format", "version")
"""Keys of run.json that are left out of the table of figures."""


def run_facts(summary: Mapping[str, Any]) -> dict[str, str]:
    """Figures of run.json with readable labels."""
    words = dict(summary)
    if summary.get("nis_mean") is not None:
        words["nis_band"] = "{:.2f} to {:.2f} in 95 %".format(*summary["nis_band"])
    words["lost"] = ", ".join(
        f"from {lost:.1f} s on" if found is None else f"{lost:.1f} to {found:.1f} s"
        for lost, found in summary["lost"]
    )
    return facts({name: each for name, each in words.items() if name not in NOT_SHOWN})


def pose_table(trajectory: Trajectory) -> dict[str, FloatArray]:
    """Each pose with its covariance, as columns."""
    axes = ("x", "y", "heading")
    columns = {"time": trajectory.time}
    columns |= dict(zip(axes, trajectory.pose.T, strict=True))
    if trajectory.covariance is not None:
        columns |= symmetric_columns(axes, trajectory.covariance)
    return columns


def time_charts(
    trajectory: Trajectory,
    truth: Trajectory | None,
    step: IntArray,
    innovation: FloatArray,
    covariance: FloatArray,
    dof: int = 2,
) -> list[Chart]:
    """Charts of the innovations (k, 2) at steps (k,), NaN without update, and of the pose."""
    used = np.isfinite(innovation).all(1)
    v, S = innovation[used], covariance[used]
    nis = normalized_squared(v, S)
    window = int(np.clip(np.isfinite(nis).sum() // 50, 5, 500))  # window of the running mean
    band = chi_square_band(dof, window)
    charts = innovation_charts(trajectory.time[step[used]], v, S, nis, band, window)
    return [*charts, *uncertainty_charts(trajectory, truth)]
