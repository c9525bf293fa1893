"""What mapping runs write: films, reports and run.json."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import PIL.Image

import saccade
from saccade.cli.output import Progress, write_text
from saccade.io.files import atomic_write
from saccade.io.formats import FORMATS
from saccade.io.video import video_writer
from saccade.types import Image
from saccade.viewing.report import Part, ReportBuilder

FRAME_RATE = 24
"""Frames per second of a film."""


@dataclass(frozen=True)
class RunOutput:
    """Where a mapping run writes, and what besides its tables and figures."""

    folder: Path
    film: bool = True
    snapshots: int = 240
    """Maximum number of snapshots of the map, for the film and the report."""
    checkpoint_interval: float = 10.0
    """Seconds between checkpoints."""
    figures: Sequence[str] = ("png",)
    """Formats of the figures."""
    report: ReportBuilder | None = None
    """Report to which the run is added; None for one of its own."""


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
    output: RunOutput,
    report: tuple[str, str],
    part: Callable[[], Part],
    files: Mapping[str, Path],
    row: dict[str, Any],
) -> dict[str, Any]:
    """Write the report, given its title and lead, and run.json; returns the content of that."""
    builder = ReportBuilder(*report) if output.report is None else output.report
    builder.add(part)
    if output.report is None:
        files = {**files, "report": builder.write(output.folder / "report.html")}
    row |= {
        "format": FORMATS["run"],
        "version": saccade.__version__,
        "files": {name: str(path) for name, path in files.items()},
    }
    write_text(output.folder / "run.json", json.dumps(row, indent=2) + "\n")
    return row
