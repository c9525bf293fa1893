"""`saccade demo`: attention, matching and SLAM on data that ships with the package."""

from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from saccade import datasets
from saccade.cli.drive import write_results
from saccade.cli.group import option
from saccade.cli.look import LookOptions, analyze_image
from saccade.cli.mapping import RunOutput
from saccade.cli.match import MatchOptions, match_images
from saccade.cli.options import DEFAULT_MODEL, JsonOption, attention_model
from saccade.cli.output import Result, Table, print_message, write_text
from saccade.cli.precompile import compile_updates, compiled_ahead
from saccade.cli.slam import SlamOptions, map_log
from saccade.evaluation.gaze import SETTINGS, gaze_drive
from saccade.io.files import results_in
from saccade.io.image import read_image
from saccade.keypoints.sift import Sift
from saccade.simulation import DriveConfig
from saccade.slam import Recorder
from saccade.types import Scanpath
from saccade.viewing import Picture, Section, attention_figure, html_page, save_figure
from saccade.viewing.report import ReportBuilder

LEAD = (
    "An image goes in, attention says where to look, interest points say what to keep, "
    "landmarks say where things are, and a map comes out."
)
SEED, FRAMES = 0, 80
"""Seed and number of frames of the simulated drive."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions(JsonOption):
    """Options of `saccade demo`."""

    out: Path = option(Path("saccade-demo"), "--out", "-o", metavar="DIR")
    """Output folder."""


def demo(options: DemoOptions) -> Result:
    """Run look, match, slam and drive on built-in data, and write index.html.

    Everything needed ships with the package. The first run also compiles, for
    up to a minute.
    """
    out = options.out
    builder = ReportBuilder("saccade demo", LEAD)
    page = out / "index.html"
    with results_in(out):
        with as_file(files("saccade") / "data") as data:
            results = _run(data, out, builder)
        report = builder.write(out / "report.html")
        write_text(page, _page(results))
    look, match, slam, drive = results.values()
    print_message(f"open {page} in a browser; then try: saccade look YOUR_PHOTO.jpg")
    rows = [
        [look["picture"], f"{len(look['scanpath'])} fixations"],
        [match["picture"], f"{match['matches']} matches"],
        [slam["files"]["picture"], f"{slam['landmarks']} landmarks by laser"],
        [drive["files"]["film"], f"{drive['landmarks']} landmarks by camera"],
        [str(report), "all results, interactive"],
        [str(page), "all results"],
    ]
    row = {"page": str(page), "report": str(report), **results}
    return Result(row, [Table("saccade demo", ["file", "content"], rows)])


def _run(data: Path, out: Path, builder: "ReportBuilder") -> dict[str, dict[str, Any]]:
    """Run the four commands with progress bars; returns the row of each."""
    columns = (TextColumn("{task.description:<40}"), BarColumn(), TimeElapsedColumn())
    victoria_park = data / "victoria_park.txt"
    results: dict[str, dict[str, Any]] = {}
    with (
        compiled_ahead("points", "association", "drive"),
        Progress(*columns, console=Console(stderr=True)) as bar,
    ):
        task = bar.add_task("attention: saliency and scanpath", total=1)
        attention = attention_model(DEFAULT_MODEL, free_viewing=True)
        photo = data / "chelsea.jpg"
        results["look"], _ = analyze_image(
            *(photo, out / "look", attention, LookOptions(), builder)
        )
        x, y, time, saliency = np.transpose(results["look"]["scanpath"])
        path = Scanpath(np.stack([x, y], axis=1), time, saliency)
        save_figure(attention_figure(read_image(photo), {}, path), out / "scanpath.png")
        bar.update(task, completed=1)

        task = bar.add_task("interest points: two views of a hallway", total=1)
        first, second = (data / f"hallway_{number}.jpg" for number in (1, 2))
        matching = MatchOptions(first=str(first), second=second, out=out)
        results["match"] = match_images(Sift(), matching, second, builder)
        bar.update(task, completed=1)

        def progress(done: int, total: int | None = None, stage: str = "") -> None:
            bar.update(task, completed=done, total=total)

        task = bar.add_task("EKF-SLAM: a car in Victoria Park", total=None)
        log = datasets.load("victoria-park", victoria_park)
        compile_updates()
        results["slam"] = map_log(log, SlamOptions(out=out), progress, builder)

        task = bar.add_task("visual SLAM: a robot that looks around", total=None)
        rooms = DriveConfig(
            world="rooms",
            frames=FRAMES,
            frames_per_lap=FRAMES,
            image_size=(240, 180),
            field_of_view=50.0,
            color=True,
        )
        recorder = Recorder(FRAMES // 2)
        drive, result = gaze_drive(rooms, "active", SEED, progress, recorder)
        output = RunOutput(out=out / "drive", film=True)
        results["drive"] = write_results(
            *(drive, SETTINGS, output, progress, result, recorder.snapshots, builder)
        )
    return results


def _page(results: dict[str, dict[str, Any]]) -> str:

    look, match, slam, drive = results.values()
    sections = [
        Section(
            "Where to look",
            "A model that was fitted to people predicts which places of a photograph they look "
            "at, and in which order.",
            [
                Picture(
                    "scanpath.png",
                    "A photograph of a cat with numbered fixations that are joined by lines",
                    "Numbers: the order of the fixations, the first in white. "
                    "Photograph: Stefan van der Walt, CC0.",
                )
            ],
            links=[Path(look[name]).name for name in ("picture", "arrays")],
        ),
        Section(
            "What to keep",
            f"Interest points are found again from another place: {match['matches']} of "
            f"{match['first_points']} on a second lap through the hallway.",
            [
                Picture(
                    Path(match["picture"]).name,
                    "Two photographs of one hallway, joined by lines between matched points",
                    "Green: matches that agree with one motion of the camera; red: the others. "
                    "Photographs: RTAB-Map samples, BSD-3.",
                )
            ],
            links=[Path(match["table"]).name],
        ),
        Section(
            "Where things are",
            f"A car drives through a park, and EKF-SLAM finds its way and {slam['landmarks']} "
            "trees from odometry and a laser.",
            [
                Picture(
                    Path(slam["files"]["picture"]).name,
                    "The estimated trajectory, the trajectory from odometry alone, and the "
                    "landmarks with their ellipses",
                    "Blue: the way; dashed: from odometry alone; orange: 3 sigma of each tree. "
                    "Victoria Park, Sydney; log: J. Guivant and E. Nebot, as distributed with "
                    "GTSAM, BSD.",
                )
            ],
            links=[*(Path(path).name for path in slam["files"].values()), "run.json"],
        ),
        Section(
            "Where to look next",
            "A robot turns its camera to where it expects to learn most about its pose and the "
            f"map: its position is off by {drive['ate_m']:.2f} m on average, by "
            f"{drive['odometry']['ate_m']:.2f} m from its wheels alone.",
            [
                Picture(
                    f"drive/{Path(drive['files']['still']).name}",
                    "The camera image with landmarks, the same image with saliency as heat, and "
                    "the map with the trajectory",
                    "A frame of the film: the camera image, its saliency, and the map. Blue: the "
                    "way; dashed: from odometry alone; orange: 3 sigma of each landmark; green: "
                    "what is in view. Posters: photographs of scikit-image's data, CC0 and public "
                    "domain.",
                )
            ],
            links=[f"drive/{Path(path).name}" for path in drive["files"].values()],
        ),
    ]
    return html_page("saccade demo", LEAD, sections, {"report.html": "Explore all four results"})
