"""Output shared by `saccade slam` and `saccade drive`: tables, films, reports and run.json."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from matplotlib.figure import Figure

import saccade
from saccade.cli.options import (
    OUTPUT,
    SEVERAL,
    FigureFormat,
    JsonOptions,
    OutputFolder,
    figure_formats,
)
from saccade.cli.output import Progress, facts, write_text
from saccade.datasets import symmetric_columns
from saccade.io.files import FORMATS, atomic_write
from saccade.io.video import video_writer
from saccade.slam.consistency import chi_square_band, normalized_squared
from saccade.types import FloatArray, Image, IntArray, MapSnapshot, Trajectory
from saccade.viewing import save_figures
from saccade.viewing.charts import Chart, innovation_charts, uncertainty_charts
from saccade.viewing.live import LiveMap
from saccade.viewing.report import Part, ReportBuilder
from saccade.viewing.snapshots import SnapshotRecorder

FRAME_RATE = 24
"""Frames per second of a film."""


SNAPSHOTS = 240
"""Maximum number of snapshots of the map, for the film and the report."""


@dataclass(frozen=True, kw_only=True)
class RunOutput(JsonOptions):
    """Output folder and optional outputs of a mapping run."""

    out: OutputFolder = Path("saccade-run")
    figures: Annotated[list[FigureFormat] | None, OUTPUT, SEVERAL, Parameter("--figure-format")] = (
        None
    )
    """Format of the figures, png by default; several with commas."""
    film: Annotated[bool, OUTPUT, Parameter(negative="--no-film")] = False
    """Also write a film of the growing map."""
    live: Annotated[bool, OUTPUT, Parameter(negative=())] = False
    """Show the growing map in the rerun viewer."""
    rrd: Annotated[Path | None, OUTPUT, Parameter(metavar="FILE")] = None
    """Record the growing map for the rerun viewer."""

    @contextmanager
    def recorder(
        self,
        name: str,
        time: FloatArray,
        odometry: Trajectory | None = None,
        image_at: Callable[[int], Image | None] | None = None,
        snapshots: int = SNAPSHOTS,
    ) -> Iterator[SnapshotRecorder]:
        """Snapshots of the growing map, sent to rerun if requested; arguments as for `LiveMap`."""
        with ExitStack() as stack:
            shows = [LiveMap(name, time, odometry, image_at)] if self.live else []
            if self.rrd is not None:
                file = stack.enter_context(atomic_write(self.rrd))
                shows.append(LiveMap(name, time, odometry, image_at, file))
            for show in shows:
                stack.callback(show.close)

            def show_all(taken: Sequence[MapSnapshot]) -> None:
                for show in shows:
                    show(taken)

            yield SnapshotRecorder(snapshots, show_all)

    def save_figure(self, figure: Figure, name: str) -> Path:
        """Write a figure in each format; return the file in the first format."""
        return save_figures(figure, self.out / name, figure_formats(self.figures))


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
